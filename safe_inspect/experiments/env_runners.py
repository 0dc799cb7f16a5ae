"""Batched environment runners for RLlib: all environments step as one batch, and so do their policies.

RLlib's own runners (here: stock) keep a Python object for each environment and pass every step through connectors.
These keep arrays, and make RLlib's episodes of them when they are asked for a sample. What they cannot do they leave to
the runner from which they are derived: see `why_stock`.
"""

from __future__ import annotations

import math
import warnings
from typing import Any

from gymnasium import spaces as gym_spaces
from ray.rllib.callbacks.callbacks import RLlibCallback
from ray.rllib.callbacks.utils import make_callback
from ray.rllib.core import DEFAULT_MODULE_ID
from ray.rllib.env.env_context import EnvContext
from ray.rllib.env.multi_agent_env_runner import MultiAgentEnvRunner
from ray.rllib.env.single_agent_env_runner import SingleAgentEnvRunner
from ray.rllib.utils import force_list
from ray.rllib.utils.metrics import (
    NUM_AGENT_STEPS_SAMPLED,
    NUM_AGENT_STEPS_SAMPLED_LIFETIME,
    NUM_ENV_STEPS_SAMPLED,
    NUM_ENV_STEPS_SAMPLED_LIFETIME,
    NUM_EPISODES,
    NUM_EPISODES_LIFETIME,
    NUM_MODULE_STEPS_SAMPLED,
    NUM_MODULE_STEPS_SAMPLED_LIFETIME,
)

from safe_inspect.environments.spaces import box
from safe_inspect.environments.team import TeamEnvironment
from safe_inspect.experiments.callbacks import RunCallbacks, log_reports, set_threads, window_of
from safe_inspect.experiments.environment import Reported, build_team, first_slot, seed_of
from safe_inspect.experiments.episode_sums import Report
from safe_inspect.experiments.fragments import multi_agent_episodes, single_agent_episodes
from safe_inspect.experiments.keys import BATCHED_ALGORITHMS
from safe_inspect.experiments.policy_net import PolicyNet, why_not_served
from safe_inspect.experiments.rollout import Rollout
from safe_inspect.experiments.sampler import Sampler, Seat, crews, seats_of

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
    return ""


class TeamSpaces:
    """Stands where RLlib expects an environment: it knows the spaces, and holds the batch.

    Args:
        team: The environments.
        seats: Its agents that act from outside.
        several: Whether RLlib sees several agents.
    """

    def __init__(self, team: TeamEnvironment, seats: tuple[Seat, ...], several: bool) -> None:
        self.team = team
        self.num_envs = team.num_envs
        groups = [team.acting[seat.group] for seat in seats]
        self.by_agent = {
            seat.agent: (box(group.observation_layout), box(group.action_layout))
            for seat, group in zip(seats, groups, strict=True)
        }
        pairs = self.by_agent.values()
        if several:
            names = list(self.by_agent)
            observation, action = (
                gym_spaces.Dict(dict(zip(names, column, strict=True))) for column in zip(*pairs, strict=True)
            )
        else:
            ((observation, action),) = pairs
        self.observation_space = self.single_observation_space = observation
        self.action_space = self.single_action_space = action

    @property
    def unwrapped(self) -> TeamSpaces:
        """The same: nothing is wrapped."""
        return self

    def close(self) -> None:
        """Nothing is to be closed."""


