"""RLlib callbacks of a training run: place the environments, log each episode, load a checkpoint."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from ray.rllib.callbacks.callbacks import RLlibCallback

from safe_inspect.experiments.environment import TrainingEnv

#: Values of an episode and the names of their means in `env_runners`.
_NAMES = {"success": "success_rate", "lost": "lost_rate"}


class RunCallbacks(RLlibCallback):
    """What a run does at RLlib's hooks."""

    def on_algorithm_init(self, *, algorithm: Any, metrics_logger: Any = None, **kwargs: Any) -> None:
        """Set Torch's threads, and continue from a checkpoint when the run says so."""
        _set_threads(algorithm.config.env_config)
        checkpoint = algorithm.config.env_config.get("continue_from")
        # A finished checkpoint carries this key too, and is loaded where its own start may be long gone.
        if checkpoint and Path(checkpoint["path"]).is_dir():
            algorithm.restore_from_path(checkpoint["path"])
            algorithm._iteration = checkpoint["iteration"]
            algorithm._time_total = checkpoint["seconds"]

    def on_environment_created(
        self, *, env_runner: Any, metrics_logger: Any = None, env: Any, env_context: Any, **kwargs: Any
    ) -> None:
        """Give the environments the slots of their runner."""
        _set_threads(env_context)
        if isinstance(env, TrainingEnv):
            env.place(env_runner.worker_index or 0, bool(env_runner.config.in_evaluation))

    def on_episode_end(
        self, *, episode: Any, env_runner: Any = None, metrics_logger: Any = None, env: Any = None, **kwargs: Any
    ) -> None:
        """Log what the environment says about the episode that ends."""
        row = episode.get_infos(-1).get("episode")
        if row is None or metrics_logger is None:
            return
        config = env_runner.config
        # Each runner keeps its part of the window, as RLlib does with its own metrics.
        window = max(1, math.ceil(config.metrics_num_episodes_for_smoothing / (config.num_env_runners or 1)))
        for name, value in zip(env.episode_fields, row, strict=True):
            key = tuple(_NAMES.get(name, name).split("/"))
            metrics_logger.log_value(key, float(value), reduce="mean", window=window)


def _set_threads(config: Any) -> None:
    import torch

    torch.set_num_threads(int(config.get("torch_num_threads", 1)))
