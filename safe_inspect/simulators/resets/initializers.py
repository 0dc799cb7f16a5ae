"""Initialisers: functions from drawn parameters to the states of a body."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from pydantic import Field

from safe_inspect.plugins.plugin import Plugin
from safe_inspect.simulators.resets.parameters import Parameter
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


def polar(radius: FloatArray, azimuth: FloatArray, elevation: FloatArray) -> FloatArray:
    """Return radius [cos(az) cos(el), sin(az) cos(el), sin(el)], shape (R, 3)."""
    horizontal = radius * np.cos(elevation)
    return np.stack((horizontal * np.cos(azimuth), horizontal * np.sin(azimuth), radius * np.sin(elevation)), axis=-1)


class CWH3DRadialWithSunInitializer(Initializer):
    """Position and velocity in polar form, and the angle of the sun.

    position = radius [cos(az) cos(el), sin(az) cos(el), sin(el)], and the velocity likewise. Hill frame.

    It returns ``position`` [m] (R, 3), ``velocity`` [m/s] (R, 3) and ``sun_angle`` [rad] (R,).
    """

    parameters: ClassVar[Mapping[str, str | None]] = {
        "radius": "m",
        "azimuth_angle": "rad",
        "elevation_angle": "rad",
        "vel_mag": "m/s",
        "vel_azimuth_angle": "rad",
        "vel_elevation_angle": "rad",
        "sun_angle": "rad",
    }
    gives: ClassVar[Mapping[str, int]] = {"position": 3, "velocity": 3, "sun_angle": 1}

    def __call__(self, values: Mapping[str, Any]) -> dict[str, FloatArray]:
        """Return the states that follow from the drawn polar values."""
        return {
            "position": polar(values["radius"], values["azimuth_angle"], values["elevation_angle"]),
            "velocity": polar(values["vel_mag"], values["vel_azimuth_angle"], values["vel_elevation_angle"]),
            "sun_angle": values["sun_angle"],
        }


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
