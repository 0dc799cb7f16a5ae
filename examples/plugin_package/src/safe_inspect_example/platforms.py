"""A spacecraft that has room for a few sensors, and the thrusters that it flies with."""

import numpy as np
from pydantic import Field

from safe_inspect.platforms import Controller, Platform, Sensor
from safe_inspect.units import PositiveForce, PositiveMass


class CubeSat(Platform):
    """A point mass with room for some sensors.

    Attributes:
        mass: Mass [kg].
        sensors: Number of sensors that it has room for.
    """

    mass: PositiveMass = 6.0
    sensors: int = Field(default=8, ge=0)

    def __call__(self, parts):
        """Return the names of the parts; raise ValueError when there are too many sensors."""
        count = sum(isinstance(part, Sensor) for part in parts)
        if count > self.sensors:
            raise ValueError(f"there are {count} sensors and room for {self.sensors}; remove some, or raise `sensors`")
        return tuple(part.part_name for part in parts)


class ThrustUnit(Controller):
    """Three thrusters: the command is the thrust along x, y and z [N], at most `largest` each.

    Attributes:
        largest: Largest thrust along each axis [N].
    """

    largest: PositiveForce = 0.5

    @property
    def limits(self):
        """Smallest and largest command [N], two arrays of shape (3,)."""
        return np.full(3, -self.largest), np.full(3, self.largest)

    def __call__(self, values):
        """Return the thrust [N], shape (R, 3)."""
        return np.clip(values, *self.limits)
