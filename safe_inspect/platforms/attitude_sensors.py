"""Sensors of the agent's own attitude and orbit, and of other bodies relative to the agent."""

from __future__ import annotations

import math
from typing import ClassVar

from pydantic import field_validator

from safe_inspect.compiling import njit
from safe_inspect.dynamics.rotation_row import rotated
from safe_inspect.platforms.base import Sensor
from safe_inspect.platforms.copies import copy_difference, copy_vector
from safe_inspect.plugins.plugin import EntityName
from safe_inspect.simulators.resets.initializers import require_length
from safe_inspect.simulators.row_terms.inputs import BodyArray, OwnArray, own_estimate
from safe_inspect.simulators.row_terms.loops import RowTerm
from safe_inspect.simulators.view import Group
from safe_inspect.simulators.world import World
from safe_inspect.types import FloatArray


@njit
def _copy_bounded(vector: FloatArray, reading: FloatArray) -> None:
    for k in range(len(reading)):
        reading[k] = min(max(vector[k], -1.0), 1.0)


@njit
def _constant(x: float, y: float, z: float, reading: FloatArray) -> None:
    reading[0], reading[1], reading[2] = x, y, z


@njit
def _other_axes(orientation: FloatArray, reading: FloatArray) -> None:
    y, z = rotated(orientation, 0.0, 1.0, 0.0), rotated(orientation, 0.0, 0.0, 1.0)
    for k in range(3):
        reading[k] = min(max(y[k], -1.0), 1.0)
        reading[3 + k] = min(max(z[k], -1.0), 1.0)


@njit
def _drift(mean_motion: float, position: FloatArray, velocity: FloatArray, reading: FloatArray) -> None:
    reading[0] = 2.0 * mean_motion * position[0] + velocity[1]


class QuaternionSensor(Sensor, name="Sensor_Quaternion"):
    """Own attitude from body to Hill's frame as a unit quaternion, scalar last [-], shape (R, 4)."""

    elements: ClassVar[tuple[str, ...]] = ("q_x", "q_y", "q_z", "q_w")
    bounds: ClassVar[tuple[float, float]] = (-1.0, 1.0)

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the kernel that writes the attitude [-]."""
        return RowTerm(_copy_bounded, (OwnArray("orientation"),))


class AngularVelocitySensor(Sensor, name="Sensor_AngularVelocity"):
    """Own angular velocity relative to inertial space, in body axes [rad/s], shape (R, 3); see `rate_against`."""

    elements: ClassVar[tuple[str, ...]] = ("w_x", "w_y", "w_z")
    symbol: ClassVar[str] = "rad/s"

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the kernel that writes the angular velocity [rad/s]."""
        return RowTerm(copy_vector, (OwnArray("angular_velocity"),))


class OrientationUnitVectorSensor(Sensor, name="Sensor_OrientationUnitVector"):
    """Axis of the camera in body axes, which is constant [-], shape (R, 3).

    Attributes:
        initial_sensor_unit_vec: The axis; any length.
    """

    elements: ClassVar[tuple[str, ...]] = ("x_camera", "y_camera", "z_camera")
    bounds: ClassVar[tuple[float, float]] = (-1.0, 1.0)

    initial_sensor_unit_vec: tuple[float, float, float] = (1.0, 0.0, 0.0)

    _has_length = field_validator("initial_sensor_unit_vec")(require_length)

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the kernel that writes the axis [-]."""
        x, y, z = self.initial_sensor_unit_vec
        size = math.hypot(x, y, z)
        return RowTerm(_constant, (x / size, y / size, z / size))


class RotatedAxesSensor(Sensor, name="Sensor_RotatedAxes"):
    """The body's y and z axes in Hill's frame [-], shape (R, 6)."""

    elements: ClassVar[tuple[str, ...]] = ("x_of_y", "y_of_y", "z_of_y", "x_of_z", "y_of_z", "z_of_z")
    bounds: ClassVar[tuple[float, float]] = (-1.0, 1.0)

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the kernel that writes the axes [-]."""
        return RowTerm(_other_axes, (OwnArray("orientation"),))


class RelativePositionSensor(Sensor, name="Sensor_RelativePosition"):
    """Position of another body relative to the agent's own position [m], Hill frame, shape (R, 3).

    Attributes:
        entity_name: Name of the body.
    """

    elements: ClassVar[tuple[str, ...]] = ("x", "y", "z")
    symbol: ClassVar[str] = "m"

    entity_name: EntityName = "chief"

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the kernel that writes the relative position [m]."""
        return RowTerm(copy_difference, (BodyArray("position", self.entity_name), own_estimate("position", world)))


class RelativeVelocitySensor(Sensor, name="Sensor_RelativeVelocity"):
    """Velocity of another body relative to the agent's own velocity [m/s], Hill frame, shape (R, 3).

    Attributes:
        entity_name: Name of the body.
    """

    elements: ClassVar[tuple[str, ...]] = ("v_x", "v_y", "v_z")
    symbol: ClassVar[str] = "m/s"

    entity_name: EntityName = "chief"

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the kernel that writes the relative velocity [m/s]."""
        return RowTerm(copy_difference, (BodyArray("velocity", self.entity_name), own_estimate("velocity", world)))


class OrbitStabilitySensor(Sensor, name="Sensor_OrbitStability"):
    """``2 n x + v_y`` [m/s], shape (R, 1): 0 on a closed orbit about the chief, without along-track drift."""

    elements: ClassVar[tuple[str, ...]] = ("drift",)
    symbol: ClassVar[str] = "m/s"

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the kernel that writes the drift [m/s]."""
        return RowTerm(
            _drift, (float(world.mean_motion), own_estimate("position", world), own_estimate("velocity", world))
        )
