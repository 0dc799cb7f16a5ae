"""`InspectionParallelEnv`: façade of one environment as a `pettingzoo.ParallelEnv`."""

from __future__ import annotations

import secrets
from collections.abc import Mapping, Sequence
from typing import Any, TypeAlias, TypeVar

import numpy as np
from gymnasium.spaces import Box, MultiDiscrete
from pettingzoo import ParallelEnv

from safe_inspect.config.spec import EnvironmentSpec
from safe_inspect.environments.decisions import decide
from safe_inspect.environments.episodes import current_infos, info_row, step_info
from safe_inspect.environments.facades.arguments import checked_gamma, checked_slot
from safe_inspect.environments.facades.rendering import RENDER_FPS, RENDER_MODE, Rendered
from safe_inspect.environments.facades.spaces import AgentsByName, checked_actions
from safe_inspect.environments.finite_checks import checked_seed
from safe_inspect.environments.team import TeamEnvironment
from safe_inspect.errors import AgentError, SafeInspectError, did_you_mean
from safe_inspect.types import AnyArray, Observation

Infos: TypeAlias = dict[str, dict[str, Any]]
Space = TypeVar("Space")


class InspectionParallelEnv(Rendered, ParallelEnv[str, Observation, Observation]):  # type: ignore[misc]
    """One environment of one or more agents, for PettingZoo.

    The agents are the controlled ones, whose actions the caller gives; deputies with scripted policies are part of the
    environment. An agent that has ended is removed from `agents`, and its spacecraft continues to fly while other
    agents are active. Infos contain for every agent the values of `InspectionEnv`; ``inspected_count`` and
    ``inspected_fraction`` are the team's, and ``own_inspected_count`` is the agent's share. A safety filter of the
    whole team adds ``rta/intervening``, ``rta/infeasible`` and ``rta/backup``.

    If actions set for how many control steps they hold (`CoastGlue`), a step lasts until an agent needs a new decision
    or ends. Infos then contain ``elapsed_steps``, ``discount`` (gamma^elapsed_steps) and ``decides``: whether the
    agent's next action is used; actions of agents that are coasting have no effect. Rewards are sum gamma^i r_i over
    the control steps.

    Args:
        spec: The task.
        slot: Global index of the environment slot.
        gamma: Discount per control step within a decision.
        render_mode: ``rgb_array``: `render` returns images; None: it raises an error.

    Attributes:
        possible_agents: Names of the agents, in order.
        agents: Names of the agents that act in the next step.
        state_space: Space of `state`.
        np_random_seed: The seed of the episodes; None before the first reset.
    """

    metadata = {  # noqa: RUF012 - as PettingZoo does
        "render_modes": [RENDER_MODE],
        "render_fps": RENDER_FPS,
        "name": "safe_inspect",
        "is_parallelizable": True,
    }

    def __init__(
        self, spec: EnvironmentSpec, *, slot: int = 0, gamma: float = 1.0, render_mode: str | None = None
    ) -> None:
        self._gamma = checked_gamma(gamma)
        self.np_random_seed: int | None = None
        self.core = TeamEnvironment(spec, 1, first_slot=checked_slot(slot, "slot"))
        self._draw_as(render_mode, self.core)
        self._controlled = AgentsByName(self.core)
        self.possible_agents = list(self._controlled.places)
        self.agents: list[str] = []
        self.observation_spaces = self._controlled.observation_spaces
        self.action_spaces = self._controlled.action_spaces
        self._shapes = {agent: space.shape for agent, space in self.action_spaces.items()}
        self.state_space = Box(-np.inf, np.inf, self.state().shape, dtype=np.float32)

    def observation_space(self, agent: str) -> Box:
        """Return the space of an agent's observations; it is always the same object.

        Raises:
            AgentError: There is no controlled agent with that name.
        """
        return _space_of(self.observation_spaces, agent)

    def action_space(self, agent: str) -> Box | MultiDiscrete:
        """Return the space of an agent's actions; it is always the same object.

        Raises:
            AgentError: There is no controlled agent with that name.
        """
        return _space_of(self.action_spaces, agent)

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Observation], Infos]:
        """Start a new episode.

        Args:
            seed: Restart with the first episode of this seed. Without a seed, the next episode of the current seed
                follows; a new environment draws a seed, `np_random_seed`.
            options: Ignored, since there are no options and PettingZoo's own environment test passes one.
        """
        if seed is None and self.np_random_seed is None:
            seed = secrets.randbits(64)
        if seed is not None:
            self.np_random_seed = checked_seed(seed)
        observations = self.core.reset(seed=seed)
        self.agents = list(self.possible_agents)
        if self._view is not None:
            self._view.begin()
        drawn = self.core.simulation.reset_info
        group_infos = current_infos(self.core)
        infos = {
            agent: info_row(group_infos[index], member) | {name: n[0].item() for name, n in drawn.items()}
            for agent, (index, member) in self._controlled.places.items()
        }
        return self._by_agent(observations), infos

    def close(self) -> None:
        """End the episode."""
        self.agents = []

    def step(
        self, actions: dict[str, Observation]
    ) -> tuple[dict[str, Observation], dict[str, float], dict[str, bool], dict[str, bool], Infos]:
        """Hold the actions for one step.

        Args:
            actions: The action of every agent in `agents`, clipped to its bounds unless it is discrete.

        Raises:
            ArgumentError: A discrete action is a fraction or out of range.
            SafeInspectError: The episode has not started or is over for all agents; or an action is missing, has the
                wrong shape, or is for an agent that does not act.
        """
        if not self.agents:
            raise SafeInspectError("the episode has not begun or is over; call reset() first")
        given = checked_actions(actions, self.agents, self._shapes)
        arrays = [np.zeros((1, group.size, group.action_layout.size)) for group in self.core.acting]
        for agent, action in given.items():
            index, member = self._controlled.places[agent]
            arrays[index][0, member] = action
        follow = None if self._view is None else self._view.follow
        decided = decide(self.core, arrays, self._gamma, follow=follow)
        observations = self._by_agent([group.observation for group in decided.groups])
        rewards, terminations, truncations, infos = {}, {}, {}, {}
        for agent in self.agents:
            index, member = self._controlled.places[agent]
            group = decided.groups[index]
            rewards[agent] = float(group.reward[0, member])
            terminations[agent] = bool(group.terminated[0, member])
            truncations[agent] = bool(group.truncated[0, member])
            infos[agent] = step_info(group, decided.infos[index], member)
        self.agents = [agent for agent in self.agents if not (terminations[agent] or truncations[agent])]
        return observations, rewards, terminations, truncations, infos

    def state(self) -> Observation:
        """Return the state of the environment, for a centralised critic, float32.

        It contains, in this order: position [m] and velocity [m/s] of each deputy (x, y, z, Hill's frame), 1 for each
        deputy whose agent has ended, the unit vector to the sun, and 1 for each inspected point.
        """
        team = self.core.team()
        seen = [part for component in team.world.offers.components for part in component.shared_state(team)]
        parts = (team.position, team.velocity, team.finished != 0, *seen)
        return np.concatenate([np.asarray(part, dtype=np.float32).reshape(-1) for part in parts])

    def _by_agent(self, groups: Sequence[AnyArray]) -> dict[str, Observation]:
        return {agent: rows[0] for agent, rows in self._controlled.split(groups).items() if agent in self.agents}


def _space_of(spaces: Mapping[str, Space], agent: str) -> Space:
    """Return the space of an agent.

    Raises:
        AgentError: There is no controlled agent with that name.
    """
    if agent not in spaces:
        raise AgentError(f"there is no controlled agent {agent!r}; {did_you_mean(str(agent), spaces)}")
    return spaces[agent]
