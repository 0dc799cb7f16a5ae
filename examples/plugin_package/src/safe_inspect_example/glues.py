"""What an agent observes and how it acts."""

import numpy as np

from safe_inspect.glues import ActionGlue, ObservationGlue
from safe_inspect.glues.base import controller_of
from safe_inspect.plugins import ControllerName, SensorName
from safe_inspect.units import PositiveForce


class DirectionGlue(ObservationGlue):
    """The direction of what a sensor reads: reading / |reading|, 0 for a reading of 0; shape (R, size).

    Attributes:
        sensor: Name of the sensor.
    """

    sensor: SensorName = "Sensor_Position"

    def names(self, parts):
        """Return ``direction.ELEMENT`` for each element of the reading."""
        return tuple(f"direction.{element}" for element in parts[self.sensor].element_names)

    def bounds(self, parts):
        """Return -1 and 1."""
        size = parts[self.sensor].size
        return np.full(size, -1.0), np.ones(size)

    def __call__(self, view):
        """Return the direction, shape (R, size)."""
        reading = view.reading(self.sensor)
        length = np.sqrt((reading**2).sum(axis=-1, keepdims=True))
        return reading / np.maximum(length, 1e-12)


class OnOffGlue(ActionGlue):
    """Full thrust, or none: two choices along each axis and direction make three, the indices 0, 1 and 2.

    Attributes:
        controller: Name of a controller of three thrusts.
        thrust: The thrust of 0 (against the axis) and 2 (along it) [N]; 1 is none.
    """

    controller: ControllerName = "ThrustUnit"
    thrust: PositiveForce = 0.1

    def names(self, parts):
        """Return the name of each element of the action."""
        return tuple(f"{self.controller}.{axis}" for axis in "xyz")

    def bounds(self, parts):
        """Return the smallest and the largest index of each element."""
        return np.zeros(3), np.full(3, 2.0)

    def choices(self, parts):
        """Return three choices for each element."""
        return (3, 3, 3)

    def __call__(self, action, parts):
        """Return the thrust [N], shape (R, 3)."""
        return controller_of(parts, self.controller)((action - 1.0) * self.thrust)
