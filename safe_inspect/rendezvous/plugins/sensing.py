"""The estimator that knows the truth, with stated errors."""

from __future__ import annotations

from pydantic import Field

from safe_inspect.rendezvous.bound.query import EstimateErrors
from safe_inspect.rendezvous.estimate import EstimatorContext, TruthWithErrors
from safe_inspect.rendezvous.plugins.base import StateEstimator
from safe_inspect.units import NonNegativeAngle, NonNegativeAngularRate


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
        errors = EstimateErrors(self.attitude_sigma, self.rate_sigma)
        return TruthWithErrors(
            errors, self.correlation, context.target.principal, context.period, context.step, context.streams
        )
