"""Depth cameras and estimators."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from pydantic import Field

from safe_inspect.rendezvous.plugins.base import DepthCameraModel, StateEstimator
from safe_inspect.rendezvous.sensors.tof import PROFILES, DepthCamera, DepthRenderer
from safe_inspect.rendezvous.target.model import Target
from safe_inspect.units import PositiveLength

if TYPE_CHECKING:
    from safe_inspect.rendezvous.estimation.context import EstimatorContext
    from safe_inspect.rendezvous.estimation.measured import MeasuredStateRun
    from safe_inspect.rendezvous.readings import Reading


class TimeOfFlightCamera(DepthCameraModel):
    """A time-of-flight camera of 224 x 171 pixels with noise, dropouts and flying pixels.

    Attributes:
        profile: Its errors: ``ideal`` (none), ``clean``, ``nominal`` or ``harsh``.
        width: Pixels of a row.
        height: Pixels of a column.
        focal_length: Focal length in pixels.
        least_range: Least measured range [m].
        largest_range: Largest measured range [m].
    """

    profile: Literal["ideal", "clean", "nominal", "harsh"] = "nominal"
    width: int = Field(default=224, ge=1)
    height: int = Field(default=171, ge=1)
    focal_length: float = Field(default=186.4, gt=0.0)
    least_range: PositiveLength = 0.2  # type: ignore[valid-type]
    largest_range: PositiveLength = 4.0  # type: ignore[valid-type]

    @property
    def geometry(self) -> DepthCamera:
        """The camera's geometry."""
        return DepthCamera(self.width, self.height, self.focal_length, self.least_range, self.largest_range)

    def __call__(self, target: Target) -> DepthRenderer:
        """Return what takes frames of a target."""
        return DepthRenderer(self.geometry, target.mesh, PROFILES[self.profile])


class MeasuredState(StateEstimator):
    """Knows the states that the sensor ``sensors.state`` measures; between two measurements the target moves freely."""

    @property
    def reads(self) -> tuple[Reading, ...]:
        """What it reads of the sensors."""
        return ("state",)

    def __call__(self, context: EstimatorContext) -> MeasuredStateRun:
        """Return the estimator of a mission."""
        from safe_inspect.rendezvous.estimation.measured import MeasuredStateRun

        return MeasuredStateRun(context)
