"""The environments of RLlib's runners: makers, seeds and slots, and the environments of the stock runners.

A runner w has M environments in the global slots (w - 1) M to w M - 1. An episode is a function of the seed, its slot
and its number within the slot, so it does not matter which runner executes it. RLlib passes the number of environments
to a registered creator, but not the index of the runner. So a callback later assigns the slots of the runner to the
environments `TeamMultiAgentEnv` of several agents and `TrainingEnv` of one.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from gymnasium.vector import AutoresetMode
from gymnasium.vector import VectorEnv as _VectorEnv
from gymnasium.vector.utils import batch_space
from ray.rllib.env.multi_agent_env import MultiAgentEnv

from safe_inspect.environments.episodes import EpisodeAccumulator
from safe_inspect.environments.facades.spaces import AgentsByName, action_space, box, flat_space, from_flat
from safe_inspect.environments.finite_checks import CRASH_FOLDER_VARIABLE
from safe_inspect.environments.group import AgentGroup
from safe_inspect.environments.registration import build_spec
from safe_inspect.environments.team import TeamEnvironment
from safe_inspect.environments.transition import TeamTransition
from safe_inspect.errors import SafeInspectError
from safe_inspect.experiments.sampling.sampler import EpisodeReport, episode_reports
from safe_inspect.experiments.settings.policies import DEFAULT_MAKER, experiment_in
from safe_inspect.outputs import new_file
from safe_inspect.plugins.registry import import_user_module
from safe_inspect.random.splitmix import mix
from safe_inspect.types import AnyArray, BoolArray, IntArray

#: Function that builds environments from the resolved configuration, their number, the seed and the first slot.
EnvironmentMaker: TypeAlias = Callable[[Mapping[str, Any], int, int, int], TeamEnvironment]

AgentDict = dict[Any, Any]


def first_slot(worker_index: int, num_envs: int) -> int:
    """Return the global index of a runner's first environment slot.

    Remote runners count from 1, and runner w has the slots (w - 1) M to w M - 1. A local runner, which samples only if
    there is no remote runner, has the first slots.
    """
    return max(worker_index - 1, 0) * num_envs


def stream_seed(seed: int, attempt: int, evaluation: bool) -> int:
    """Return the seed of the environments, 0 to 2**64 - 1.

    The first attempt trains with the seed of the run. The episodes of the evaluation and of a resumed run, whose slots
    count their episodes from 0 again, use other seeds.
    """
    number = 2 * attempt + int(evaluation)
    if number == 0:
        return seed % 2**64
    # Mixed, so that neighbouring runs do not share seeds.
    return int(mix(np.uint64((seed + number * 0x9E3779B97F4A7C15) % 2**64)))


def seed_of(config: Mapping[str, Any], evaluation: bool) -> int:
    """Return the seed of a runner's environments and actions, from RLlib's environment configuration."""
    return stream_seed(int(config.get("seed") or 0), int(config.get("attempt", 0)), evaluation)


def build_team(config: Mapping[str, Any], num_envs: int, slot: int, evaluation: bool) -> TeamEnvironment:
    """Build the environments of a runner.

    Args:
        config: RLlib's environment configuration, see `environment_settings`.
        num_envs: Number of environments.
        slot: Global index of the first environment slot.
        evaluation: Whether they are used for the evaluation.
    """
    path = config.get("maker", DEFAULT_MAKER)
    module, _, function = path.partition(":")
    maker: EnvironmentMaker | None = getattr(import_user_module(module), function) if path else None
    experiment, seed = experiment_in(config), seed_of(config, evaluation)
    with reported(config):
        if maker is None:
            return TeamEnvironment(build_spec(experiment), num_envs, seed=seed, first_slot=slot)
        return maker(experiment, num_envs, seed, slot)


@contextmanager
def reported(config: Mapping[str, Any]) -> Iterator[None]:
    """Write a user's error within a context to a file, because RLlib's remote runners end without passing it on.

    The states that caused the error are saved in the folder of that file, unless the user names another folder.

    Args:
        config: RLlib's environment configuration, whose `failure_file` names the file.
    """
    file: Any = config.get("failure_file")
    names_folder = file is not None and CRASH_FOLDER_VARIABLE not in os.environ
    if names_folder:
        os.environ[CRASH_FOLDER_VARIABLE] = str(Path(file).parent)
    try:
        yield
    except SafeInspectError as error:
        if file is not None:
            with new_file(file) as work:  # several runners may fail at once
                work.write_text(json.dumps({"error": type(error).__name__, "message": str(error)}), encoding="utf-8")
        raise
    finally:
        if names_folder:
            del os.environ[CRASH_FOLDER_VARIABLE]


class _StockEnvironment:
    """Common part of the environments of RLlib's stock runners.

    Args:
        config: RLlib's environment configuration, see `environment_settings`.
        num_envs: Number of environments.

    Attributes:
        reports: Reports of the episodes that ended in the last step, by environment.

    Raises:
        SafeInspectError: Decisions last several control steps.
    """

    def __init__(self, config: Mapping[str, Any], num_envs: int) -> None:
        self._config, self.num_envs = config, num_envs
        self._build(0, False)

    def _build(self, slot: int, evaluation: bool) -> None:
        self._place = slot, evaluation
        self.team = build_team(self._config, self.num_envs, slot, evaluation)
        if self.team.decides:
            raise SafeInspectError(
                "decisions that last several steps (CoastGlue) need the batched runner; remove the keys that select "
                "RLlib's stock runner, such as `env_runner: stock`"
            )
        self._sums = EpisodeAccumulator(self.team)
        self.reports: dict[int, EpisodeReport] = {}

    def place(self, slot: int, evaluation: bool) -> None:
        """Assign the slots from a global index on, for an evaluation or not; must be called before the first reset."""
        if (slot, evaluation) != self._place:
            self._build(slot, evaluation)

    def _restart(self) -> Sequence[AnyArray]:
        """Start a new episode in every slot; return the observations of each acting group."""
        with reported(self._config):
            observations = self.team.reset()
        self._sums.restart(np.arange(self.num_envs))
        self.reports = {}
        return observations

    def _choices(self, group: AgentGroup) -> tuple[int, ...]:
        """Return the numbers of levels if RLlib's algorithm needs one index of their combination; empty otherwise."""
        return group.action_layout.choices if self._config.get("flat_actions") else ()

    def _action_space(self, group: AgentGroup) -> Any:
        choices = self._choices(group)
        return flat_space(choices) if choices else action_space(group.action_layout)

    def _report(self, rows: IntArray, transition: TeamTransition) -> None:
        reports = episode_reports(self.team, self._sums, rows, transition) if len(rows) else []
        self.reports = dict(zip(rows.tolist(), reports, strict=True))


