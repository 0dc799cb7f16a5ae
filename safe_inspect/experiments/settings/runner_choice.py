"""Which environment runner samples: this package's batched one, or RLlib's stock one where that is needed."""

from __future__ import annotations

from typing import Any

from safe_inspect.config.keys.rllib_keys import BATCHED_ALGORITHMS, CHANGING_KEYS
from safe_inspect.errors import Problem
from safe_inspect.experiments.settings.values import is_searched


def choose_runner(settings: dict[str, Any]) -> tuple[list[str], list[Problem]]:
    """Set `env_runner` to ``stock`` where the batched one cannot sample.

    Args:
        settings: The settings of the algorithm.

    Returns:
        What to tell the user, and mistakes.
    """
    if is_searched(settings["env_runner"]):
        message = "`env_runner` says how to sample, not what to learn; give one"
        return [], [Problem(message, "rllib_configs.env_runner")]
    notes = []
    reason = _why_stock(settings) if settings["env_runner"] == "batched" else ""
    if reason:
        settings["env_runner"] = "stock"
        notes.append(f"RLlib's stock runner samples: {reason}")
    whole = settings.get("batch_mode") == "complete_episodes" and settings["num_envs_per_env_runner"] != 1
    if whole and settings["env_runner"] == "stock":
        notes.append(
            "`batch_mode: complete_episodes` throws unfinished episodes away and so favours short ones; "
            "`truncate_episodes` keeps them"
        )
    return notes, []


def _why_stock(settings: dict[str, Any]) -> str:
    if settings["algorithm"] not in BATCHED_ALGORITHMS:
        return f"the batched one serves {', '.join(BATCHED_ALGORITHMS)}, not {settings['algorithm']}"
    for key in CHANGING_KEYS:
        if settings.get(key):
            return f"the batched one serves the package's own policies alone (`{key}`)"
    if settings["model_config"].get("use_lstm"):
        return "the policy is recurrent (`use_lstm`)"
    if settings.get("restart_failed_sub_environments"):
        return "the batched one does not restart environments that fail (`restart_failed_sub_environments`)"
    return ""
