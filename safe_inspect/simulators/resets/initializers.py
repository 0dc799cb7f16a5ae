"""Initialisers: functions from drawn parameters to the states of a body."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from pydantic import Field, field_validator

from safe_inspect.plugins.plugin import Plugin
from safe_inspect.simulators.resets.parameters import Draw, Parameter
from safe_inspect.types import FloatArray


class Initializer(Plugin):
    """Function from drawn parameters to named states of R rows.

    Class attributes:
        parameters: SI unit by the name of each parameter; None for a mapping of states.
        gives: Number of elements by the name of each returned state, if the class defines them.
        defaults: Parameters that are used if the configuration has none with their name.
    """

    kind: ClassVar[str] = "initializer"
    parameters: ClassVar[Mapping[str, str | None]] = {}
    gives: ClassVar[Mapping[str, int]] = {}
    defaults: ClassVar[Mapping[str, Parameter]] = {}

    @abstractmethod
    def __call__(self, values: Mapping[str, Any]) -> dict[str, FloatArray]:
        """Return the named states, each with R rows."""


#: Parameters of `polar_states`.
POLAR: Mapping[str, str | None] = {
    "radius": "m", "azimuth_angle": "rad", "elevation_angle": "rad",
    "vel_mag": "m/s", "vel_azimuth_angle": "rad", "vel_elevation_angle": "rad",
}  # fmt: skip


def polar(radius: FloatArray, azimuth: FloatArray, elevation: FloatArray) -> FloatArray:
    """Return radius [cos(az) cos(el), sin(az) cos(el), sin(el)], shape (R, 3)."""
    horizontal = radius * np.cos(elevation)
    return np.stack((horizontal * np.cos(azimuth), horizontal * np.sin(azimuth), radius * np.sin(elevation)), axis=-1)


def polar_states(values: Mapping[str, Any]) -> dict[str, FloatArray]:
    """Return ``position`` [m] and ``velocity`` [m/s] by the parameters of `POLAR`, shape (R, 3) each."""
    return {
        "position": polar(values["radius"], values["azimuth_angle"], values["elevation_angle"]),
        "velocity": polar(values["vel_mag"], values["vel_azimuth_angle"], values["vel_elevation_angle"]),
    }


class CWH3DRadialWithSunInitializer(Initializer):
    """Position and velocity in polar form, and the angle of the sun.

    position = radius [cos(az) cos(el), sin(az) cos(el), sin(el)], and the velocity likewise. Hill frame.

    It returns ``position`` [m] (R, 3), ``velocity`` [m/s] (R, 3) and ``sun_angle`` [rad] (R,).
    """

    parameters: ClassVar[Mapping[str, str | None]] = {**POLAR, "sun_angle": "rad"}
    gives: ClassVar[Mapping[str, int]] = {"position": 3, "velocity": 3, "sun_angle": 1}

    def __call__(self, values: Mapping[str, Any]) -> dict[str, FloatArray]:
        """Return the states that follow from the drawn polar values."""
        return {**polar_states(values), "sun_angle": values["sun_angle"]}


class PositionVelocityInitializer(Initializer):
    """Position and velocity by their components, Hill frame.

    It returns ``position`` [m] (R, 3) and ``velocity`` [m/s] (R, 3).
    """

    parameters: ClassVar[Mapping[str, str | None]] = {
        "x": "m", "y": "m", "z": "m", "x_dot": "m/s", "y_dot": "m/s", "z_dot": "m/s",
    }  # fmt: skip
    gives: ClassVar[Mapping[str, int]] = {"position": 3, "velocity": 3}

    def __call__(self, values: Mapping[str, Any]) -> dict[str, FloatArray]:
        """Return the states that consist of the drawn components."""
        return {
            "position": np.stack([values[name] for name in ("x", "y", "z")], axis=-1),
            "velocity": np.stack([values[name] for name in ("x_dot", "y_dot", "z_dot")], axis=-1),
        }


class RejectionSamplerInitializer(Initializer):
    """The states that the rejection sampler accepted, without changes.

    Attributes:
        states: Names of the states to use.
    """

    parameters: ClassVar[Mapping[str, str | None]] = {"init_state": None}

    states: tuple[str, ...] = Field(default=("position", "velocity"), min_length=1)

    def __call__(self, values: Mapping[str, Any]) -> dict[str, FloatArray]:
        """Return the named states of ``init_state``."""
        return {name: values["init_state"][name] for name in self.states}


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
        **POLAR, "wx": "rad/s", "wy": "rad/s", "wz": "rad/s", "orientation": None,
    }  # fmt: skip
    defaults: ClassVar[Mapping[str, Parameter]] = {"orientation": AttitudeParameter()}
    gives: ClassVar[Mapping[str, int]] = {"position": 3, "velocity": 3, "orientation": 4, "angular_velocity": 3}

    def __call__(self, values: Mapping[str, Any]) -> dict[str, FloatArray]:
        """Return the states that follow from the drawn values."""
        return {
            **polar_states(values),
            "orientation": np.asarray(values["orientation"]["orientation"]),
            "angular_velocity": np.stack([values[name] for name in ("wx", "wy", "wz")], axis=-1),
        }
