"""`Simulator`: the configuration of a simulation, a named composition of dynamics and components."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import ClassVar

from pydantic import Field, field_validator

from safe_inspect.dynamics.base import Dynamics
from safe_inspect.dynamics.clohessy_wiltshire import ClohessyWiltshire
from safe_inspect.plugins.functor import functor_field, functors_field
from safe_inspect.plugins.plugin import Plugin
from safe_inspect.simulators.component import Component, require_different
from safe_inspect.simulators.protocols import DeclaresMemory
from safe_inspect.simulators.resets.plan import ResetPlan
from safe_inspect.simulators.simulation import Simulation
from safe_inspect.simulators.view import Group


class Simulator(Plugin):
    """Composition of dynamics and the components of a task. Calling it returns a running simulation.

    Attributes:
        decimation: Number of physics steps in a step of the agents.
        disturbance: A component, or a list of components, that disturb the motion, the thrust or the estimated states,
            such as `BoundedDisturbance` and `ThrusterModel`; they are called before those of the task, in this order.
            None: the motion is exactly that of the dynamics.
    """

    kind: ClassVar[str] = "simulator"

    decimation: int = Field(default=1, ge=1)
    disturbance: functors_field("component") = ()  # type: ignore[valid-type]

    @field_validator("disturbance")
    @classmethod
    def _different(cls, components: tuple[Component, ...]) -> tuple[Component, ...]:
        require_different(components)
        return components

    @abstractmethod
    def compose(self) -> tuple[Dynamics, Sequence[Component]]:
        """Return the dynamics, and the components in the order in which they are called after a step."""

    def with_attitude(self) -> Simulator:
        """Return the simulator for platforms that turn.

        Raises:
            ValueError: There is no such simulator.
        """
        raise ValueError(f"{self.registered_name} simulates point masses; platforms that turn need another simulator")

    @property
    def attitude_field(self) -> str:
        """Name of a field that is set but only has a meaning for platforms that turn; empty if there is none."""
        return ""

    @property
    def turns(self) -> bool:
        """Whether the deputies have an attitude."""
        return "orientation" in self.compose()[0].arrays

    def __call__(
        self,
        *,
        masses: Mapping[str, float],
        groups: Sequence[Group],
        reset: ResetPlan,
        step_size: float,
        num_envs: int,
        seed: int,
        first_slot: int,
        team_filter: DeclaresMemory | None = None,
    ) -> Simulation:
        """Build the running simulation of `num_envs` environments.

        Args:
            masses: Mass of each deputy [kg], by platform, in agent order.
            groups: Groups of agents.
            reset: Plan of the initial states.
            step_size: Length of a step [s].
            num_envs: Number of environments, N.
            seed: Seed of the run.
            first_slot: Global index of the first environment slot.
            team_filter: Safety filter of all deputies together, which may declare memory, if there is one.
        """
        dynamics, components = self.compose()
        return Simulation(
            dynamics,
            (*self.disturbance, *components),
            masses=masses,
            groups=groups,
            reset=reset,
            step_size=step_size,
            decimation=self.decimation,
            num_envs=num_envs,
            seed=seed,
            first_slot=first_slot,
            team_filter=team_filter,
        )


class ComposedSimulator(Simulator):
    """Simulator with dynamics and components that the configuration selects.

    Attributes:
        dynamics: Dynamics of the bodies.
        components: Components of the task, in the order in which they are called after a step.
    """

    dynamics: functor_field("dynamics") = ClohessyWiltshire()  # type: ignore[valid-type]
    components: tuple[functor_field("component"), ...] = ()  # type: ignore[valid-type]

    def compose(self) -> tuple[Dynamics, Sequence[Component]]:
        """Return the dynamics and the components."""
        return self.dynamics, self.components
