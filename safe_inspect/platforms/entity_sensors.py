"""Sensors of another body."""

from __future__ import annotations

from typing import ClassVar

from safe_inspect.platforms.base import Sensor
from safe_inspect.plugins.plugin import EntityName
from safe_inspect.simulators.view import View
from safe_inspect.types import FloatArray


class EntityPositionSensor(Sensor, name="Sensor_EntityPosition"):
    """Position of another body [m], Hill frame, shape (R, 3).

    Attributes:
        entity_name: Name of the body.
    """

    elements: ClassVar[tuple[str, ...]] = ("x", "y", "z")
    symbol: ClassVar[str] = "m"

    entity_name: EntityName = "chief"

    def __call__(self, view: View) -> FloatArray:
        """Return the body's position [m], shape (R, 3)."""
        return view.entity_position(self.entity_name)


class EntityVelocitySensor(Sensor, name="Sensor_EntityVelocity"):
    """Velocity of another body [m/s], Hill frame, shape (R, 3).

    Attributes:
        entity_name: Name of the body.
    """

    elements: ClassVar[tuple[str, ...]] = ("v_x", "v_y", "v_z")
    symbol: ClassVar[str] = "m/s"

    entity_name: EntityName = "chief"

    def __call__(self, view: View) -> FloatArray:
        """Return the body's velocity [m/s], shape (R, 3)."""
        return view.entity_velocity(self.entity_name)
