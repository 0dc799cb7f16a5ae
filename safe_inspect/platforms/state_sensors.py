"""Sensors of the agent's own position and velocity, and of the sun."""

from __future__ import annotations

import math
from typing import ClassVar, Self

import numpy as np

from safe_inspect.compiling import njit
from safe_inspect.platforms.base import Sensor
from safe_inspect.platforms.copies import copy_number, copy_vector
from safe_inspect.simulators.row_terms.inputs import EnvironmentArray, own_estimate
from safe_inspect.simulators.row_terms.loops import RowTerm
from safe_inspect.simulators.simulator import Simulator
from safe_inspect.simulators.view import Group
from safe_inspect.simulators.world import World
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
    """Unit vector from the chief to the sun [-], Hill frame, shape (R, 3): [cos(a), -sin(a), 0] for the sun's angle a.

    Unlike the angle, it does not jump at the end of a revolution.
    """

    elements: ClassVar[tuple[str, ...]] = ("x_sun", "y_sun", "z_sun")
    symbol: ClassVar[str] = ""
    bounds: ClassVar[tuple[float, float]] = (-1.0, 1.0)

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the kernel that writes the direction to the sun [-]."""
        return RowTerm(copy_vector, (EnvironmentArray("sun_direction"),))


class SunlightSensor(Sensor, name="Sensor_Sunlight"):
    """Fraction of the sun's disc that the Earth does not hide [-], shape (R, 1); 0 in its shadow, 1 outside of it.

    It requires a simulator with an eclipse (``illumination_params: {eclipse: True}``).
    """

    elements: ClassVar[tuple[str, ...]] = ("sunlight",)
    symbol: ClassVar[str] = ""
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
