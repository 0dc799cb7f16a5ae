"""The callbacks of a training run, and batched environment runners for RLlib.

RLlib's own ("stock") runners have a Python object for each environment and pass every step through connectors. The
batched runners evaluate all environments and their policies as one batch of arrays, and create RLlib's episodes from
them when a sample is requested. `build_config` selects them for the trainings that they support.
"""

from __future__ import annotations

import gc
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from statistics import fmean
from typing import Any

from gymnasium import spaces as gym_spaces
from gymnasium.vector import VectorEnv
from ray.rllib.callbacks.callbacks import RLlibCallback
from ray.rllib.callbacks.utils import make_callback
from ray.rllib.core import DEFAULT_AGENT_ID, DEFAULT_MODULE_ID
from ray.rllib.env.env_context import EnvContext
from ray.rllib.env.multi_agent_env_runner import MultiAgentEnvRunner
from ray.rllib.env.single_agent_env_runner import SingleAgentEnvRunner
from ray.rllib.utils import metrics as names

from safe_inspect.compiling import compiling_seconds
from safe_inspect.config.keys.run_keys import COMPILING
from safe_inspect.environments.facades.spaces import AgentsByName
from safe_inspect.environments.team import TeamEnvironment
from safe_inspect.experiments.modules.tanh_net import PolicyNet
from safe_inspect.experiments.sampling.environment import TrainingEnv, build_team, first_slot, reported, seed_of
from safe_inspect.experiments.sampling.rollout import (
    AgentSlot,
    Rollout,
    agent_slots,
    multi_agent_episodes,
    single_agent_episodes,
)
from safe_inspect.experiments.sampling.sampler import DecisionSampler, EpisodeReport, Sampler

#: Values of an episode that are logged under RLlib's names.
LOGGED_BY_RLLIB = frozenset({"return", "length", "seconds"})

_REDUCTIONS: dict[str, Callable[[Sequence[float]], float]] = {"mean": fmean, "min": min, "max": max}
#: Name of the task's part of a runner's state.
TASK = "task"


class RunCallbacks(RLlibCallback):
    """The callbacks of every training run."""

    _compiled = 0.0

    def on_algorithm_init(self, *, algorithm: Any, **kwargs: Any) -> None:
        """Set the number of Torch's threads, and load the checkpoint of a resumed run."""
        self._compiled = compiling_seconds()
        set_threads(algorithm.config.env_config)
        checkpoint = algorithm.config.env_config.get("continue_from")
        # Checkpoints of a resumed run contain this key too, and may be loaded when that folder no longer exists.
        if checkpoint and Path(checkpoint["path"]).is_dir():
            algorithm.restore_from_path(checkpoint["path"])
            algorithm._iteration = checkpoint["iteration"]
            algorithm._time_total = checkpoint["seconds"]

    def on_train_result(self, *, result: dict[str, Any], **kwargs: Any) -> None:
        """Report the time that the iterations have spent compiling [s]."""
        result[COMPILING] = compiling_seconds() - self._compiled

    def on_environment_created(self, *, env_runner: Any, env: Any, env_context: Any, **kwargs: Any) -> None:
        """Assign slots to the environments of a stock runner; the batched runner assigns slots when it builds them."""
        set_threads(env_context)
        index, evaluation = env_runner.worker_index or 0, bool(env_runner.config.in_evaluation)
        if isinstance(env, TrainingEnv):
            env.place(first_slot(index, env.num_envs), evaluation)
        for place, single in enumerate(getattr(env, "envs", ())):
            single.unwrapped.place(first_slot(index, len(env.envs)) + place, evaluation)

    def on_episode_end(
        self, *, env_runner: Any = None, metrics_logger: Any = None, env: Any = None, env_index: int = 0, **kwargs: Any
    ) -> None:
        """Log the report of an episode that has ended in an environment of a stock runner."""
        one = isinstance(env, TrainingEnv)
        report = env.reports.get(env_index) if one else env.envs[env_index].unwrapped.reports.get(0)
        if report is not None:
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

    def log(key: Any, what: str, reduce: str = "mean") -> float:
        values = [report[what] for report in recent]
        value = _REDUCTIONS[reduce](values)
        logger.log_value(key, value, reduce=reduce, window=window)
        return value

    for name, what in (("episode_return", "return"), ("episode_len", "length")):
        for reduce in ("mean", "min", "max"):
            log(f"{name}_{reduce}", what, reduce)
    log(names.EPISODE_DURATION_SEC_MEAN, "seconds")
    if not several:
        log(("agent_episode_return_mean", DEFAULT_AGENT_ID), "return")
        log(("module_episode_return_mean", DEFAULT_MODULE_ID), "return")
        return
    totals = dict.fromkeys((slot.policy for slot in slots), 0.0)
    for slot in slots:
        totals[slot.policy] += log((names.EPISODE_AGENT_RETURN_MEAN, slot.agent), f"agents/{slot.agent}/return")
        log((names.EPISODE_AGENT_STEPS, slot.agent), f"agents/{slot.agent}/length")
    for policy, total in totals.items():
        logger.log_value((names.EPISODE_MODULE_RETURN_MEAN, policy), total, reduce="mean", window=window)


