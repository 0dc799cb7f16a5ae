"""A radar that measures the range rate."""

from typing import ClassVar

import numpy as np

from safe_inspect.platforms import Sensor
from safe_inspect.plugins import EntityName


class RangeRateSensor(Sensor, name="Sensor_RangeRate"):
    """Change of the range to a body, p . v / |p| for the relative p and v [m/s], shape (R, 1); 0 at its centre.

    Attributes:
        entity_name: The body.
    """

    elements: ClassVar[tuple[str, ...]] = ("range_rate",)
    symbol: ClassVar[str] = "m/s"

    entity_name: EntityName = "chief"

    def __call__(self, view):
        """Return the range rate [m/s], shape (R, 1)."""
        position = view.position - view.entity_position(self.entity_name)
        velocity = view.velocity - view.entity_velocity(self.entity_name)
        distance = np.sqrt((position**2).sum(axis=-1, keepdims=True))
        return (position * velocity).sum(axis=-1, keepdims=True) / np.maximum(distance, 1e-9)
