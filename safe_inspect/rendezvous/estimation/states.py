"""Initial state of a back end, and its estimate after a frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from safe_inspect.types import FloatArray

#: Standard deviation of the centre's prior as a fraction of the radius that the target sweeps.
_CENTRE_SHARE = 0.4


class ChaserStart(NamedTuple):
    """State of the chaser at the first frame.

    Attributes:
        pose: T_WB, shape (4, 4) [-, m].
        velocity: Velocity in W [m/s], shape (3,).
    """

    pose: FloatArray
    velocity: FloatArray


class CentrePrior(NamedTuple):
    """Prior of the target's centre of mass.

    Attributes:
        position: Expected position in W [m], shape (3,).
        sigma: Standard deviation along each axis [m].
    """

    position: FloatArray
    sigma: float

    @classmethod
    def seen(cls, points: FloatArray, start: ChaserStart, mount: FloatArray, radius: float | None) -> CentrePrior:
        """Return the prior about the mean of the points that a frame sees, or in front of the camera without any.

        Args:
            points: Points in C [m], shape (n, 3).
            start: State of the chaser.
            mount: Pose T_BC of the camera in B, shape (4, 4).
            radius: Radius that the target sweeps [m]; None if it is not known.
        """
        radius = 1.0 if radius is None else radius
        if len(points):
            place, sigma = points.mean(axis=0), _CENTRE_SHARE * radius
        else:
            place, sigma = np.array([0.0, 0.0, max(1.3 * radius, 0.5)]), 0.6 * radius
        in_body = mount[:3, :3] @ place + mount[:3, 3]
        return cls(start.pose[:3, :3] @ in_body + start.pose[:3, 3], sigma)


@dataclass(frozen=True, eq=False)
class GraphEstimate:
    """Estimate of a factor graph after a frame.

    Attributes:
        frame: Number of the frame.
        chaser: T_WB, shape (4, 4) [-, m].
        velocity: Velocity of the chaser in W [m/s], shape (3,).
        bias: Biases of the accelerometers [m/s^2] and gyroscopes [rad/s], shape (6,).
        relative: T_GB, shape (4, 4) [-, m]; None if the frame has no edge.
        centre: Centre of mass in W [m], shape (3,).
        centre_glued: Centre of mass in G [m], shape (3,).
        model: T_GM, shape (4, 4) [-, m]; None without a pose relative to the model.
        chaser_covariance: Covariance of the tangent of T_WB (rotation [rad], translation [m]), shape (6, 6).
        velocity_covariance: Covariance of the velocity in W [m^2/s^2], shape (3, 3).
        centre_covariance: Covariance of the centre of mass in B, that is, relative to the chaser [m^2], shape (3, 3).
    """

    frame: int
    chaser: FloatArray
    velocity: FloatArray
    bias: FloatArray
    relative: FloatArray | None
    centre: FloatArray
    centre_glued: FloatArray
    model: FloatArray | None
    chaser_covariance: FloatArray
    velocity_covariance: FloatArray
    centre_covariance: FloatArray


def largest_sigma(covariance: FloatArray) -> float:
    """Return the largest standard deviation of a covariance along any direction, shape (n, n)."""
    return float(np.sqrt(max(np.linalg.eigvalsh(covariance)[-1], 0.0)))
