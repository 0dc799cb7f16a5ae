"""Sensors of a tumbling target, in the inertial frame W; see `TumblingTarget`."""

from __future__ import annotations

from typing import ClassVar

from safe_inspect.compiling import njit
from safe_inspect.dynamics.rotation_row import rotated
from safe_inspect.platforms.base import Sensor
from safe_inspect.platforms.copies import copy_difference, copy_number
from safe_inspect.simulators.row_terms.inputs import EnvironmentArray, OwnArray, own_estimate
from safe_inspect.simulators.row_terms.loops import RowTerm
from safe_inspect.simulators.view import Group
from safe_inspect.simulators.world import World
from safe_inspect.types import FloatArray


@njit
def _first_axes(orientation: FloatArray, reading: FloatArray) -> None:
    x, y = rotated(orientation, 1.0, 0.0, 0.0), rotated(orientation, 0.0, 1.0, 0.0)
    for k in range(3):
        reading[k] = min(max(x[k], -1.0), 1.0)
        reading[3 + k] = min(max(y[k], -1.0), 1.0)


@njit
def _in_world(orientation: FloatArray, vector: FloatArray, reading: FloatArray) -> None:
    turned = rotated(orientation, vector[0], vector[1], vector[2])
    for k in range(3):
        reading[k] = turned[k]


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
        return RowTerm(_first_axes, (EnvironmentArray("target_orientation"),))


class TargetAngularVelocitySensor(Sensor, name="Sensor_TargetAngularVelocity"):
    """Angular velocity of the target in W [rad/s], shape (R, 3)."""

    elements: ClassVar[tuple[str, ...]] = ("w_x", "w_y", "w_z")
    symbol: ClassVar[str] = "rad/s"

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the kernel that writes R_WT w [rad/s]."""
        return RowTerm(_in_world, (EnvironmentArray("target_orientation"), EnvironmentArray("target_angular_velocity")))


class ClearanceSensor(Sensor, name="Sensor_Clearance"):
    """Signed distance of the agent's own centre to the target's shape, negative inside [m], shape (R, 1)."""

    elements: ClassVar[tuple[str, ...]] = ("clearance",)
    symbol: ClassVar[str] = "m"

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the kernel that writes the clearance [m]."""
        return RowTerm(copy_number, (OwnArray("clearance"),))
