"""Environments for RLlib's stock runners: `TeamMultiAgentEnv` with several agents, and `TrainingEnv` with one.

RLlib passes the number of environments to a registered creator, but not the index of the runner. So a callback later
assigns the slots of the runner to the environments.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from gymnasium.vector import VectorEnv as _VectorEnv
from gymnasium.vector.utils import batch_space
from ray.rllib.env.multi_agent_env import MultiAgentEnv

from safe_inspect.environments.episodes import EpisodeAccumulator
from safe_inspect.environments.facades.spaces import action_space, box, flat_space, from_flat
from safe_inspect.errors import SafeInspectError
from safe_inspect.experiments.sampling.environment import Reported, build_team, first_slot, require_steps
from safe_inspect.experiments.sampling.episode_reports import EpisodeReport, episode_reports
from safe_inspect.experiments.sampling.sampler import AgentSlot, agent_slots
from safe_inspect.types import AnyArray, BoolArray

AgentDict = dict[Any, Any]


class TeamMultiAgentEnv(MultiAgentEnv):
    """One environment, whose controlled agents observe and act in every step until they end.

    An agent that has ended does not appear again until the next reset, while the other agents continue. Use it with
    RLlib as follows:

    ```python
    tune.register_env("inspection", TeamMultiAgentEnv)
    config.environment("inspection", env_config={"cfg": "configs/multiagent-translational-inspection/experiment.yml"})
    ```

    Args:
        config: ``cfg``: the experiment's file, with optional ``overrides``, or ``experiment``: its resolved
            configuration; ``seed``: the seed of the run (default: that of the experiment).
    """

    def __init__(self, config: Mapping[str, Any]) -> None:
        self._config = _resolved(config)
        self._where = (0, False)
        self._build()
        self.possible_agents = [slot.agent for slot in self._agent_slots]
        self.agents = list(self.possible_agents)
        acting = self.team.acting
        self.observation_spaces = {slot.agent: box(acting[slot.group].observation_layout) for slot in self._agent_slots}
        self._flat = bool(self._config.get("flat_actions"))
        layouts = {slot.agent: acting[slot.group].action_layout for slot in self._agent_slots}
        self.action_spaces = {
            agent: flat_space(layout.choices) if self._flat and layout.choices else action_space(layout)
            for agent, layout in layouts.items()
        }
        super().__init__()  # type: ignore[no-untyped-call]

    def place(self, worker_index: int, num_envs: int, index: int, evaluation: bool) -> None:
        """Assign a slot of a runner to the environment; must be called before the first reset.

        Args:
            worker_index: Index of the runner.
            num_envs: Number of environments of the runner.
            index: Index of this environment among them.
            evaluation: Whether it is used for the evaluation.
        """
        where = (first_slot(worker_index, num_envs) + index, evaluation)
        if where != self._where:
            self._where = where
            self._build()

    def _build(self) -> None:
        self.team = build_team(self._config, 1, *self._where)
        require_steps(self.team)
        self._agent_slots: tuple[AgentSlot, ...] = agent_slots(self.team)
        self._groups = [self.team.groups.index(group) for group in self.team.acting]
        self._sums = EpisodeAccumulator(self.team)
        self._report: EpisodeReport | None = None

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[AgentDict, AgentDict]:
        """Start a new episode.

        Args:
            seed: Seed of the episodes, only if `config` has ``cfg``; not used in a training, whose episodes are
                functions of the run's seed, the slot and the number of the episode.
            options: Not used.
        """
        self.agents = list(self.possible_agents)
        with Reported(self._config):
            observations = self.team.reset(seed=seed if self._config.get("seeded_by_reset") else None)
        self._sums.restart(np.arange(1))
        return self._by_agent(observations, self.agents), {agent: {} for agent in self.agents}

    def step(  # type: ignore[override]  # Gymnasium's signature is that of one agent
        self, action_dict: Mapping[Any, AnyArray]
    ) -> tuple[AgentDict, AgentDict, AgentDict, AgentDict, AgentDict]:
        """Take a step with the actions of the agents that have not ended; actions are clipped to their bounds."""
        actions = [np.zeros((1, group.size, group.action_layout.size)) for group in self.team.acting]
        for slot in self._agent_slots:
            if slot.agent in self.agents:
                action, choices = action_dict[slot.agent], self.team.acting[slot.group].action_layout.choices
                actions[slot.group][0, slot.member] = from_flat(action, choices) if self._flat and choices else action
        with Reported(self._config):
            transition = self.team.step(actions)
        self._sums.add(transition)
        found = [transition.groups[index] for index in self._groups]
        flying = [slot for slot in self._agent_slots if slot.agent in self.agents]
        observations = self._by_agent([group.observation for group in found], self.agents)
        rewards: AgentDict = {}
        terminated: AgentDict = {}
        truncated: AgentDict = {}
        infos: AgentDict = {}
        for slot in flying:
            agent, group, member = slot.agent, found[slot.group], slot.member
            rewards[agent] = float(group.reward[0, member])
            terminated[agent] = bool(group.terminated[0, member])
            truncated[agent] = bool(group.truncated[0, member])
            infos[agent] = {f"reward/{name}": float(value[0, member]) for name, value in group.terms.items()}
        over = bool(transition.over[0])
        self._report = episode_reports(self.team, self._sums, [0], transition)[0] if over else None
        cut = over and any(truncated.values())
        if cut:
            # RLlib treats an episode as terminated, and does not bootstrap its value, once each agent is reported as
            # done. So agents that are truncated with the whole episode are only included in `__all__`.
            truncated = {agent: False for agent in truncated if not truncated[agent]}
        terminated["__all__"], truncated["__all__"] = over and not cut, cut
        if not over:
            self.agents = [agent for agent in self.agents if not (terminated[agent] or truncated[agent])]
        return observations, rewards, terminated, truncated, infos

    def report(self) -> EpisodeReport | None:
        """Return the report of the episode; None until it has ended."""
        return self._report

    def _by_agent(self, observations: Any, agents: Sequence[Any]) -> AgentDict:
        slots = [slot for slot in self._agent_slots if slot.agent in agents]
        return {slot.agent: observations[slot.group][0, slot.member].copy() for slot in slots}


def _resolved(config: Mapping[str, Any]) -> dict[str, Any]:
    """Return a configuration with the resolved experiment, which is read from ``cfg`` if necessary."""
    rest = dict(config)
    if "experiment" not in rest:
        from safe_inspect.config.experiment import load_experiment

        experiment = load_experiment(rest.pop("cfg"), rest.pop("overrides", ()))
        rest = {"seed": experiment.spec.seed, "seeded_by_reset": True} | rest | {"experiment": experiment.resolved}
    return rest


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
