"""Sensors of the own state and of the sun."""

from __future__ import annotations

import math
from typing import ClassVar

import numpy as np

from safe_inspect.platforms.base import Sensor
from safe_inspect.simulators.view import View
from safe_inspect.types import FloatArray


class PositionSensor(Sensor, name="Sensor_Position"):
    """Own position [m], Hill frame, shape (R, 3)."""

    elements: ClassVar[tuple[str, ...]] = ("x", "y", "z")
    symbol: ClassVar[str] = "m"

    def __call__(self, view: View) -> FloatArray:
        """Return the own position [m], shape (R, 3)."""
        return view.position


class VelocitySensor(Sensor, name="Sensor_Velocity"):
    """Own velocity [m/s], Hill frame, shape (R, 3)."""

    elements: ClassVar[tuple[str, ...]] = ("v_x", "v_y", "v_z")
    symbol: ClassVar[str] = "m/s"

    def __call__(self, view: View) -> FloatArray:
        """Return the own velocity [m/s], shape (R, 3)."""
        return view.velocity


class SunAngleSensor(Sensor, name="Sensor_SunAngle"):
    """Angle of the sun [rad], shape (R, 1); the sun stands at [cos, -sin, 0] of it in Hill's frame.

    Attributes:
        wrap: True: within [0, 2 pi). False: it grows for ever, as the peer's does.
    """

    elements: ClassVar[tuple[str, ...]] = ("theta_sun",)
    symbol: ClassVar[str] = "rad"
    bounds: ClassVar[tuple[float, float]] = (0.0, 2.0 * math.pi)

    wrap: bool = True

    @property
    def limits(self) -> tuple[float, float]:
        """Smallest and largest angle [rad]; none when it is not wrapped."""
        return self.bounds if self.wrap else (-math.inf, math.inf)

    def __call__(self, view: View) -> FloatArray:
        """Return the sun's angle [rad], shape (R, 1)."""
        angle: FloatArray = view.sun_angle[:, None]
        if not self.wrap:
            return angle
        wrapped = np.mod(angle, 2.0 * math.pi)
        return np.where(wrapped >= 2.0 * math.pi, 0.0, wrapped)  # mod of a tiny negative angle rounds up to 2 pi


class SunDirectionSensor(Sensor, name="Sensor_SunDirection"):
    """Unit vector from the chief to the sun [-], Hill frame, shape (R, 3): [cos, -sin, 0] of the sun's angle.

    Unlike the angle it has no jump where a revolution ends.
    """

    elements: ClassVar[tuple[str, ...]] = ("x_sun", "y_sun", "z_sun")
    symbol: ClassVar[str] = ""
    bounds: ClassVar[tuple[float, float]] = (-1.0, 1.0)

    def __call__(self, view: View) -> FloatArray:
        """Return the direction to the sun [-], shape (R, 3)."""
        direction: FloatArray = view.sun_direction
        return direction
