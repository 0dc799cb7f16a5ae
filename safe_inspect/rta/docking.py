"""The safety glue of docking: the speed limit about the chief."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property

from pydantic import model_validator

from safe_inspect.dynamics.base import DisturbanceBounds
from safe_inspect.rta.base import Filtered, SafetyGlue, seen_motion
from safe_inspect.rta.constraints.parameters import TaskParameters
from safe_inspect.rta.filters.speed_limit import SpeedLimitFilter
from safe_inspect.simulators.view import View
from safe_inspect.types import BoolArray, FloatArray
from safe_inspect.units import PositiveDuration, PositiveLength, PositiveSpeed


class RTAGlueCWHDocking3d(TaskParameters, SafetyGlue):
    """Run-time assurance of one deputy that docks with a chief at the origin of Hill's frame.

    It keeps the speed below the limit of docking, and the speed along each axis below `vel_limit`, at every moment; see
    `SpeedLimitFilter`. `collision_radius`, `fov` and `psm_horizon` are not used.

    Attributes:
        step_size: Time for which a control is held [s].
        v0_distance: Range up to which the limit is `v0` [m].
        vel_limit: Largest speed, and so the largest along each axis [m/s].
        r_max: Range up to which the promise holds [m].
        disturbance: Bounds of the disturbances under which the limit is kept; None: the motion is that of the model.
    """

    step_size: PositiveDuration = 1.0
    v0_distance: PositiveLength = 0.5
    vel_limit: PositiveSpeed = 10.0
    r_max: PositiveLength = 10_000.0
    disturbance: DisturbanceBounds | None = None

    @model_validator(mode="after")
    def _check(self) -> RTAGlueCWHDocking3d:
        if self.enabled:
            assert self._filter is not None  # wrong parameters are found now, not at the first step
        return self

    @cached_property
    def _filter(self) -> SpeedLimitFilter:
        return SpeedLimitFilter(self, self.disturbance)

    @property
    def units(self) -> dict[str, str]:
        """Unit of the safety quantity."""
        return {"speed_limit": "m/s"}

    def refusals(self, states: Mapping[str, FloatArray]) -> dict[str, BoolArray]:
        """Return the rows that are not below the limit by the filter's margin, NaN included, shape (R,)."""
        return {"speed_limit": ~self._filter.is_safe(states["position"], states["velocity"])}

    def safety(self, states: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
        """Return the limit less the speed [m/s], shape (R,)."""
        return {"speed_limit": self._filter.phi(states["position"], states["velocity"])}

    def filter(self, desired: FloatArray, view: View) -> Filtered:
        """Return the thrust to hold in the next step."""
        return Filtered(self._filter(*seen_motion(view), desired))
