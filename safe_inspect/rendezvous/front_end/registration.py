"""Result of a registration."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from safe_inspect.rendezvous.poses import adjoint, inverse
from safe_inspect.types import FloatArray


@dataclass(frozen=True, eq=False)
class Registration:
    """Registration of a frame to another frame, a submap or a model.

    Attributes:
        pose: The pose, shape (4, 4).
        hessian: Information matrix of its tangent from the right, from the measurement alone, shape (6, 6).
        score: Misfit of the points, larger is worse; its definition depends on the method.
        inliers: Fraction of the points that are close to the other surface.
        excess: Positive factor of the inverse Hessian, from the residuals: how much larger the errors are than assumed.
        systematic: Covariance of errors that do not decrease with more points, shape (6, 6); None for none.
    """

    pose: FloatArray
    hessian: FloatArray
    score: float
    inliers: float
    excess: float
    systematic: FloatArray | None = None

    def covariance(self, scale: float = 1.0) -> FloatArray:
        """Return ``scale * excess * H^-1`` plus the systematic covariance, shape (6, 6).

        Without the systematic part, the standard deviation is at most about 1 rad and 1 m in any direction.
        """
        covariance = np.asarray(np.linalg.inv(self.hessian / (scale * self.excess) + np.eye(6)), dtype=np.float64)
        return 0.5 * (covariance + covariance.T) + (0.0 if self.systematic is None else self.systematic)


def relative(first: Registration, second: Registration) -> tuple[FloatArray, FloatArray]:
    """Return the pose ``T1^-1 T2`` between two registrations to the same object, and its covariance, shape (6, 6)."""
    between = inverse(first.pose) @ second.pose
    transport = adjoint(inverse(between))
    covariance = transport @ first.covariance() @ transport.T + second.covariance()
    return between, 0.5 * (covariance + covariance.T)
