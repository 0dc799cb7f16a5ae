"""What the batched runner and the fast learner can do, by the keys of the algorithm; RLlib's stock ones do the rest."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from safe_inspect.config.keys.rllib_keys import BATCHED_ALGORITHMS
from safe_inspect.errors import Problem
from safe_inspect.experiments.settings.values import is_searched, named_values


class Capabilities(NamedTuple):
    """Why a training needs RLlib's stock runner or learner; empty texts where this package's own serve it.

    Attributes:
        sampling: Why the batched runner cannot sample.
        learning: Why the fast learner cannot learn.
    """

    sampling: str = ""
    learning: str = ""


def _above(limit: float) -> Callable[[Any], bool]:
    return lambda value: isinstance(value, int | float) and value > limit


#: Of each key: which values the own runner and learner do not serve, why not to sample, and why not to learn.
_KEYS: dict[str, tuple[Callable[[Any], bool], str, str]] = {
    "algorithm": (
        lambda value: value not in BATCHED_ALGORITHMS,
        f"the batched one serves {', '.join(BATCHED_ALGORITHMS)}, not {{}}",
        "",
    ),
    "rl_module": (
        bool,
        "the batched one serves the package's own policies alone",
        "the fast one learns the package's own policies alone",
    ),
    "env_to_module_connector": (bool, "a connector stands between environment and policy", ""),
    "module_to_env_connector": (bool, "a connector stands between policy and environment", ""),
    "restart_failed_sub_environments": (bool, "the batched one does not restart environments that fail", ""),
    "num_learners": (_above(1), "", "several learners share a batch"),
    "torch_compile_learner": (bool, "", "the fast one is not compiled"),
    "torch_skip_nan_gradients": (lambda value: value is False, "", "each gradient is to be checked"),
    "learner_connector": (bool, "", "a connector stands between episodes and learner"),
    "use_critic": (lambda value: value is False, "", "there is no value function"),
    "num_aggregator_actors_per_learner": (_above(0), "", "other processes make the batches"),
}


def capabilities_by_keys(value_of: Callable[[str], Any], recurrent: bool = False) -> Capabilities:
    """Return what the own runner and learner can do, as far as the keys of the algorithm decide it.

    Args:
        value_of: Function from a key to its value, which may be a search; None: the key is not given.
        recurrent: Whether the keys of the net ask for a recurrent policy.
    """
    reasons = ["the policy is recurrent (`use_lstm`)" if recurrent else ""] * 2
    for key, (needed, *texts) in _KEYS.items():
        found = next((item for item in named_values(value_of(key)) if item is not None and needed(item)), None)
        if found is not None:
            full = [text and (text.format(found) if "{}" in text else f"{text} (`{key}`)") for text in texts]
            reasons = [reason or text for reason, text in zip(reasons, full, strict=True)]
    return Capabilities(*reasons)


def choose_fast_paths(settings: dict[str, Any]) -> tuple[list[str], list[Problem]]:
    """Set `env_runner` and `learner` to ``stock`` where this package's own do not serve the training.

    Args:
        settings: The settings of the algorithm.

    Returns:
        What to tell the user, and mistakes.
    """
    problems = [
        Problem(f"`{key}` says how to {what}, not what to learn; give one", f"rllib_configs.{key}")
        for key, what in (("env_runner", "sample"), ("learner", "compute"), ("learner_threads", "compute"))
        if is_searched(settings[key])
    ]
    if problems:
        return [], problems
    notes = []
    found = capabilities_by_keys(settings.get, bool(settings["model_config"].get("use_lstm")))
    if found.sampling and settings["env_runner"] == "batched":
        settings["env_runner"] = "stock"
        notes.append(f"RLlib's stock runner samples: {found.sampling}")
    whole = settings.get("batch_mode") == "complete_episodes" and settings["num_envs_per_env_runner"] != 1
    if whole and settings["env_runner"] == "stock":
        notes.append(
            "`batch_mode: complete_episodes` throws unfinished episodes away and so favours short ones; "
            "`truncate_episodes` keeps them"
        )
    if settings["algorithm"] != "PPO":
        settings["learner"] = "stock"  # these have learners of their own; there is nothing to choose
    elif found.learning and settings["learner"] == "fast":
        settings["learner"] = "stock"
        notes.append(f"RLlib's stock learner learns: {found.learning}")
    return notes, []
