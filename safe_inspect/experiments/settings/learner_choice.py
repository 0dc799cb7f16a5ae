"""Which learner trains: this package's fast one, or RLlib's stock one where that is needed."""

from __future__ import annotations

from typing import Any

from safe_inspect.errors import Problem
from safe_inspect.experiments.settings.values import is_searched, named_values


def choose_learner(settings: dict[str, Any]) -> tuple[list[str], list[Problem]]:
    """Set `learner` to ``stock`` where the fast one cannot learn.

    Args:
        settings: The settings of the algorithm.

    Returns:
        What to tell the user, and mistakes.
    """
    for key in ("learner", "learner_threads"):
        if is_searched(settings[key]):
            message = f"`{key}` says how to compute, not what to learn; give one"
            return [], [Problem(message, f"rllib_configs.{key}")]
    if settings["learner"] == "stock":
        return [], []
    if settings["algorithm"] != "PPO":
        settings["learner"] = "stock"  # these have learners of their own; there is nothing to choose
        return [], []
    reason = _why_stock(settings)
    if not reason:
        return [], []
    settings["learner"] = "stock"
    return [f"RLlib's stock learner learns: {reason}"], []


def _why_stock(settings: dict[str, Any]) -> str:
    if settings["model_config"].get("use_lstm"):
        return "the policy is recurrent (`use_lstm`)"
    reasons = (
        ("num_learners", _above(1), "several learners share a batch"),
        ("torch_compile_learner", bool, "the fast one is not compiled"),
        ("torch_skip_nan_gradients", lambda value: value is False, "each gradient is to be checked"),
        ("rl_module", bool, "the fast one learns the package's own policies alone"),
        ("learner_connector", bool, "a connector stands between episodes and learner"),
        ("use_critic", lambda value: value is False, "there is no value function"),
        ("num_aggregator_actors_per_learner", _above(0), "other processes make the batches"),
    )
    for key, needed, reason in reasons:
        value: Any = settings.get(key)
        if any(needed(item) for item in named_values(value) if item is not None):
            return f"{reason} (`{key}`)"
    return ""


def _above(limit: float) -> Any:
    return lambda value: isinstance(value, int | float) and value > limit
