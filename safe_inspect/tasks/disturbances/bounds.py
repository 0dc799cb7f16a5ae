"""`DisturbanceBounds`: how far the real motion may depart from the model, and the estimate from the real state."""

from __future__ import annotations

import math

from pydantic import BaseModel, ConfigDict, Field

from safe_inspect.units import NonNegativeAngle, NonNegativeLength, NonNegativeSpeed

_LARGEST_ANGLE = 0.5 * math.pi


class DisturbanceBounds(BaseModel):
    """Bounds of a disturbance; a bound of 0, the default, is no disturbance.

    Attributes:
        velocity: Length of the velocity that disturbances add in a step [m/s].
        position_error: Distance of the estimated position from the position [m].
        velocity_error: Length of the error of the estimated velocity [m/s].
        thrust_gain: Relative error of the thrust's size [-].
        thrust_direction: Angle between the thrust and the commanded one [rad].
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    velocity: NonNegativeSpeed = 0.0
    position_error: NonNegativeLength = 0.0
    velocity_error: NonNegativeSpeed = 0.0
    thrust_gain: float = Field(default=0.0, ge=0.0, lt=1.0, allow_inf_nan=False)
    thrust_direction: NonNegativeAngle = Field(default=0.0, le=_LARGEST_ANGLE)

    @property
    def bounds(self) -> tuple[float, float, float, float, float]:
        """The bounds, in the order of the fields."""
        return (self.velocity, self.position_error, self.velocity_error, self.thrust_gain, self.thrust_direction)

    @property
    def thrust_error(self) -> float:
        """Largest |flown - commanded| / |commanded| of the thrust [-].

        A thrust of size g at the angle a to the commanded one of size 1 differs by sqrt((g - 1)^2 + 4 g sin(a/2)^2).
        """
        chord = 2.0 * math.sin(0.5 * self.thrust_direction)
        return math.sqrt(self.thrust_gain**2 + (1.0 + self.thrust_gain) * chord**2)

    def exceeded(self, other: DisturbanceBounds) -> list[str]:
        """Return the names of the fields in which another disturbance is larger than this one."""
        pairs = zip(DisturbanceBounds.model_fields, self.bounds, other.bounds, strict=True)
        return [name for name, mine, theirs in pairs if theirs > mine]
