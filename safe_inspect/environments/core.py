"""`BatchedEnvironment`: N environments whose controlled agents form one group, as plain arrays."""

from __future__ import annotations

from safe_inspect.config.spec import EnvironmentSpec
from safe_inspect.environments.group import AgentGroup
from safe_inspect.environments.team import TeamEnvironment
from safe_inspect.environments.transition import Transition
from safe_inspect.errors import SafeInspectError
from safe_inspect.simulators import State, View
from safe_inspect.types import AnyArray, IntArray


class BatchedEnvironment:
    """N environments with one group of G equal controlled agents: a single deputy, or several equal ones.

    Controlled agents are those whose actions the caller gives. The class is a `TeamEnvironment` whose arrays are not
    wrapped in tuples. SI units, Hill's frame.

    Args:
        spec: The task.
        num_envs: Number of environments, N.
        seed: Seed of the run; default: the seed of the task (the environments for Gymnasium and PettingZoo draw a fresh
            seed instead).
        first_slot: Global index of the first environment slot. Environments with the same seed and slot produce the
            same episodes, whatever batch they are part of.

    Attributes:
        agents: The group of the controlled agents.
        num_envs: Number of environments, N.
        simulation: The simulation.
        observation_layout: Layout of the observation of one agent.
        action_layout: Layout of the action of one agent.

    Raises:
        ValueError: The controlled agents do not form one group.
    """

    def __init__(
        self, spec: EnvironmentSpec, num_envs: int = 1, *, seed: int | None = None, first_slot: int = 0
    ) -> None:
        self.team = TeamEnvironment(spec, num_envs, seed=seed, first_slot=first_slot)
        acting = self.team.acting
        if len(acting) != 1:
            names = ", ".join(group.name for group in acting) or "none"
            raise ValueError(f"all controlled agents must be equal; these differ: {names}; use TeamEnvironment")
        self.spec, self.num_envs, self.simulation = spec, num_envs, self.team.simulation
        self.agents: AgentGroup = acting[0]
        self.observation_layout, self.action_layout = self.agents.observation_layout, self.agents.action_layout
        (self._index,) = self.team.acting_indices

    @property
    def state(self) -> State:
        """The current state."""
        return self.team.state

    def view(self) -> View:
        """Return the current state as seen by the agents."""
        return self.team.view(self._index)

    def reset(self, rows: IntArray | None = None, *, seed: int | None = None) -> AnyArray:
        """Start new episodes; see `TeamEnvironment.reset`.

        Returns:
            First observation of these rows, float32, shape (R, G, O).
        """
        return self.team.reset(rows, seed=seed)[0]

    def step(self, action: AnyArray) -> Transition:
        """Hold an action for one step; see `TeamEnvironment.step`.

        Args:
            action: Action of each agent, shape (N, G, A); clipped to its bounds unless it is discrete.
        """
        return self.team.step((action,)).groups[self._index]


def require_one_agent(spec: EnvironmentSpec, taker: str, instead: str) -> None:
    """Raise an error unless exactly one agent is controlled by the caller.

    Args:
        spec: The task.
        taker: Name of the environment class, which accepts a single agent.
        instead: Name of the function that accepts any number of agents.

    Raises:
        SafeInspectError: No agent or several agents are controlled.
    """
    names = [agent.name for agent in spec.controlled]
    if len(names) != 1:
        listed = ", ".join(names[:4]) + (", ..." if len(names) > 4 else "") or "none"
        raise SafeInspectError(
            f"{taker} takes one controlled agent, but this task has {len(names)} ({listed}); "
            f"use safe_inspect.environments.{instead}"
        )
