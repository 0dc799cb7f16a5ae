"""Sensors for docking with a chief at rest in Hill's frame, and with a tumbling target in the inertial frame W."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from safe_inspect.compiling import njit
from safe_inspect.geometry.distance import distance
from safe_inspect.platforms.base import Sensor
from safe_inspect.platforms.copies import copy_axes, copy_difference, copy_number, copy_turned
from safe_inspect.simulators import Group, World
from safe_inspect.simulators.row_terms import EnvironmentArray, OwnArray, RowTerm, own_estimate
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


class MatingPointPositionSensor(Sensor, name="Sensor_MatingPointPosition"):
    """Position of the mating point relative to the agent's own centre [m], shape (R, 3)."""

    elements: ClassVar[tuple[str, ...]] = ("x_mp", "y_mp", "z_mp")
    symbol: ClassVar[str] = "m"

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the kernel that writes the relative position [m]."""
        return RowTerm(copy_difference, (EnvironmentArray("mating_point_position"), own_estimate("position", world)))


class MatingPointVelocitySensor(Sensor, name="Sensor_MatingPointVelocity"):
    """Velocity of the mating point relative to the agent's own velocity [m/s], shape (R, 3)."""

    elements: ClassVar[tuple[str, ...]] = ("v_x_mp", "v_y_mp", "v_z_mp")
    symbol: ClassVar[str] = "m/s"

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the kernel that writes the relative velocity [m/s]."""
        return RowTerm(copy_difference, (EnvironmentArray("mating_point_velocity"), own_estimate("velocity", world)))


class TargetAxesSensor(Sensor, name="Sensor_TargetAxes"):
    """Attitude of the target without jumps: its first two principal axes as unit vectors [-], shape (R, 6)."""

    elements: ClassVar[tuple[str, ...]] = ("x_axis1", "y_axis1", "z_axis1", "x_axis2", "y_axis2", "z_axis2")
    bounds: ClassVar[tuple[float, float]] = (-1.0, 1.0)

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the kernel that writes the first two columns of R_WT [-]."""
        return RowTerm(copy_axes, (0, EnvironmentArray("target_orientation")))


class TargetAngularVelocitySensor(Sensor, name="Sensor_TargetAngularVelocity"):
    """Angular velocity of the target in W [rad/s], shape (R, 3)."""

    elements: ClassVar[tuple[str, ...]] = ("w_x", "w_y", "w_z")
    symbol: ClassVar[str] = "rad/s"

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the kernel that writes R_WT w [rad/s]."""
        attitude, rate = EnvironmentArray("target_orientation"), EnvironmentArray("target_angular_velocity")
        return RowTerm(copy_turned, (np.inf, attitude, rate))


class ClearanceSensor(Sensor, name="Sensor_Clearance"):
    """Signed distance of the agent's own centre to the target's shape, negative inside [m], shape (R, 1)."""

    elements: ClassVar[tuple[str, ...]] = ("clearance",)
    symbol: ClassVar[str] = "m"

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the kernel that writes the clearance [m]."""
        return RowTerm(copy_number, (OwnArray("clearance"),))
