"""Base of the glues that keep a deputy safe."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar, Literal

import numpy as np

from safe_inspect.glues.base import ActionGlue, Bounds, Parts
from safe_inspect.plugins.functor import functor_field
from safe_inspect.simulators.filter_result import FilterResult
from safe_inspect.simulators.state import ArraySpec
from safe_inspect.simulators.view import View
from safe_inspect.simulators.world import World
from safe_inspect.types import AnyArray, BoolArray, FloatArray


@dataclass(frozen=True, eq=False)
class Filtered:
    """What a safety glue does to the thrust of a step.

    Attributes:
        result: The filter's result for the R rows.
        memory: New values of the arrays that the glue has declared, each of shape (R, ...).
    """

    result: FilterResult
    memory: Mapping[str, AnyArray] = field(default_factory=dict)


class SafetyGlue(ActionGlue):
    """Wraps the glues of the controllers, knows which states are safe and keeps the deputy in them.

    Class attributes:
        tests: Names of the states that `refusals` reads.

    Attributes:
        enabled: True: the thrust is filtered. False: the glue costs nothing.
        invalid_actions: What an action that is NaN or infinite does where the filter is enabled: ``error`` stops the
            run, ``backup`` flies the filter's `backup` in that row; infos and evaluations tell of it.
        undeclared: What components and dynamics that declare no `disturbance_bounds` do where the filter is enabled:
            ``error`` refuses the experiment, ``warn`` flies it with a warning that names them, without a promise.
        wrapped: The glues of the controllers.
    """

    tests: ClassVar[tuple[str, ...]] = ("position", "velocity", "sun_angle")

    enabled: bool = False
    invalid_actions: Literal["error", "backup"] = "error"
    undeclared: Literal["error", "warn"] = "error"
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
        """Return the thrust that the wrapped glues ask for [N], Hill frame, shape (R, 3)."""
        thrust = np.zeros((len(action), 3))
        first = 0
        for glue in self.wrapped:
            size = len(glue.names(parts))
            thrust += glue(action[:, first : first + size], parts)
            first += size
        return thrust

    @property
    def units(self) -> Mapping[str, str]:
        """Unit of what `safety` returns for each constraint; dimensionless where none is given."""
        return {}

    @abstractmethod
    def refusals(self, states: Mapping[str, FloatArray]) -> dict[str, BoolArray]:
        """Return for each constraint the rows of initial states that it refuses, shape (R,).

        Args:
            states: Named states, such as ``position`` [m] (R, 3), ``velocity`` [m/s] (R, 3), ``sun_angle`` [rad] (R,).
        """

    @abstractmethod
    def safety(self, states: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
        """Return for each constraint its plain safety quantity, at least 0 where the state is safe, shape (R,).

        Args:
            states: As in `refusals`.
        """

    @abstractmethod
    def filter(self, desired: FloatArray, view: View) -> Filtered:
        """Return the thrust to hold in the next step.

        Args:
            desired: Desired thrust [N], Hill frame, shape (R, 3).
            view: The state at the beginning of the step.
        """

    def backup(self, view: View) -> FloatArray:
        """Return the thrust to ask for where an action is invalid [N], Hill frame, shape (R, 3); zero by default."""
        return np.zeros((view.num_rows, 3))

    def memory(self, world: World) -> Mapping[str, ArraySpec]:
        """Declare the arrays that the filter remembers, each with its shape for one agent. None by default."""
        return {}

    def for_starts(self) -> SafetyGlue:
        """Return the glue that tests initial states when this one is enabled."""
        return self


def seen_motion(view: View) -> tuple[FloatArray, FloatArray]:
    """Return the positions [m] and velocities [m/s] that deputies take for theirs, Hill frame, shape (R, 3) each."""
    if "estimated_position" in view.world.offers.view:
        return view.estimated_position, view.estimated_velocity
    return view.position, view.velocity