class _Batched:
    """What both runners do alike; the class behind it is RLlib's own runner."""

    several: bool
    config: Any
    metrics: Any
    module: Any
    env: Any
    worker_index: Any
    _weights_seq_no: int
    _needs_initial_reset: bool
    _sampler: Sampler | None = None
    _stock = ""

    def make_env(self) -> None:
        """Build the environments in the slots of this runner."""
        self._stock = self._stock or why_stock(self.config)
        if self._stock:
            warnings.warn(f"the stock runner samples, as {self._stock}", stacklevel=2)
            super().make_env()  # type: ignore[misc]
            return
        config = self.config.env_config
        set_threads(config)
        count, evaluation = self.config.num_envs_per_env_runner, bool(self.config.in_evaluation)
        slot = first_slot(self.worker_index or 0, count)
        team = build_team(config, count, slot, evaluation)
        self.seats = seats_of(team, None if self.several else DEFAULT_MODULE_ID)
        self.env = TeamSpaces(team, self.seats, self.several)
        self.num_envs = count
        self._slot, self._seed_of_slots = slot, seed_of(config, evaluation)
        self._sampler = None
        self._done: list[Report] = []
        self._needs_initial_reset = True
        make_callback(
            "on_environment_created",
            callbacks_objects=self._callbacks,  # type: ignore[attr-defined]
            callbacks_functions=self.config.callbacks_on_environment_created,
            kwargs={
                "env_runner": self,
                "metrics_logger": self.metrics,
                "env": self.env,
                "env_context": EnvContext(config, worker_index=self.worker_index or 0),
            },
        )

    def make_module(self) -> None:
        """Build the policies; those that the batch cannot serve go back to the stock runner."""
        super().make_module()  # type: ignore[misc]
        if self.env is None or self._stock or self.module is None:
            return
        for policy in crews(self.seats):
            self._stock = self._stock or why_not_served(self._module_of(policy))
        if self._stock:
            self.env = None
            self.make_env()

    def _sample(
        self,
        *,
        num_timesteps: int | None = None,
        num_episodes: int | None = None,
        explore: bool,
        random_actions: bool = False,
        force_reset: bool = False,
    ) -> list[Any]:
        if self._stock:
            found: list[Any] = super()._sample(  # type: ignore[misc]
                num_timesteps=num_timesteps,
                num_episodes=num_episodes,
                explore=explore,
                random_actions=random_actions,
                force_reset=force_reset,
            )
            return found
        with Reported(self.config.env_config):
            rollout = self._roll(num_timesteps, num_episodes, explore, random_actions, force_reset)
        self._count(rollout)
        episodes = self._sampler.environment.simulation.episodes  # type: ignore[union-attr]
        names = [
            f"{self._seed_of_slots:x}-{self._slot + piece.env}-{piece.episode if piece.over else episodes[piece.env]}"
            for piece in rollout.pieces
        ]
        return self._episodes(rollout, names)

    def _roll(self, steps: int | None, episodes: int | None, explore: bool, random: bool, force: bool) -> Rollout:
        if self._sampler is None:
            self._sampler = Sampler(
                self.env.team,
                self.seats,
                lambda policy, rows: PolicyNet(self._module_of(policy), rows, self._device),  # type: ignore[attr-defined]
                seed=self._seed_of_slots,
                first_slot=self._slot,
            )
        lifetime = self.num_env_steps_sampled_lifetime  # type: ignore[attr-defined]
        if steps is None:
            self._needs_initial_reset = True
            return self._sampler.roll_episodes(episodes or 0, explore, random, lifetime)
        if force or self._needs_initial_reset:
            self._sampler.reset()
            self._needs_initial_reset = False
        return self._sampler.roll(-(-steps // self.num_envs), explore, random, lifetime)

    def _count(self, rollout: Rollout) -> None:
        """Log the steps and the episodes of a sample."""
        sampler = self._sampler
        assert sampler is not None, "sampled before"
        steps = sum(piece.stop - piece.start for piece in rollout.pieces)
        by_agent = [sum(piece.spans[index].length for piece in rollout.pieces) for index in range(len(self.seats))]
        ended = len(sampler.reports)
        self._done += sampler.reports
        sampler.reports = []
        for now, ever, count, names in (
            (NUM_ENV_STEPS_SAMPLED, NUM_ENV_STEPS_SAMPLED_LIFETIME, steps, ()),
            (NUM_EPISODES, NUM_EPISODES_LIFETIME, ended, ()),
        ):
            self.metrics.log_value((now, *names), count, reduce="sum")
            more = {"with_throughput": True} if ever == NUM_ENV_STEPS_SAMPLED_LIFETIME else {}
            self.metrics.log_value((ever, *names), count, reduce="lifetime_sum", **more)
        for seat, count in zip(self.seats, by_agent, strict=True):
            agent = seat.agent if self.several else DEFAULT_MODULE_ID  # RLlib's name of a single agent, too
            for key, name in ((NUM_AGENT_STEPS_SAMPLED, agent), (NUM_MODULE_STEPS_SAMPLED, seat.policy)):
                self.metrics.log_value((key, name), count, reduce="sum")
            for key, name in (
                (NUM_AGENT_STEPS_SAMPLED_LIFETIME, agent),
                (NUM_MODULE_STEPS_SAMPLED_LIFETIME, seat.policy),
            ):
                self.metrics.log_value((key, name), count, reduce="lifetime_sum")
        if steps:
            self._log_env_steps(metric=self._metrics_num_env_steps_sampled, num_steps=steps)  # type: ignore[attr-defined]

    def get_metrics(self) -> Any:
        """Return what was logged since the last call."""
        if self._stock or self.env is None:
            return super().get_metrics()  # type: ignore[misc]
        if self._done:
            self._log_episodes(self._done)
            log_reports(self.metrics, self.config, self._done)
            self._done = []
        return self.metrics.reduce()

    def _log_episodes(self, reports: list[Report]) -> None:
        """Log returns and lengths under RLlib's own names."""
        logger, window = self.metrics, window_of(self.config)
        recent = reports[-window:]
        for what in ("return", "len"):
            values = [report["length" if what == "len" else what] for report in recent]
            logger.log_value(f"episode_{what}_mean", _mean(values), reduce="mean", window=window)
            logger.log_value(f"episode_{what}_min", min(values), reduce="min", window=window)
            logger.log_value(f"episode_{what}_max", max(values), reduce="max", window=window)
        if not self.several:
            returns = _mean([report["return"] for report in recent])
            for key in ("agent_episode_return_mean", "module_episode_return_mean"):
                name = DEFAULT_MODULE_ID
                logger.log_value((key, name), returns, reduce="mean", window=window)
            return
        for policy, agents in crews(self.seats).items():
            total = 0.0
            for agent in agents:
                returns = _mean([_of(report, agent, "return") for report in recent])
                length = _mean([_of(report, agent, "length") for report in recent])
                logger.log_value(("agent_episode_returns_mean", agent), returns, reduce="mean", window=window)
                logger.log_value(("agent_steps", agent), length, reduce="mean", window=window)
                total += returns
            logger.log_value(("module_episode_returns_mean", policy), total, reduce="mean", window=window)

    def assert_healthy(self) -> None:
        """Check that environments and policies were built."""
        assert self.env is not None
        assert self.module is not None

    def _module_of(self, policy: str) -> Any:
        raise NotImplementedError

    def _episodes(self, rollout: Rollout, names: list[str]) -> list[Any]:
        raise NotImplementedError


class BatchedEnvRunner(_Batched, SingleAgentEnvRunner):  # type: ignore[misc]
    """Samples one agent in N environments."""

    several = False

    def _module_of(self, policy: str) -> Any:
        return self.module

    def _episodes(self, rollout: Rollout, names: list[str]) -> list[Any]:
        (seat,) = self.seats
        return single_agent_episodes(rollout, seat, self.env.by_agent[seat.agent], names, self._weights_seq_no)


class BatchedTeamRunner(_Batched, MultiAgentEnvRunner):  # type: ignore[misc]
    """Samples several agents in N environments."""

    several = True

    def _module_of(self, policy: str) -> Any:
        return self.module[policy]

    def _episodes(self, rollout: Rollout, names: list[str]) -> list[Any]:
        trained = self.config.policies_to_train
        seats = [seat for seat in self.seats if trained is None or seat.policy in trained]
        return multi_agent_episodes(
            rollout, seats, self.env.by_agent, names, self._weights_seq_no, self.config.policy_mapping_fn
        )


def _mean(values: list[float]) -> float:
    return math.fsum(values) / len(values)


def _of(report: Report, agent: str, name: str) -> float:
    return report.get(f"agents/{agent}/{name}", report[name])
