"""What only RLlib's stock runners can do. Importing this module loads Ray and Torch."""

from __future__ import annotations

from typing import Any

from ray.rllib.callbacks.callbacks import RLlibCallback
from ray.rllib.utils import force_list

from safe_inspect.config.keys.rllib_keys import BATCHED_ALGORITHMS
from safe_inspect.experiments.sampling.callbacks import RunCallbacks

_HOOKS = ("on_episode_created", "on_episode_start", "on_episode_step", "on_episode_end")


def why_stock(config: Any) -> str:
    """Return why a configuration of RLlib needs the stock runner; empty when the batched one serves it."""
    algorithm = getattr(config.algo_class, "__name__", "")
    if algorithm not in BATCHED_ALGORITHMS:
        return f"{algorithm} is none of {', '.join(BATCHED_ALGORITHMS)}"
    if config._env_to_module_connector is not None or config._module_to_env_connector is not None:
        return "a connector stands between environment and policy"
    for hook in _HOOKS:
        own = any(
            getattr(kind, hook, None) is not getattr(RLlibCallback, hook)
            for kind in force_list(config.callbacks_class)
            if isinstance(kind, type) and not issubclass(RunCallbacks, kind)
        )
        if own or getattr(config, f"callbacks_{hook}"):
            return f"a callback waits for `{hook}`"
    if config.count_steps_by != "env_steps":
        return "steps are counted as agent steps"
    if config.restart_failed_sub_environments:
        return "environments that fail are to be restarted"
    return ""
