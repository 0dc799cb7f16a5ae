"""A wall that the deputy must not pass."""

from typing import ClassVar, Self

import numpy as np
from pydantic import model_validator

from safe_inspect.rta.constraints import ConstraintParameters, ConstraintValues
from safe_inspect.rta.constraints.base import Constraint
from safe_inspect.units import quantity

#: Distance [m] below which the slope of the square root, infinite at zero, is taken there.
_FLOOR = 1e-6


class Wall(Constraint):
    """Stay on this side of a plane: phi = offset - n . p [m], h = sqrt(2 a phi) - n . v [m/s].

    Behind the plane the root is -sqrt(2 a |phi|).

    Attributes:
        normal: Unit vector n across the wall, away from the allowed side, Hill frame [-].
        offset: Largest n . p [m].
        max_acceleration: Deceleration a that the thrusters can promise [m/s^2].
    """

    unit: ClassVar[str] = "m"

    normal: tuple[float, float, float] = (0.0, 1.0, 0.0)
    offset: quantity("m") = 60.0
    max_acceleration: quantity("m/s^2", gt=0) = 0.05

    @model_validator(mode="after")
    def _unit(self) -> Self:
        if abs(sum(n * n for n in self.normal) - 1.0) > 1e-6:
            raise ValueError(f"`normal` is a unit vector, not {self.normal}")
        return self

    @classmethod
    def from_parameters(cls, parameters: ConstraintParameters) -> Self:
        """Return the constraint for a task's parameters."""
        return cls(max_acceleration=parameters.max_acceleration)

    def evaluate(self, state):
        """Return phi [m], h [m/s] and the derivatives of h."""
        n = np.array(self.normal)
        phi = self.offset - (state.position * n).sum(axis=1)
        out = ConstraintValues.zeros(len(state))
        out.phi[:] = phi
        out.h[:] = np.sign(phi) * np.sqrt(2.0 * self.max_acceleration * np.abs(phi)) - (state.velocity * n).sum(axis=1)
        slope = self.max_acceleration / np.sqrt(2.0 * self.max_acceleration * np.maximum(np.abs(phi), _FLOOR))
        out.gradient[:, :3] = -slope[:, None] * n
        out.gradient[:, 3:] = -n
        return out

    @staticmethod
    def half_space(p, x, d):
        """Write the direction of the states that are allowed, the same everywhere, and return the need."""
        d[0], d[1], d[2] = -p[0], -p[1], -p[2]
        return -p[3]

    def half_space_parameters(self) -> tuple[float, ...]:
        """Return n and the offset."""
        return (*self.normal, self.offset)
