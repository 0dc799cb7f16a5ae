"""Base classes of the glues that keep a deputy safe, and of the filters that act on all deputies together."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal

import numpy as np

from safe_inspect.dynamics.cwh import propagate, transition
from safe_inspect.glues.base import ActionGlue, Bounds, Parts
from safe_inspect.plugins.functor import functor_field
from safe_inspect.plugins.plugin import Plugin
from safe_inspect.simulators.state import ArraySpec, State
from safe_inspect.simulators.team import TeamView
from safe_inspect.simulators.view import FilterResult, View
from safe_inspect.simulators.world import World
from safe_inspect.types import AnyArray, BoolArray, FloatArray


class Safety(Plugin):
    """What the safety glue of an agent and the filter of a team have in common.

    Class attributes:
        dynamics: Registered names of the dynamics for which the filter gives its guarantee; empty: not checked.
        components: Registered names of the components that the simulator must have.

    Attributes:
        enabled: Whether the thrust is filtered. If False, the filter costs nothing.
        undeclared: What happens if components or dynamics declare no `disturbance_bounds` while the filter is enabled:
            ``error`` rejects the experiment, ``warn`` runs it without a guarantee, with a warning that names them.
    """

    dynamics: ClassVar[tuple[str, ...]] = ()
    components: ClassVar[tuple[str, ...]] = ()

    enabled: bool = False
    undeclared: Literal["error", "warn"] = "error"

    @abstractmethod
    def refusals(self, states: Mapping[str, FloatArray]) -> dict[str, BoolArray]:
        """Return, for each constraint, the mask of the initial states that it rejects, shape (R,).

        Args:
            states: Named states, such as ``position`` [m] and ``velocity`` [m/s], shape (R, 3), or (R, D, 3) for a
                team, and ``sun_angle`` [rad] (R,). D may be smaller than the number of deputies while the deputies of
                a team are sampled one by one.
        """

    @abstractmethod
    def safety(self, states: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
        """Return, for each constraint, its least safety quantity phi, >= 0 where the state is safe, shape (R,).

        Args:
            states: As in `refusals`.
        """

    def memory(self, world: World) -> Mapping[str, ArraySpec]:
        """Declare the arrays that the filter stores between steps, with the shape for one agent, or for one team."""
        return {}


class SafetyGlue(Safety, ActionGlue):
    """Base class of the safety glues: they wrap the glues of the controllers and filter the thrust that these command.

    Class attributes:
        tests: Names of the states that `refusals` reads.

    Attributes:
        wrapped: The glues of the controllers.
    """

    tests: ClassVar[tuple[str, ...]] = ("position", "velocity", "sun_angle")

    wrapped: tuple[functor_field("glue"), ...] = ()  # type: ignore[valid-type]

    def leaves(self) -> tuple[ActionGlue, ...]:
        """Return the glues that command a controller."""
        return tuple(leaf for glue in self.wrapped for leaf in glue.leaves())

    def names(self, parts: Parts) -> tuple[str, ...]:
        """Return the names of the wrapped glues' elements."""
        return tuple(name for glue in self.wrapped for name in glue.names(parts))

    def bounds(self, parts: Parts) -> Bounds:
        """Return the bounds of the wrapped glues' elements."""
        bounds = [glue.bounds(parts) for glue in self.wrapped]
        low, high = (np.concatenate([np.empty(0), *(bound[side] for bound in bounds)]) for side in (0, 1))
        return low, high

    def __call__(self, action: FloatArray, parts: Parts) -> FloatArray:
        """Return the thrust that the wrapped glues command [N], Hill frame, shape (R, 3)."""
        thrust = np.zeros((len(action), 3))
        first = 0
        for glue in self.wrapped:
            size = len(glue.names(parts))
            thrust += glue(action[:, first : first + size], parts)
            first += size
        return thrust

    @property
    def units(self) -> Mapping[str, str]:
        """Unit of what `safety` returns for each constraint; dimensionless for constraints that are not listed."""
        return {}

    @abstractmethod
    def filter(self, desired: FloatArray, view: View) -> FilterResult:
        """Return the thrust to hold during the next step, and the new values of declared arrays.

        Args:
            desired: Desired thrust [N], Hill frame, shape (R, 3).
            view: The state at the start of the step.
        """

    def states(self, state: State) -> dict[str, FloatArray]:
        """Return the states of the first deputy that `safety` takes, by name, (N, ...)."""
        sun = {"sun_angle": state.sun_angle} if "sun_angle" in state.arrays else {}
        return {"position": state.position[:, 0], "velocity": state.velocity[:, 0], **sun}

    def states_within(self, before: State, world: World, control: FloatArray, time: float) -> dict[str, FloatArray]:
        """Return the states that `safety` takes at a time after the start of a hold, in Clohessy-Wiltshire motion.

        Args:
            before: The state at the start of the hold.
            world: The constants.
            control: Thrust of the first deputy that is held [N], Hill frame, shape (N, 3).
            time: The time [s].
        """
        states = {name: array.copy() for name, array in self.states(before).items()}
        position, velocity, acceleration = states["position"], states["velocity"], control / world.masses[0]
        phi, gamma = transition(world.mean_motion, 1.0, time)
        propagate(position, velocity, acceleration, phi, gamma, position, velocity)
        if "sun_angle" in states:
            states["sun_angle"] += time * world.sun_rate
        return states

    def for_starts(self) -> SafetyGlue:
        """Return the glue that tests initial states if this one is enabled."""
        return self


def seen_motion(view: View | TeamView, offered: Mapping[str, Any]) -> tuple[FloatArray, FloatArray]:
    """Return positions [m] and velocities [m/s], or their estimates if these are offered, Hill frame, (..., 3) each."""
    if "estimated_position" in offered:
        return view.estimated_position, view.estimated_velocity
    return view.position, view.velocity


@dataclass(frozen=True, eq=False)
class TeamFiltered:
    """Effect of a team's safety filter on the thrusts of a step.

    Attributes:
        control: Thrust to hold [N], Hill frame, shape (N, D, 3).
        intervening: Deputies whose thrust was changed by more than 0.01 N, shape (N, D).
        infeasible: Environments in which the filter can guarantee nothing, shape (N,).
        backup: Environments in which a backup plan was applied, shape (N,).
        memory: New values of the arrays that the filter has declared, each of shape (N, ...).
    """

    control: FloatArray
    intervening: BoolArray
    infeasible: BoolArray
    backup: BoolArray
    memory: Mapping[str, AnyArray] = field(default_factory=dict)


class TeamSafety(Safety):
    """Base class of the filters that keep the deputies of a team safe: from the chief, and from each other.

    The key ``rta`` of environment.yml configures one.

    Attributes:
        enabled: Whether the thrusts are filtered. If False, the filter costs nothing.
    """

    kind: ClassVar[str] = "rta"

    enabled: bool = True

    @abstractmethod
    def __call__(self, desired: FloatArray, team: TeamView) -> TeamFiltered:
        """Return the thrusts to hold during the next step.

        Args:
            desired: Desired thrust of each deputy [N], Hill frame, shape (N, D, 3).
            team: The state at the start of the step. The desired thrusts of finished deputies have no meaning, but the
                returned ones are applied: return zeros if they should coast.
        """
