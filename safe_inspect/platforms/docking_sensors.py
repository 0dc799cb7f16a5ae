"""Sensors of the agent's own speed, of the speed limit of docking, and of the approach velocity at that limit."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from safe_inspect.compiling import njit
from safe_inspect.geometry.distance import distance
from safe_inspect.platforms.base import Sensor
from safe_inspect.simulators.row_terms.inputs import own_estimate
from safe_inspect.simulators.row_terms.loops import RowTerm
from safe_inspect.simulators.view import Group
from safe_inspect.simulators.world import World
from safe_inspect.tasks.docking.speed_limit import SpeedLimit, speed_limit
from safe_inspect.types import FloatArray


@njit
def _size(vector: FloatArray, origin: FloatArray, reading: FloatArray) -> None:
    reading[0] = distance(vector, origin)


@njit
def _limit(line: FloatArray, position: FloatArray, origin: FloatArray, reading: FloatArray) -> None:
    reading[0] = speed_limit(line, distance(position, origin))


@njit
def _approach(line: FloatArray, position: FloatArray, origin: FloatArray, reading: FloatArray) -> None:
    far = distance(position, origin)
    factor = -speed_limit(line, far) / far if far > 0.0 else 0.0
    for k in range(3):
        reading[k] = factor * position[k]


class SpeedSensor(Sensor, name="Sensor_Speed"):
    """Own speed in Hill's frame [m/s], shape (R, 1)."""

    elements: ClassVar[tuple[str, ...]] = ("speed",)
    symbol: ClassVar[str] = "m/s"
    bounds: ClassVar[tuple[float, float]] = (0.0, np.inf)

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the kernel that writes the speed [m/s]."""
        return RowTerm(_size, (own_estimate("velocity", world), np.zeros(3)))


class SpeedLimitSensor(SpeedLimit, Sensor, name="Sensor_SpeedLimit"):
    """Speed limit of docking at the agent's range from the origin of Hill's frame [m/s], shape (R, 1)."""

    elements: ClassVar[tuple[str, ...]] = ("speed_limit",)
    symbol: ClassVar[str] = "m/s"
    bounds: ClassVar[tuple[float, float]] = (0.0, np.inf)

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the kernel that writes the limit [m/s]."""
        return RowTerm(_limit, (self.limit_line(world), own_estimate("position", world), np.zeros(3)))


class ApproachVelocitySensor(SpeedLimit, Sensor, name="Sensor_ApproachVelocity"):
    """Velocity straight to the origin of Hill's frame at the docking speed limit, -L(r) p / r [m/s], shape (R, 3).

    Here p is the position of the deputy, r its length, and L the speed limit (`SpeedLimit`). At the origin the velocity
    is 0. Its magnitude varies much less than the range, so it shows the direction to the chief also at short range,
    where the elements of the position are small.
    """

    elements: ClassVar[tuple[str, ...]] = ("approach_x", "approach_y", "approach_z")
    symbol: ClassVar[str] = "m/s"

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the kernel that writes the velocity [m/s]."""
        return RowTerm(_approach, (self.limit_line(world), own_estimate("position", world), np.zeros(3)))
