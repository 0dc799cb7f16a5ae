"""Depth cameras and estimators."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from pydantic import Field

from safe_inspect.rendezvous.plugins.base import DepthCameraModel, StateEstimator
from safe_inspect.rendezvous.sensors.tof import PROFILES, DepthCamera, DepthRenderer
from safe_inspect.rendezvous.target.model import Target
from safe_inspect.units import NonNegativeAngle, NonNegativeAngularRate, PositiveLength

if TYPE_CHECKING:
    from safe_inspect.rendezvous.estimate import EstimatorContext, TruthWithErrors


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


class TruthEstimator(StateEstimator):
    """Knows the truth, with stated Gaussian errors of the target's attitude and rate that change at each update.

    Attributes:
        attitude_sigma: Standard deviation of the attitude about each principal axis [rad].
        rate_sigma: Standard deviation of each component of the angular velocity [rad/s].
        correlation: Correlation of the errors of two updates that follow each other.
    """

    attitude_sigma: NonNegativeAngle = 0.0  # type: ignore[valid-type]
    rate_sigma: NonNegativeAngularRate = 0.0  # type: ignore[valid-type]
    correlation: float = Field(default=0.9, ge=0.0, lt=1.0)

    def __call__(self, context: EstimatorContext) -> TruthWithErrors:
        """Return the estimator of a mission."""
        from safe_inspect.rendezvous.bound.query import EstimateErrors
        from safe_inspect.rendezvous.estimate import TruthWithErrors

        errors = EstimateErrors(self.attitude_sigma, self.rate_sigma)
        return TruthWithErrors(
            errors, self.correlation, context.target.principal, context.period, context.step, context.streams
        )
