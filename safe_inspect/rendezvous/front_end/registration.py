"""What a registration gives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from safe_inspect.rendezvous.poses import adjoint, inverse
from safe_inspect.types import FloatArray


@dataclass(frozen=True, eq=False)
class Registration:
    """A frame registered to something.

    Attributes:
        pose: The pose, shape (4, 4).
        hessian: Information of its tangent from the right, of the measurement alone, shape (6, 6).
        score: How badly the points fit; what it is depends on the method.
        inliers: Share of the points that lie near the other surface.
        excess: Factor of the inverse Hessian by the residuals, positive: how much larger the errors are than assumed.
        systematic: Covariance of errors that more points do not lower, shape (6, 6); None for none.
    """

    pose: FloatArray
    hessian: FloatArray
    score: float
    inliers: float
    excess: float
    systematic: FloatArray | None = None

    def covariance(self, scale: float = 1.0) -> FloatArray:
        """Return ``scale * excess * H^-1`` plus what is systematic, shape (6, 6).

        Without the latter it is at most about 1 rad and 1 m in any direction.
        """
        covariance = np.asarray(np.linalg.inv(self.hessian / (scale * self.excess) + np.eye(6)), dtype=np.float64)
        return 0.5 * (covariance + covariance.T) + (0.0 if self.systematic is None else self.systematic)


def relative(first: Registration, second: Registration) -> tuple[FloatArray, FloatArray]:
    """Return the pose ``T1^-1 T2`` between two registrations to one thing, and its covariance, shape (6, 6)."""
    between = inverse(first.pose) @ second.pose
    transport = adjoint(inverse(between))
    covariance = transport @ first.covariance() @ transport.T + second.covariance()
    return between, 0.5 * (covariance + covariance.T)
