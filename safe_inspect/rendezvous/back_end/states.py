"""Initial state of a back end, and its estimate after a frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from safe_inspect.types import FloatArray


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
