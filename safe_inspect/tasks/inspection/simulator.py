"""`InspectionSimulator`: deputies inspect the lit points of a chief in Clohessy-Wiltshire dynamics."""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from typing import Any

from pydantic import BaseModel, model_validator

from safe_inspect.dynamics.attitude.clohessy_wiltshire_attitude import ClohessyWiltshireAttitude
from safe_inspect.dynamics.base import Dynamics
from safe_inspect.dynamics.clohessy_wiltshire import ClohessyWiltshire
from safe_inspect.dynamics.orbit.earth import earth_shadow
from safe_inspect.plugins.functor import functor_field
from safe_inspect.simulators import Component, Simulator
from safe_inspect.tasks.inspection.fuel_price import FuelPrice, FuelPriceSchedule
from safe_inspect.tasks.inspection.points import CameraAndPoints, InspectionPoints
from safe_inspect.tasks.inspection.rotation import ChiefRotation, FreeRotation
from safe_inspect.tasks.inspection.sun import Sun, SunDirection
from safe_inspect.units import AngularRate, PositiveAngularRate


class InspectionSimulator(CameraAndPoints, FuelPrice, Simulator):
    """Simulator of one chief with points, the sun, and deputies that inspect the chief.

    It composes `ClohessyWiltshire`, `Sun`, `InspectionPoints` and `FuelPriceSchedule`, and `ChiefRotation` for a
    rotating chief. With platforms that rotate (``platform: six-dof``), the dynamics are `ClohessyWiltshireAttitude`,
    and the camera rotates with the deputy. With the `delta_v_updater_criteria` ``score``, infos and tables also contain
    the summed weight of the inspected points.

    Attributes:
        mean_motion: Mean motion of the chief's circular orbit [rad/s]. It does not set the rate of the sun, which is
            the `mean_motion` of `illumination_params`, unless that is None.
        dynamics: Dynamics of the deputies, to set other values than the defaults. Its mean motion is the chief's.
        chief_angular_velocity: Constant angular velocity of the body ``chief`` relative to Hill's frame, along Hill's
            axes [rad/s], see `ChiefRotation`; by default, it is zero.
        chief_rotation: Torque-free rotation of that body in inertial space, drawn at each reset, see `FreeRotation`.
    """

    mean_motion: PositiveAngularRate = 0.001027
    dynamics: functor_field("dynamics") | None = None  # type: ignore[valid-type]
    chief_angular_velocity: tuple[AngularRate, AngularRate, AngularRate] = (0.0, 0.0, 0.0)
    chief_rotation: FreeRotation | None = None

    @model_validator(mode="after")
    def _checked_rotation_and_light(self) -> InspectionSimulator:
        if self.chief_rotation is not None and any(self.chief_angular_velocity):
            raise ValueError("`chief_rotation` and `chief_angular_velocity` exclude each other; remove one of them")
        light = self.illumination_params
        if light is not None and light.eclipse:
            earth_shadow(self.mean_motion, light.avg_rad_Earth2Sun)
        orbit = self.mean_motion if self.dynamics is None else getattr(self.dynamics, "mean_motion", None)
        if light is not None and "mean_motion" not in light.model_fields_set and orbit not in (None, light.mean_motion):
            rates = f"the sun turns at {light.mean_motion} rad/s, and the orbit at {orbit} rad/s"
            warnings.warn(f"{rates}; set `illumination_params.mean_motion` to the rate that is meant", stacklevel=2)
        return self

    @property
    def attitude_field(self) -> str:
        """Name of the field of a camera that rotates with the deputy, or an empty text if it is not given."""
        return "" if self.sensor_fov is None else "sensor_fov"

    def with_attitude(self) -> Simulator:
        """Return the simulator for platforms that rotate, with a camera that rotates with them.

        Raises:
            ValueError: The given dynamics have no attitude.
        """
        dynamics = self.dynamics or ClohessyWiltshireAttitude(mean_motion=self.mean_motion)
        if "orientation" not in dynamics.arrays:
            raise ValueError(f"the platforms turn, but {dynamics.registered_name} has no attitude; remove `dynamics`")
        view = 2.0 * math.pi if self.sensor_fov is None else self.sensor_fov
        return self.model_copy(update={"dynamics": dynamics, "sensor_fov": view})

    def compose(self) -> tuple[Dynamics, Sequence[Component]]:
        """Return the dynamics, the sun, the rotation of a rotating chief, the points and the price of fuel."""
        light, dynamics = self.illumination_params, self.dynamics or ClohessyWiltshire(mean_motion=self.mean_motion)
        spin, free = self.chief_angular_velocity, self.chief_rotation
        turning: tuple[Component, ...] = ()
        if free is not None:
            turning = (ChiefRotation(free=free),)
        elif any(spin):
            turning = (ChiefRotation(angular_velocity=spin),)
        if light is None:
            sun = Sun(rate=self.mean_motion)
        else:
            sun = Sun(rate=light.mean_motion, distance=light.avg_rad_Earth2Sun, **_of(light, SunDirection))
        return dynamics, (
            sun,
            *turning,
            InspectionPoints(**_of(self, CameraAndPoints), report_score=self.delta_v_updater_criteria == "score"),
            FuelPriceSchedule(**_of(self, FuelPrice)),
        )


def _of(model: BaseModel, fields: type[BaseModel]) -> dict[str, Any]:
    """Return the values of the fields that a base class of a model defines, for the component that has them too."""
    return {name: getattr(model, name) for name in fields.model_fields}
