"""`InspectionSimulator`: deputies inspect the lit points of a chief in Clohessy-Wiltshire dynamics."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal

from pydantic import Field, model_validator

from safe_inspect.dynamics.base import Dynamics
from safe_inspect.dynamics.clohessy_wiltshire import ClohessyWiltshire
from safe_inspect.simulators.component import Component
from safe_inspect.simulators.simulator import Simulator
from safe_inspect.tasks.inspection.fuel_price import FuelPriceSchedule, check_interval
from safe_inspect.tasks.inspection.illumination import IlluminationParams
from safe_inspect.tasks.inspection.points import InspectionPoints, SpherePoints, check_field_of_view
from safe_inspect.tasks.inspection.sun import Sun
from safe_inspect.units import Angle, PositiveAngularRate


class InspectionSimulator(Simulator):
    """One chief, its points, the sun, and deputies that look at the chief.

    It composes `ClohessyWiltshire`, `Sun`, `InspectionPoints` and `FuelPriceSchedule`.

    Attributes:
        inspection_points_map: Points by the body that carries them.
        illumination_params: The sun's light; None: every point is lit at all times.
        mean_motion: Mean motion of the chief's circular orbit [rad/s].
        field_of_view: Full angle of the camera's cone about the line to the chief's centre [rad].
        steps_until_update: Steps of a slot between two updates of its delta-v scale.
        delta_v_scale_bounds: Smallest and largest scale of the delta-v reward [1/(m/s)]; it starts at the largest.
        delta_v_scale_step: Change of the scale at an update.
        inspected_points_update_bounds: The scale moves back when the mean inspected fraction at the end of an
            episode is at most the first, and on when it is at least the second.
        delta_v_updater_criteria: What moves the scale: ``count``, the inspected fraction of the points, or ``score``,
            the summed weight of the inspected points, which infos and tables then have too.
    """

    inspection_points_map: dict[str, SpherePoints] = Field(default_factory=lambda: {"chief": SpherePoints()})
    illumination_params: IlluminationParams | None = IlluminationParams()
    mean_motion: PositiveAngularRate = 0.001027
    field_of_view: Angle = math.pi
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
        return self

    def compose(self) -> tuple[Dynamics, Sequence[Component]]:
        """Return the dynamics, the sun, the points and the price of fuel."""
        light = self.illumination_params
        return ClohessyWiltshire(mean_motion=self.mean_motion), (
            Sun(rate=self.mean_motion if light is None else light.mean_motion),
            InspectionPoints(
                inspection_points_map=self.inspection_points_map,
                illumination_params=light,
                field_of_view=self.field_of_view,
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
