"""Safety glue of docking, which enforces the speed limit near the chief."""

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
    """Run-time assurance for one deputy that docks with a chief at the origin of Hill's frame.

    It keeps the speed below the limit of docking, and the speed along each axis below `vel_limit`, at every moment; see
    `SpeedLimitFilter`. `collision_radius`, `fov` and `psm_horizon` are not used.

    Attributes:
        step_size: Time for which a control is held [s].
        v0_distance: Range up to which the limit is `v0` [m].
        vel_limit: Largest speed, and therefore the largest speed along each axis [m/s].
        r_max: Range up to which the guarantee is valid [m].
        disturbance: Bounds of the disturbances under which the limit is enforced; None: the motion is that of the
            model.
    """

    step_size: PositiveDuration = 1.0
    v0_distance: PositiveLength = 0.5
    vel_limit: PositiveSpeed = 10.0
    r_max: PositiveLength = 10_000.0
    disturbance: DisturbanceBounds | None = None

    @model_validator(mode="after")
    def _check(self) -> RTAGlueCWHDocking3d:
        if self.enabled:
            assert self._filter is not None  # Reports wrong parameters now, not at the first step.
        return self

    @cached_property
    def _filter(self) -> SpeedLimitFilter:
        return SpeedLimitFilter(self, self.disturbance)

    @property
    def units(self) -> dict[str, str]:
        """Unit of the safety quantity."""
        return {"speed_limit": "m/s"}

    def refusals(self, states: Mapping[str, FloatArray]) -> dict[str, BoolArray]:
        """Return the mask of the states that are not below the limit by the filter's margin, NaN included, (R,)."""
        return {"speed_limit": ~self._filter.is_safe(states["position"], states["velocity"])}

    def safety(self, states: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
        """Return the limit minus the speed [m/s], shape (R,)."""
        return {"speed_limit": self._filter.phi(states["position"], states["velocity"])}

    def filter(self, desired: FloatArray, view: View) -> Filtered:
        """Return the thrust to hold during the next step."""
        return Filtered(self._filter(*seen_motion(view), desired))
