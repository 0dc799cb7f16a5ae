"""RLlib callbacks of a training run, which assign slots to environments, log episodes and load a checkpoint."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from ray.rllib.callbacks.callbacks import RLlibCallback

from safe_inspect.compiling import compiling_seconds
from safe_inspect.config.keys.run_keys import COMPILING
from safe_inspect.experiments.sampling.episode_reports import EpisodeReport
from safe_inspect.experiments.sampling.training_env import TrainingEnv

#: Values of an episode that are logged under RLlib's names.
LOGGED_BY_RLLIB = frozenset({"return", "length", "seconds"})


class RunCallbacks(RLlibCallback):
    """The callbacks of every training run."""

    _compiled = 0.0

    def on_algorithm_init(self, *, algorithm: Any, metrics_logger: Any = None, **kwargs: Any) -> None:
        """Set the number of Torch's threads, and load the checkpoint of a resumed run."""
        self._compiled = compiling_seconds()
        set_threads(algorithm.config.env_config)
        checkpoint = algorithm.config.env_config.get("continue_from")
        # Checkpoints of a resumed run contain this key too, and may be loaded when that folder no longer exists.
        if checkpoint and Path(checkpoint["path"]).is_dir():
            algorithm.restore_from_path(checkpoint["path"])
            algorithm._iteration = checkpoint["iteration"]
            algorithm._time_total = checkpoint["seconds"]

    def on_train_result(
        self, *, algorithm: Any, metrics_logger: Any = None, result: dict[str, Any], **kwargs: Any
    ) -> None:
        """Report the time that the iterations have spent compiling [s]."""
        result[COMPILING] = compiling_seconds() - self._compiled

    def on_environment_created(
        self, *, env_runner: Any, metrics_logger: Any = None, env: Any, env_context: Any, **kwargs: Any
    ) -> None:
        """Assign slots to the environments of a stock runner; the batched runner assigns slots when it builds them."""
        set_threads(env_context)
        index, evaluation = env_runner.worker_index or 0, bool(env_runner.config.in_evaluation)
        if isinstance(env, TrainingEnv):
            env.place(index, evaluation)
        for place, single in enumerate(getattr(env, "envs", ())):
            single.unwrapped.place(index, len(env.envs), place, evaluation)

    def on_episode_end(
        self,
        *,
        episode: Any,
        env_runner: Any = None,
        metrics_logger: Any = None,
        env: Any = None,
        env_index: int = 0,
        **kwargs: Any,
    ) -> None:
        """Log the report of an episode that has ended in an environment of a stock runner."""
        one = isinstance(env, TrainingEnv)
        report = env.report(env_index) if one else env.envs[env_index].unwrapped.report()
        if report is not None and metrics_logger is not None:
            log_reports(metrics_logger, env_runner.config, [report])


def log_reports(logger: Any, config: Any, reports: list[EpisodeReport]) -> None:
    """Log the means of the values of episodes that have ended.

    Args:
        logger: RLlib's `MetricsLogger`.
        config: RLlib's configuration.
        reports: The reports of the episodes, in the order in which they ended.
    """
    window = window_of(config)
    for name in reports[-1]:
        if name not in LOGGED_BY_RLLIB:
            values = [report[name] for report in reports[-window:] if name in report]
            logger.log_value(tuple(name.split("/")), sum(values) / len(values), reduce="mean", window=window)


def window_of(config: Any) -> int:
    """Return the number of episodes in the means of one runner: its part of the window, as in RLlib's own runners."""
    return int(max(1, math.ceil(config.metrics_num_episodes_for_smoothing / (config.num_env_runners or 1))))


def set_threads(config: Any) -> None:
    """Set the number of Torch's threads of this process."""
    import torch

    torch.set_num_threads(int(config.get("torch_num_threads", 1)))
