"""Sensors of another body."""

from __future__ import annotations

from typing import ClassVar

from safe_inspect.platforms.base import Sensor
from safe_inspect.platforms.copies import copy_vector
from safe_inspect.plugins.plugin import EntityName
from safe_inspect.simulators.row_terms.inputs import BodyArray
from safe_inspect.simulators.row_terms.loops import RowTerm
from safe_inspect.simulators.view import Group
from safe_inspect.simulators.world import World


class EntityPositionSensor(Sensor, name="Sensor_EntityPosition"):
    """Position of another body [m], Hill frame, shape (R, 3).

    Attributes:
        entity_name: Name of the body.
    """

    elements: ClassVar[tuple[str, ...]] = ("x", "y", "z")
    symbol: ClassVar[str] = "m"

    entity_name: EntityName = "chief"

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the kernel that writes the body's position [m]."""
        return RowTerm(copy_vector, (BodyArray("position", self.entity_name),))


class EntityVelocitySensor(Sensor, name="Sensor_EntityVelocity"):
    """Velocity of another body [m/s], Hill frame, shape (R, 3).

    Attributes:
        entity_name: Name of the body.
    """

    elements: ClassVar[tuple[str, ...]] = ("v_x", "v_y", "v_z")
    symbol: ClassVar[str] = "m/s"

    entity_name: EntityName = "chief"

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the kernel that writes the body's velocity [m/s]."""
        return RowTerm(copy_vector, (BodyArray("velocity", self.entity_name),))
