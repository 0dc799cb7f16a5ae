"""`InspectionSimulator`: deputies inspect the lit points of a chief in Clohessy-Wiltshire dynamics."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal

from pydantic import Field, model_validator

from safe_inspect.dynamics.attitude.clohessy_wiltshire_attitude import ClohessyWiltshireAttitude
from safe_inspect.dynamics.base import Dynamics
from safe_inspect.dynamics.clohessy_wiltshire import ClohessyWiltshire
from safe_inspect.dynamics.orbit.earth import earth_shadow
from safe_inspect.plugins.functor import functor_field
from safe_inspect.simulators.component import Component
from safe_inspect.simulators.simulator import Simulator
from safe_inspect.tasks.inspection.free_rotation import FreeRotation
from safe_inspect.tasks.inspection.fuel_price import FuelPriceSchedule, check_interval
from safe_inspect.tasks.inspection.illumination import IlluminationParams
from safe_inspect.tasks.inspection.points import InspectionPoints, SpherePoints, check_field_of_view
from safe_inspect.tasks.inspection.rotation import ChiefRotation
from safe_inspect.tasks.inspection.sun import Sun
from safe_inspect.units import Angle, AngularRate, ConeOfView, PositiveAngularRate


class InspectionSimulator(Simulator):
    """Simulator of one chief with points, the sun, and deputies that inspect the chief.

    It composes `ClohessyWiltshire`, `Sun`, `InspectionPoints` and `FuelPriceSchedule`, and `ChiefRotation` for a
    rotating chief. With platforms that rotate (``platform: six-dof``), the dynamics are `ClohessyWiltshireAttitude`,
    and the camera rotates with the deputy.

    Attributes:
        inspection_points_map: Points by the body that carries them.
        illumination_params: The sunlight; None: every point is lit at all times.
        mean_motion: Mean motion of the chief's circular orbit [rad/s].
        dynamics: Dynamics of the deputies, to set other values than the defaults. Its mean motion is the chief's.
        field_of_view: Full angle of the camera's cone about the line to the chief's centre [rad].
        sensor_fov: Full angle of the cone of a camera that rotates with the deputy [rad], by default 2 pi; requires
            platforms that rotate.
        initial_sensor_unit_vec: Axis of that camera in body axes.
        chief_angular_velocity: Constant angular velocity of the body ``chief`` relative to Hill's frame, along Hill's
            axes [rad/s], see `ChiefRotation`; by default, it is zero.
        chief_rotation: Torque-free rotation of that body in inertial space, drawn at each reset, see `FreeRotation`.
        steps_until_update: Steps of a slot between two updates of its delta-v scale.
        delta_v_scale_bounds: Smallest and largest scale of the delta-v reward [1/(m/s)]; it starts at the largest.
        delta_v_scale_step: Change of the scale at an update.
        inspected_points_update_bounds: The step is subtracted from the scale if the mean inspected fraction at the end
            of an episode is at most the first value, and added if it is at least the second.
        delta_v_updater_criteria: Quantity that is compared: ``count``, the inspected fraction of the points, or
            ``score``, the summed weight of the inspected points, which infos and tables then also contain.
    """

    inspection_points_map: dict[str, SpherePoints] = Field(default_factory=lambda: {"chief": SpherePoints()})
    illumination_params: IlluminationParams | None = IlluminationParams()
    mean_motion: PositiveAngularRate = 0.001027
    dynamics: functor_field("dynamics") | None = None  # type: ignore[valid-type]
    field_of_view: Angle = math.pi
    sensor_fov: ConeOfView | None = None
    initial_sensor_unit_vec: tuple[float, float, float] = (1.0, 0.0, 0.0)
    chief_angular_velocity: tuple[AngularRate, AngularRate, AngularRate] = (0.0, 0.0, 0.0)
    chief_rotation: FreeRotation | None = None
    steps_until_update: int = Field(default=1500, ge=1)
    delta_v_scale_bounds: tuple[float, float] = (-0.1, -0.001)
    delta_v_scale_step: float = -0.00005
    inspected_points_update_bounds: tuple[float, float] = (0.8, 0.9)
    delta_v_updater_criteria: Literal["count", "score"] = "count"

    @model_validator(mode="after")
    def _consistent(self) -> InspectionSimulator:
        for field in ("delta_v_scale_bounds", "inspected_points_update_bounds"):
            check_interval(field, *getattr(self, field))
        check_field_of_view(self.field_of_view)
        if self.chief_rotation is not None and any(self.chief_angular_velocity):
            raise ValueError("`chief_rotation` and `chief_angular_velocity` exclude each other; remove one of them")
        if self.illumination_params is not None and self.illumination_params.eclipse:
            earth_shadow(self.mean_motion, self.illumination_params.avg_rad_Earth2Sun)
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
        return dynamics, (
            Sun(rate=self.mean_motion)
            if light is None
            else Sun(
                rate=light.mean_motion,
                eclipse=light.eclipse,
                distance=light.avg_rad_Earth2Sun,
                beta_angle=light.beta_angle,
                date=light.date,
            ),
            *turning,
            InspectionPoints(
                inspection_points_map=self.inspection_points_map,
                illumination_params=light,
                field_of_view=self.field_of_view,
                sensor_fov=self.sensor_fov,
                initial_sensor_unit_vec=self.initial_sensor_unit_vec,
                report_score=self.delta_v_updater_criteria == "score",
            ),
            FuelPriceSchedule(
                steps_until_update=self.steps_until_update,
                delta_v_scale_bounds=self.delta_v_scale_bounds,
                delta_v_scale_step=self.delta_v_scale_step,
                inspected_points_update_bounds=self.inspected_points_update_bounds,
                delta_v_updater_criteria=self.delta_v_updater_criteria,
            ),
        )
