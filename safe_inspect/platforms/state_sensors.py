"""Sensors of the agent's own motion and attitude, of other bodies, and of the sun."""

from __future__ import annotations

import math
from typing import ClassVar, Self

import numpy as np
from pydantic import field_validator

from safe_inspect.compiling import njit
from safe_inspect.platforms.base import Sensor
from safe_inspect.platforms.copies import copy_axes, copy_difference, copy_number, copy_vector
from safe_inspect.plugins.plugin import EntityName
from safe_inspect.simulators import Group, Simulator, World
from safe_inspect.simulators.resets.initializers import require_length
from safe_inspect.simulators.row_terms import BodyArray, EnvironmentArray, OwnArray, RowTerm, own_estimate
from safe_inspect.tasks.inspection.sun import Sun
from safe_inspect.types import FloatArray

_TURN = 2.0 * math.pi


@njit
def _wrapped_angle(angle: float, reading: FloatArray) -> None:
    """Write an angle within [0, 2 pi), like NumPy's `mod`; a tiny negative angle that rounds up to 2 pi becomes 0."""
    if 0.0 < angle < _TURN:
        reading[0] = angle
        return
    rest = np.fmod(angle, _TURN)
    if rest == 0.0:
        rest = 0.0  # never -0
    elif rest < 0.0:
        rest += _TURN
    reading[0] = 0.0 if rest >= _TURN else rest


class PositionSensor(Sensor, name="Sensor_Position"):
    """Own position [m], Hill frame, shape (R, 3)."""

    elements: ClassVar[tuple[str, ...]] = ("x", "y", "z")
    symbol: ClassVar[str] = "m"

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the kernel that writes the position [m]."""
        return RowTerm(copy_vector, (own_estimate("position", world),))


class VelocitySensor(Sensor, name="Sensor_Velocity"):
    """Own velocity [m/s], Hill frame, shape (R, 3)."""

    elements: ClassVar[tuple[str, ...]] = ("v_x", "v_y", "v_z")
    symbol: ClassVar[str] = "m/s"

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the kernel that writes the velocity [m/s]."""
        return RowTerm(copy_vector, (own_estimate("velocity", world),))


class SunAngleSensor(Sensor, name="Sensor_SunAngle"):
    """Angle a of the sun [rad], shape (R, 1); the direction to the sun is [cos(a), -sin(a), 0] in Hill's frame.

    Attributes:
        wrap: True: the angle is within [0, 2 pi). False: it grows without limit, as in safe-autonomy-sims.
    """

    elements: ClassVar[tuple[str, ...]] = ("theta_sun",)
    symbol: ClassVar[str] = "rad"
    bounds: ClassVar[tuple[float, float]] = (0.0, 2.0 * math.pi)

    wrap: bool = True

    @property
    def limits(self) -> tuple[float, float]:
        """Smallest and largest angle [rad]; infinite if the angle is not wrapped."""
        return self.bounds if self.wrap else (-math.inf, math.inf)

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the kernel that writes the sun's angle [rad]."""
        return RowTerm(_wrapped_angle if self.wrap else copy_number, (EnvironmentArray("sun_angle"),))


class SunDirectionSensor(Sensor, name="Sensor_SunDirection"):
    """Unit vector from the chief to the sun [-], Hill frame, shape (R, 3); see `sun_directions`.

    Unlike the angle, it does not jump at the end of a revolution.
    """

    elements: ClassVar[tuple[str, ...]] = ("x_sun", "y_sun", "z_sun")
    bounds: ClassVar[tuple[float, float]] = (-1.0, 1.0)

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the kernel that writes the direction to the sun [-]."""
        return RowTerm(copy_vector, (EnvironmentArray("sun_direction"),))


class SunlightSensor(Sensor, name="Sensor_Sunlight"):
    """Fraction of the sun's disc that the Earth does not hide [-], shape (R, 1); 0 in its shadow, 1 outside of it.

    It requires a simulator with an eclipse (``illumination_params: {eclipse: True}``).
    """

    elements: ClassVar[tuple[str, ...]] = ("sunlight",)
    bounds: ClassVar[tuple[float, float]] = (0.0, 1.0)

    def in_task(self, simulator: Simulator, horizon: int) -> Self:
        """Return the sensor itself.

        Raises:
            ValueError: The simulator has no eclipse.
        """
        if not any(isinstance(component, Sun) and component.eclipse for component in simulator.compose()[1]):
            raise ValueError(f"{self.registered_name} needs an eclipse; set `eclipse: True` in `illumination_params`")
        return self

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the kernel that writes the fraction [-]."""
        return RowTerm(copy_number, (EnvironmentArray("sunlight"),))


@njit
def _copy_bounded(vector: FloatArray, reading: FloatArray) -> None:
    for k in range(len(reading)):
        reading[k] = min(max(vector[k], -1.0), 1.0)


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
        return RowTerm(copy_vector, (np.array((x / size, y / size, z / size)),))


class RotatedAxesSensor(Sensor, name="Sensor_RotatedAxes"):
    """The body's y and z axes in Hill's frame [-], shape (R, 6)."""

    elements: ClassVar[tuple[str, ...]] = ("x_of_y", "y_of_y", "z_of_y", "x_of_z", "y_of_z", "z_of_z")
    bounds: ClassVar[tuple[float, float]] = (-1.0, 1.0)

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the kernel that writes the axes [-]."""
        return RowTerm(copy_axes, (1, OwnArray("orientation")))


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
