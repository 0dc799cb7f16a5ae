"""RLlib callbacks of a training run, and the metrics of the runners under the names that Algorithm and Tune expect."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ray.rllib.callbacks.callbacks import RLlibCallback
from ray.rllib.core import DEFAULT_AGENT_ID, DEFAULT_MODULE_ID
from ray.rllib.utils import metrics as names

from safe_inspect.compiling import compiling_seconds
from safe_inspect.config.keys.run_keys import COMPILING
from safe_inspect.experiments.sampling.episode_reports import EpisodeReport
from safe_inspect.experiments.sampling.rollout import Rollout
from safe_inspect.experiments.sampling.sampler import AgentSlot, agents_by_policy
from safe_inspect.experiments.sampling.stock_envs import TrainingEnv

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


def log_reports(logger: Any, config: Any, reports: Sequence[EpisodeReport]) -> None:
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


def log_steps(logger: Any, rollout: Rollout, slots: Sequence[AgentSlot], ended: int, several: bool) -> int:
    """Log the steps of a sample, and return the number of environment steps.

    Args:
        logger: RLlib's `MetricsLogger`.
        rollout: The sample.
        slots: The agents, in order.
        ended: Number of episodes that have ended.
        several: Whether RLlib handles several agents.
    """
    steps = sum(piece.stop - piece.start for piece in rollout.pieces)
    logger.log_value(names.NUM_ENV_STEPS_SAMPLED, steps, reduce="sum")
    logger.log_value(names.NUM_ENV_STEPS_SAMPLED_LIFETIME, steps, reduce="lifetime_sum", with_throughput=True)
    logger.log_value(names.NUM_EPISODES, ended, reduce="sum")
    logger.log_value(names.NUM_EPISODES_LIFETIME, ended, reduce="lifetime_sum")
    for index, slot in enumerate(slots):
        count = sum(piece.spans[index].length for piece in rollout.pieces)
        agent = slot.agent if several else DEFAULT_AGENT_ID
        logger.log_value((names.NUM_AGENT_STEPS_SAMPLED, agent), count, reduce="sum")
        logger.log_value((names.NUM_AGENT_STEPS_SAMPLED_LIFETIME, agent), count, reduce="lifetime_sum")
        logger.log_value((names.NUM_MODULE_STEPS_SAMPLED, slot.policy), count, reduce="sum")
        logger.log_value((names.NUM_MODULE_STEPS_SAMPLED_LIFETIME, slot.policy), count, reduce="lifetime_sum")
    return steps


def log_episodes(
    logger: Any, config: Any, reports: Sequence[EpisodeReport], slots: tuple[AgentSlot, ...], several: bool
) -> None:
    """Log returns and lengths of episodes that have ended.

    Args:
        logger: RLlib's `MetricsLogger`.
        config: RLlib's configuration.
        reports: The reports of the episodes, in the order in which they ended.
        slots: The agents, in order.
        several: Whether RLlib handles several agents.
    """
    window = window_of(config)
    recent = reports[-window:]

    def log(key: Any, value: float, reduce: str = "mean") -> None:
        logger.log_value(key, value, reduce=reduce, window=window)

    for name, what in (("episode_return", "return"), ("episode_len", "length")):
        values = [report[what] for report in recent]
        log(f"{name}_mean", _mean(values))
        log(f"{name}_min", min(values), "min")
        log(f"{name}_max", max(values), "max")
    log(names.EPISODE_DURATION_SEC_MEAN, _mean([report["seconds"] for report in recent]))
    if not several:
        value = _mean([report["return"] for report in recent])
        log(("agent_episode_return_mean", DEFAULT_AGENT_ID), value)
        log(("module_episode_return_mean", DEFAULT_MODULE_ID), value)
        return
    for policy, agents in agents_by_policy(slots).items():
        total = 0.0
        for agent in agents:
            value = _mean([report[f"agents/{agent}/return"] for report in recent])
            log((names.EPISODE_AGENT_RETURN_MEAN, agent), value)
            log((names.EPISODE_AGENT_STEPS, agent), _mean([report[f"agents/{agent}/length"] for report in recent]))
            total += value
        log((names.EPISODE_MODULE_RETURN_MEAN, policy), total)


def _mean(values: Sequence[float]) -> float:
    return math.fsum(values) / len(values)
