"""Attitudes at a reset: a parameter that draws an attitude, and the initialiser of a deputy that turns."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from pydantic import field_validator

from safe_inspect.simulators.resets.initializers import Initializer, polar
from safe_inspect.simulators.resets.parameters import Draw, Parameter
from safe_inspect.types import FloatArray

#: A quaternion [x, y, z, w] of any non-zero length, or None for an attitude that is drawn.
GivenAttitude = tuple[float, float, float, float] | None


def repeated_unit(vector: tuple[float, ...], rows: int) -> FloatArray:
    """Return a vector divided by its length, repeated in every row, shape (R, k)."""
    return np.tile(np.array(vector) / math.hypot(*vector), (rows, 1))


def require_length(value: tuple[float, ...] | None) -> tuple[float, ...] | None:
    """Return a vector after checking that its length is not zero.

    Raises:
        ValueError: The length is zero.
    """
    if value is not None and not any(value):
        raise ValueError("all components are 0, which is neither a direction nor an attitude; give another, or null")
    return value


def drawn_attitude(draw: Draw, given: GivenAttitude = None) -> FloatArray:
    """Return unit quaternions [x, y, z, w], shape (R, 4): the given one, or draws that are uniform over all attitudes.

    With u1, u2, u3 uniform in [0, 1), ``q = [a sin(2 pi u2), a cos(2 pi u2), b sin(2 pi u3), b cos(2 pi u3)]``, ``a =
    sqrt(1 - u1)``, ``b = sqrt(u1)`` is uniform over all attitudes (Shoemake, "Uniform random rotations", Graphics Gems
    III, 1992).
    """
    if given is not None:
        return repeated_unit(given, len(draw.streams))
    u1, u2, u3 = draw.streams.uniform(draw.purpose, 3, draw.index).T
    a, b = np.sqrt(1.0 - u1), np.sqrt(u1)
    s, t = 2.0 * math.pi * u2, 2.0 * math.pi * u3
    return np.stack((a * np.sin(s), a * np.cos(s), b * np.sin(t), b * np.cos(t)), axis=-1)


class AttitudeParameter(Parameter):
    """Attitude of a body at a reset, fixed or uniform over all attitudes; see `drawn_attitude`.

    Its value is ``orientation``, the rotation from body to Hill's frame [x, y, z, w], shape (R, 4).

    Attributes:
        orientation: The attitude, which is normalised; None: uniform over all attitudes.
    """

    orientation: GivenAttitude = None

    _has_length = field_validator("orientation")(require_length)

    def __call__(self, draw: Draw) -> dict[str, FloatArray]:
        """Return the attitudes."""
        return {"orientation": drawn_attitude(draw, self.orientation)}


class CWHSixDOFRadialInitializer(Initializer):
    """Position and velocity in polar form, an attitude, and the components of the angular velocity in body axes.

    position = radius [cos(az) cos(el), sin(az) cos(el), sin(el)], and the velocity likewise. Hill frame. The attitude
    is uniform over all attitudes unless ``orientation`` gives another parameter for it, see `AttitudeParameter`.

    It returns ``position`` [m] (R, 3), ``velocity`` [m/s] (R, 3), ``orientation`` (R, 4) and ``angular_velocity``
    [rad/s] (R, 3).
    """

    parameters: ClassVar[Mapping[str, str | None]] = {
        "radius": "m",
        "azimuth_angle": "rad",
        "elevation_angle": "rad",
        "vel_mag": "m/s",
        "vel_azimuth_angle": "rad",
        "vel_elevation_angle": "rad",
        "wx": "rad/s",
        "wy": "rad/s",
        "wz": "rad/s",
        "orientation": None,
    }
    defaults: ClassVar[Mapping[str, Parameter]] = {"orientation": AttitudeParameter()}
    gives: ClassVar[Mapping[str, int]] = {"position": 3, "velocity": 3, "orientation": 4, "angular_velocity": 3}

    def __call__(self, values: Mapping[str, Any]) -> dict[str, FloatArray]:
        """Return the states that follow from the drawn values."""
        return {
            "position": polar(values["radius"], values["azimuth_angle"], values["elevation_angle"]),
            "velocity": polar(values["vel_mag"], values["vel_azimuth_angle"], values["vel_elevation_angle"]),
            "orientation": np.asarray(values["orientation"]["orientation"]),
            "angular_velocity": np.stack([values[name] for name in ("wx", "wy", "wz")], axis=-1),
        }
