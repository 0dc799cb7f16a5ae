"""`TrainingEnv`: the batched environment of one agent for RLlib's stock runner.

RLlib passes the number of environments to a registered creator, but not the index of the runner. So a callback later
assigns the slots of the runner to the environment.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from gymnasium.vector import VectorEnv as _VectorEnv
from gymnasium.vector.utils import batch_space

from safe_inspect.environments.accumulator import EpisodeAccumulator
from safe_inspect.environments.facades.flat_actions import flat_space, from_flat
from safe_inspect.environments.facades.spaces import action_space, box
from safe_inspect.errors import SafeInspectError
from safe_inspect.experiments.sampling.environment import Reported, build_team, first_slot, require_steps
from safe_inspect.experiments.sampling.episode_reports import EpisodeReport, episode_reports
from safe_inspect.types import AnyArray, BoolArray


class TrainingEnv(_VectorEnv[Any, Any, Any]):
    """N environments with one controlled agent; an environment that has ended is reset in the next step.

    Args:
        config: RLlib's environment configuration, see `environment_settings` in `algorithm`.
        num_envs: Number of environments.

    Attributes:
        reports: Reports of the episodes that ended in the last step, by environment.
    """

    def __init__(self, config: Mapping[str, Any], num_envs: int) -> None:
        self._config = dict(config)
        self.num_envs = num_envs
        self.metadata = {"autoreset_mode": AutoresetMode.NEXT_STEP}
        self._where = (0, False)
        self._build()
        acting = [agent for group in self.team.acting for agent in group.agents]
        if len(acting) != 1:
            raise SafeInspectError(f"this environment has one controlled agent, not {', '.join(acting)}")
        group = self.team.acting[0]
        self.single_observation_space = box(group.observation_layout)
        self._choices = group.action_layout.choices if self._config.get("flat_actions") else ()
        self.single_action_space = flat_space(self._choices) if self._choices else action_space(group.action_layout)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)

    def place(self, worker_index: int, evaluation: bool) -> None:
        """Assign the slots of a runner to the environments; must be called before the first reset."""
        where = (first_slot(worker_index, self.num_envs), evaluation)
        if where != self._where:
            self._where = where
            self._build()

    def _build(self) -> None:
        self.team = build_team(self._config, self.num_envs, *self._where)
        require_steps(self.team)
        self._group = self.team.groups.index(self.team.acting[0]) if self.team.acting else 0
        self._sums = EpisodeAccumulator(self.team)
        self._ended: BoolArray = np.zeros(self.num_envs, dtype=np.bool_)
        self.reports: dict[int, EpisodeReport] = {}

    def reset(self, *, seed: Any = None, options: dict[str, Any] | None = None) -> tuple[AnyArray, dict[str, Any]]:
        """Start a new episode in every slot.

        RLlib's seed is not used: the episodes are functions of the run's seed, the slot and the number of the episode.
        """
        with Reported(self._config):
            observations = self.team.reset()[0][:, 0].copy()
        self._sums.restart(np.arange(self.num_envs))
        self._ended[:] = False
        return observations, {}

    def step(self, actions: AnyArray) -> tuple[AnyArray, AnyArray, BoolArray, BoolArray, dict[str, Any]]:
        """Take a step; environments that ended in the last step are reset instead."""
        again = np.flatnonzero(self._ended)
        if self._choices:
            actions = from_flat(actions, self._choices)
        with Reported(self._config):
            transition = self.team.step([np.where(self._ended[:, None], 0.0, actions)[:, None]])
            self._sums.add(transition)
            found = transition.groups[self._group]
            observations, rewards = found.observation[:, 0].copy(), found.reward[:, 0].copy()
            terminated, truncated = found.terminated[:, 0].copy(), found.truncated[:, 0].copy()
            if len(again):
                self._sums.restart(again)
                observations[again] = self.team.reset(again)[0][:, 0]
                rewards[again], terminated[again], truncated[again] = 0.0, False, False
        self._ended = terminated | truncated
        rows = np.flatnonzero(self._ended)
        self.reports = dict(zip(rows.tolist(), episode_reports(self.team, self._sums, rows, transition), strict=True))
        return observations, rewards, terminated, truncated, {}

    def report(self, index: int) -> EpisodeReport | None:
        """Return the report of the episode that ended in the last step; None if it has not ended."""
        return self.reports.get(index)
