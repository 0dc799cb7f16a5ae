"""Choice between this package's batched runner and fast learner and RLlib's stock ones, by the algorithm's keys."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from safe_inspect.config.keys.rllib_keys import BATCHED_ALGORITHMS
from safe_inspect.errors import Problem
from safe_inspect.experiments.settings.values import is_searched, named_values


class Capabilities(NamedTuple):
    """Reasons why a training needs RLlib's stock runner or learner.

    Attributes:
        sampling: Why the batched runner cannot sample; empty if it can.
        learning: Why the fast learner cannot learn; empty if it can.
    """

    sampling: str = ""
    learning: str = ""


def _above(limit: float) -> Callable[[Any], bool]:
    return lambda value: isinstance(value, int | float) and value > limit


#: For each key: a predicate for the values that need RLlib's stock runner or learner, the reason for the runner, and
#: the reason for the learner. An empty reason means that the value does not affect that part.
_KEYS: dict[str, tuple[Callable[[Any], bool], str, str]] = {
    "algorithm": (
        lambda value: value not in BATCHED_ALGORITHMS,
        f"the batched runner supports {', '.join(BATCHED_ALGORITHMS)}, not {{}}",
        "",
    ),
    "rl_module": (
        bool,
        "the batched runner supports only the package's own policies",
        "the fast learner supports only the package's own policies",
    ),
    "env_to_module_connector": (bool, "there is a connector between environment and policy", ""),
    "module_to_env_connector": (bool, "there is a connector between policy and environment", ""),
    "restart_failed_sub_environments": (bool, "the batched runner does not restart environments that fail", ""),
    "num_learners": (_above(1), "", "several learners share a batch"),
    "torch_compile_learner": (bool, "", "the fast learner is not compiled"),
    "torch_skip_nan_gradients": (lambda value: value is False, "", "each gradient must be checked"),
    "learner_connector": (bool, "", "there is a connector between episodes and learner"),
    "use_critic": (lambda value: value is False, "", "there is no value function"),
    "num_aggregator_actors_per_learner": (_above(0), "", "other processes make the batches"),
}


def capabilities_by_keys(value_of: Callable[[str], Any], recurrent: bool = False) -> Capabilities:
    """Return what the batched runner and the fast learner can do, as far as the algorithm's keys decide it.

    Args:
        value_of: Function that returns the value of a key, which may be a search, or None if the key is not given.
        recurrent: Whether the keys of the net request a recurrent policy.
    """
    reasons = ["the policy is recurrent (`use_lstm`)" if recurrent else ""] * 2
    for key, (needed, *texts) in _KEYS.items():
        found = next((item for item in named_values(value_of(key)) if item is not None and needed(item)), None)
        if found is not None:
            full = [text and (text.format(found) if "{}" in text else f"{text} (`{key}`)") for text in texts]
            reasons = [reason or text for reason, text in zip(reasons, full, strict=True)]
    return Capabilities(*reasons)


def choose_fast_paths(settings: dict[str, Any]) -> tuple[list[str], list[Problem]]:
    """Set `env_runner` and `learner` to ``stock`` where this package's own ones do not support the training.

    Args:
        settings: The settings of the algorithm, which are changed in place.

    Returns:
        Notes for the user, and problems.
    """
    problems = [
        Problem(f"`{key}` sets how to {what} and cannot be searched; give one value", f"rllib_configs.{key}")
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
            "`batch_mode: complete_episodes` discards unfinished episodes and so favours short ones; "
            "`truncate_episodes` uses them"
        )
    if settings["algorithm"] != "PPO":
        settings["learner"] = "stock"  # the other algorithms have only RLlib's learner
    elif found.learning and settings["learner"] == "fast":
        settings["learner"] = "stock"
        notes.append(f"RLlib's stock learner learns: {found.learning}")
    return notes, []
