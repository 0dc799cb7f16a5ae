"""Metrics of the batched runners, under the names that RLlib's Algorithm and Tune expect."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from ray.rllib.core import DEFAULT_AGENT_ID, DEFAULT_MODULE_ID
from ray.rllib.utils.metrics import (
    EPISODE_AGENT_RETURN_MEAN,
    EPISODE_AGENT_STEPS,
    EPISODE_DURATION_SEC_MEAN,
    EPISODE_MODULE_RETURN_MEAN,
    NUM_AGENT_STEPS_SAMPLED,
    NUM_AGENT_STEPS_SAMPLED_LIFETIME,
    NUM_ENV_STEPS_SAMPLED,
    NUM_ENV_STEPS_SAMPLED_LIFETIME,
    NUM_EPISODES,
    NUM_EPISODES_LIFETIME,
    NUM_MODULE_STEPS_SAMPLED,
    NUM_MODULE_STEPS_SAMPLED_LIFETIME,
)

from safe_inspect.experiments.sampling.callbacks import window_of
from safe_inspect.experiments.sampling.episode_reports import EpisodeReport
from safe_inspect.experiments.sampling.rollout import Rollout
from safe_inspect.experiments.sampling.sampler import AgentSlot, agents_by_policy


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
    logger.log_value(NUM_ENV_STEPS_SAMPLED, steps, reduce="sum")
    logger.log_value(NUM_ENV_STEPS_SAMPLED_LIFETIME, steps, reduce="lifetime_sum", with_throughput=True)
    logger.log_value(NUM_EPISODES, ended, reduce="sum")
    logger.log_value(NUM_EPISODES_LIFETIME, ended, reduce="lifetime_sum")
    for index, slot in enumerate(slots):
        count = sum(piece.spans[index].length for piece in rollout.pieces)
        agent = slot.agent if several else DEFAULT_AGENT_ID
        logger.log_value((NUM_AGENT_STEPS_SAMPLED, agent), count, reduce="sum")
        logger.log_value((NUM_AGENT_STEPS_SAMPLED_LIFETIME, agent), count, reduce="lifetime_sum")
        logger.log_value((NUM_MODULE_STEPS_SAMPLED, slot.policy), count, reduce="sum")
        logger.log_value((NUM_MODULE_STEPS_SAMPLED_LIFETIME, slot.policy), count, reduce="lifetime_sum")
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
    log(EPISODE_DURATION_SEC_MEAN, _mean([report["seconds"] for report in recent]))
    if not several:
        value = _mean([report["return"] for report in recent])
        log(("agent_episode_return_mean", DEFAULT_AGENT_ID), value)
        log(("module_episode_return_mean", DEFAULT_MODULE_ID), value)
        return
    for policy, agents in agents_by_policy(slots).items():
        total = 0.0
        for agent in agents:
            value = _mean([report[f"agents/{agent}/return"] for report in recent])
            log((EPISODE_AGENT_RETURN_MEAN, agent), value)
            log((EPISODE_AGENT_STEPS, agent), _mean([report[f"agents/{agent}/length"] for report in recent]))
            total += value
        log((EPISODE_MODULE_RETURN_MEAN, policy), total)


def _mean(values: Sequence[float]) -> float:
    return math.fsum(values) / len(values)
