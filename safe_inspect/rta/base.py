"""Base of the glues that keep a deputy safe."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import ClassVar

from safe_inspect.functor import functor_field
from safe_inspect.glues.base import ActionGlue
from safe_inspect.types import BoolArray, FloatArray


class SafetyGlue(ActionGlue):
    """Wraps the glues of the controllers and knows which states are safe.

    Class attributes:
        tests: Names of the states that `refusals` reads.

    Attributes:
        enabled: True: the thrust is filtered. False: the glue costs nothing.
        wrapped: The glues of the controllers.
    """

    tests: ClassVar[tuple[str, ...]] = ("position", "velocity", "sun_angle")

    enabled: bool = False
    wrapped: tuple[functor_field("glue"), ...] = ()  # type: ignore[valid-type]

    def leaves(self) -> tuple[ActionGlue, ...]:
        """Return the glues that command a controller."""
        return tuple(leaf for glue in self.wrapped for leaf in glue.leaves())

    @abstractmethod
    def refusals(self, states: Mapping[str, FloatArray]) -> dict[str, BoolArray]:
        """Return for each constraint the rows of initial states that it refuses, shape (R,).

        Args:
            states: Named states, such as ``position`` [m] (R, 3), ``velocity`` [m/s] (R, 3), ``sun_angle`` [rad] (R,).
        """