class TeamMultiAgentEnv(_StockEnvironment, MultiAgentEnv):
    """One environment, whose controlled agents observe and act in every step until they end.

    An agent that has ended does not appear again until the next reset, while the other agents continue.

    Args:
        config: RLlib's environment configuration, see `environment_settings`.
    """

    def __init__(self, config: Mapping[str, Any]) -> None:
        _StockEnvironment.__init__(self, config, 1)
        self._controlled = AgentsByName(self.team)
        self._places: dict[Any, tuple[int, int]] = self._controlled.places
        self.possible_agents, self.agents = list(self._places), list(self._places)
        self.observation_spaces = {agent: self._controlled.observation_spaces[agent] for agent in self._places}
        self.action_spaces = {agent: self._action_space(self.team.acting[i]) for agent, (i, _) in self._places.items()}
        MultiAgentEnv.__init__(self)  # type: ignore[no-untyped-call]

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[AgentDict, AgentDict]:
        """Start a new episode.

        RLlib's seed is not used: the episodes are functions of the run's seed, the slot and the number of the episode.
        """
        self.agents = list(self.possible_agents)
        return self._by_agent(self._restart()), {agent: {} for agent in self.agents}

    def step(  # type: ignore[override]  # Gymnasium's signature is that of one agent
        self, action_dict: Mapping[Any, AnyArray]
    ) -> tuple[AgentDict, AgentDict, AgentDict, AgentDict, AgentDict]:
        """Take a step with the actions of the agents that have not ended; actions are clipped to their bounds."""
        acting = self.team.acting
        actions = [np.zeros((1, group.size, group.action_layout.size)) for group in acting]
        for agent in self.agents:
            (index, member), action = self._places[agent], action_dict[agent]
            choices = self._choices(acting[index])
            actions[index][0, member] = from_flat(action, choices) if choices else action
        with reported(self._config):
            transition = self.team.step(actions)
        self._sums.add(transition)
        found = [transition.groups[index] for index in self.team.acting_indices]
        observations = self._by_agent([group.observation for group in found])
        rewards, terminated, truncated = (
            {agent: value.item() for agent, value in self._by_agent([getattr(group, name) for group in found]).items()}
            for name in ("reward", "terminated", "truncated")
        )
        infos: AgentDict = {agent: {} for agent in self.agents}
        over = bool(transition.over[0])
        self._report(np.flatnonzero(transition.over), transition)
        cut = over and any(truncated.values())
        if cut:
            # RLlib treats an episode as terminated, and does not bootstrap its value, once each agent is reported as
            # done. So agents that are truncated with the whole episode are only included in `__all__`.
            truncated = {agent: False for agent in truncated if not truncated[agent]}
        terminated["__all__"], truncated["__all__"] = over and not cut, cut
        if not over:
            self.agents = [agent for agent in self.agents if not (terminated[agent] or truncated[agent])]
        return observations, rewards, terminated, truncated, infos

    def _by_agent(self, groups: Sequence[AnyArray]) -> AgentDict:
        return {agent: rows[0].copy() for agent, rows in self._controlled.split(groups).items() if agent in self.agents}