class TeamSpaces(VectorEnv[Any, Any, Any]):
    """Replacement for the environment that RLlib expects; it has the spaces and the batch of environments.

    Args:
        team: The environments.
        several: Whether RLlib handles several agents.
    """

    def __init__(self, team: TeamEnvironment, several: bool) -> None:
        self.team = team
        self.num_envs = team.num_envs
        controlled = AgentsByName(team)
        observation = gym_spaces.Dict({**controlled.observation_spaces})
        action = gym_spaces.Dict({**controlled.action_spaces})
        self.by_agent = {agent: (observation[agent], action[agent]) for agent in controlled.places}
        only = next(iter(self.by_agent))
        self.single_observation_space = self.observation_space = observation if several else observation[only]
        self.single_action_space = self.action_space = action if several else action[only]


@contextmanager
def _without_collection() -> Iterator[None]:
    """Pause the collection of garbage: thousands of objects that all stay are made, and each would be visited again."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


class _Batched:
    """Common part of both runners; the next class in the method resolution order is RLlib's own runner."""

    several: bool
    config: Any
    metrics: Any
    module: Any
    env: Any
    worker_index: Any
    _weights_seq_no: int
    _needs_initial_reset: bool
    _sampler: Sampler | None = None
    _done: Sequence[EpisodeReport] = ()

    def make_env(self) -> None:
        """Build the environments in the slots of this runner."""
        config = self.config.env_config
        set_threads(config)
        count, evaluation = self.config.num_envs_per_env_runner, bool(self.config.in_evaluation)
        slot = first_slot(self.worker_index or 0, count)
        team = build_team(config, count, slot, evaluation)
        self.agent_slots = agent_slots(team, self._policy_of)
        self.env = TeamSpaces(team, self.several)
        self.num_envs = count
        self._slot, self._seed_of_slots = slot, seed_of(config, evaluation)
        self._sampler = None
        self._done = ()
        self._needs_initial_reset = True
        context = EnvContext(config, worker_index=self.worker_index or 0)
        make_callback(
            "on_environment_created",
            callbacks_objects=self._callbacks,  # type: ignore[attr-defined]
            callbacks_functions=self.config.callbacks_on_environment_created,
            kwargs={"env_runner": self, "metrics_logger": self.metrics, "env": self.env, "env_context": context},
        )

    def _sample(self, **options: Any) -> list[Any]:
        """Return what the learner receives: RLlib's episodes, whole or in pieces, whose fields `rollout._episode` sets.

        With several agents they are a `MultiAgentEpisode` for each environment, otherwise a `SingleAgentEpisode`.
        """
        with reported(self.config.env_config):
            rollout = self._roll(**options)
        self._count(rollout)
        episodes = self._sampler.environment.simulation.episodes  # type: ignore[union-attr]
        names = [
            f"{self._seed_of_slots:x}-{self._slot + piece.env}-{piece.episode if piece.over else episodes[piece.env]}"
            for piece in rollout.pieces
        ]
        with _without_collection():
            return self._episodes(rollout, names)

    def _roll(
        self,
        *,
        explore: bool,
        num_timesteps: int | None = None,
        num_episodes: int | None = None,
        random_actions: bool = False,
        force_reset: bool = False,
    ) -> Rollout:
        assert not random_actions, "the algorithms with a batched runner do not sample random actions"
        if self._sampler is None:
            make: Any = partial(DecisionSampler, gamma=self.config.gamma) if self.env.team.decides else Sampler
            self._sampler = make(
                self.env.team,
                self.agent_slots,
                lambda policy, rows: PolicyNet(self._module_of(policy), rows, self._device),  # type: ignore[attr-defined]
                seed=self._seed_of_slots,
                first_slot=self._slot,
            )
        assert self._sampler is not None
        if num_timesteps is None:
            self._needs_initial_reset = True
            return self._sampler.roll_episodes(num_episodes or 0, explore)
        if force_reset or self._needs_initial_reset:
            self._sampler.reset()
            self._needs_initial_reset = False
        return self._sampler.roll(-(-num_timesteps // self.num_envs), explore)

    def _count(self, rollout: Rollout) -> None:
        """Log the steps and the episodes of a sample."""
        sampler = self._sampler
        assert sampler is not None, "sampled before"
        reports, sampler.reports = sampler.reports, []
        self._done = [*self._done, *reports]
        steps = log_steps(self.metrics, rollout, self.agent_slots, len(reports), self.several)
        if steps:
            self._log_env_steps(metric=self._metrics_num_env_steps_sampled, num_steps=steps)  # type: ignore[attr-defined]

    def get_state(self, components: Any = None, *, not_components: Any = None, **kwargs: Any) -> dict[str, Any]:
        """Return the state for a checkpoint: RLlib's state, and the task's state that resets do not change."""
        state: dict[str, Any] = super().get_state(components, not_components=not_components, **kwargs)  # type: ignore[misc]
        wanted = self._check_component(TASK, components, not_components)  # type: ignore[attr-defined]
        if wanted and self.env is not None:
            state[TASK] = self.env.team.simulation.state_dict()
        return state

    def set_state(self, state: dict[str, Any]) -> None:
        """Restore a state; the evaluation ignores the task's part, such as the training's price of fuel."""
        super().set_state(state)  # type: ignore[misc]
        if TASK in state and self.env is not None and not self.config.in_evaluation:
            self.env.team.simulation.load_state_dict(state[TASK])
            self._needs_initial_reset = True

    def get_metrics(self) -> Any:
        """Return the metrics that were logged since the last call."""
        if self._done:
            log_episodes(self.metrics, self.config, self._done, self.agent_slots, self.several)
            log_reports(self.metrics, self.config, self._done)
            self._done = ()
        return self.metrics.reduce()

    def _policy_of(self, agent: str) -> str:
        return str(self.config.policy_mapping_fn(agent, None) if self.several else DEFAULT_MODULE_ID)

    def _module_of(self, policy: str) -> Any:
        return self.module[policy] if self.several else self.module

    def _episodes(self, rollout: Rollout, names: list[str]) -> list[Any]:
        if not self.several:
            (slot,) = self.agent_slots
            return single_agent_episodes(rollout, slot, self.env.by_agent[slot.agent], names, self._weights_seq_no)
        trained = self.config.policies_to_train
        slots = [slot for slot in self.agent_slots if trained is None or slot.policy in trained]
        return multi_agent_episodes(
            rollout, slots, self.env.by_agent, names, self._weights_seq_no, self.config.policy_mapping_fn
        )


class BatchedEnvRunner(_Batched, SingleAgentEnvRunner):  # type: ignore[misc]
    """Batched runner for one agent in N environments."""

    several = False


class BatchedTeamRunner(_Batched, MultiAgentEnvRunner):  # type: ignore[misc]
    """Batched runner for several agents in N environments."""

    several = True
