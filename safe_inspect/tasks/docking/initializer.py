"""`Docking3DRadialInitializer`: initial position and velocity of a docking."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from safe_inspect.simulators.resets.initializers import Initializer, polar
from safe_inspect.tasks.docking.speed_limit import SpeedLimit
from safe_inspect.types import FloatArray
from safe_inspect.units import PositiveAngularRate


class Docking3DRadialInitializer(SpeedLimit, Initializer):
    """Position in polar form, and a velocity whose size is a fraction of the docking speed limit at that range.

    position = radius [cos(az) cos(el), sin(az) cos(el), sin(el)]. The velocity has the same form with the size
    vel_max_ratio (velocity_threshold + slope n max(radius - threshold_distance, 0)). Hill frame.

    Returns:
        ``position`` [m] (R, 3), ``velocity`` [m/s] (R, 3).
    """

    parameters: ClassVar[Mapping[str, str | None]] = {
        "radius": "m",
        "azimuth_angle": "rad",
        "elevation_angle": "rad",
        "vel_max_ratio": "",
        "vel_azimuth_angle": "rad",
        "vel_elevation_angle": "rad",
    }
    gives: ClassVar[Mapping[str, int]] = {"position": 3, "velocity": 3}

    mean_motion: PositiveAngularRate = 0.001027

    def __call__(self, values: Mapping[str, Any]) -> dict[str, FloatArray]:
        """Return the states for the sampled polar values."""
        beyond = np.maximum(values["radius"] - self.threshold_distance, 0.0)
        limit = self.velocity_threshold + self.slope * self.mean_motion * beyond
        speed = values["vel_max_ratio"] * limit
        return {
            "position": polar(values["radius"], values["azimuth_angle"], values["elevation_angle"]),
            "velocity": polar(speed, values["vel_azimuth_angle"], values["vel_elevation_angle"]),
        }