class TrainingEnv(_StockEnvironment, _VectorEnv[Any, Any, Any]):
    """N environments with one controlled agent; an environment that has ended is reset in the next step.

    Args:
        config: RLlib's environment configuration, see `environment_settings`.
        num_envs: Number of environments.
    """

    def __init__(self, config: Mapping[str, Any], num_envs: int) -> None:
        super().__init__(config, num_envs)
        self.metadata = {"autoreset_mode": AutoresetMode.NEXT_STEP}
        acting = [agent for group in self.team.acting for agent in group.agents]
        if len(acting) != 1:
            raise SafeInspectError(f"this environment has one controlled agent, not {', '.join(acting)}")
        (group,) = self.team.acting
        self._levels = self._choices(group)
        self.single_observation_space = box(group.observation_layout)
        self.single_action_space = self._action_space(group)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._ended: BoolArray = np.zeros(num_envs, dtype=np.bool_)

    def reset(self, *, seed: Any = None, options: dict[str, Any] | None = None) -> tuple[AnyArray, dict[str, Any]]:
        """Start a new episode in every slot; RLlib's seed is not used, see `TeamMultiAgentEnv.reset`."""
        self._ended[:] = False
        return self._restart()[0][:, 0].copy(), {}

    def step(self, actions: AnyArray) -> tuple[AnyArray, AnyArray, BoolArray, BoolArray, dict[str, Any]]:
        """Take a step; environments that ended in the last step are reset instead."""
        again = np.flatnonzero(self._ended)
        if self._levels:
            actions = from_flat(actions, self._levels)
        with reported(self._config):
            transition = self.team.step([np.where(self._ended[:, None], 0.0, actions)[:, None]])
            self._sums.add(transition)
            found = transition.groups[self.team.acting_indices[0]]
            observations, rewards = found.observation[:, 0].copy(), found.reward[:, 0].copy()
            terminated, truncated = found.terminated[:, 0].copy(), found.truncated[:, 0].copy()
            if len(again):
                self._sums.restart(again)
                observations[again] = self.team.reset(again)[0][:, 0]
                rewards[again], terminated[again], truncated[again] = 0.0, False, False
        self._ended = terminated | truncated
        self._report(np.flatnonzero(self._ended), transition)
        return observations, rewards, terminated, truncated, {}
