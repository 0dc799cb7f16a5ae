"""What a back end starts from, and what it knows after a frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from safe_inspect.types import FloatArray


class ChaserStart(NamedTuple):
    """The chaser at the first frame.

    Attributes:
        pose: T_WB, shape (4, 4) [-, m].
        velocity: In W [m/s], shape (3,).
    """

    pose: FloatArray
    velocity: FloatArray


class CentrePrior(NamedTuple):
    """Where the target's centre of mass may be.

    Attributes:
        position: In W [m], shape (3,).
        sigma: Standard deviation of each axis [m].
    """

    position: FloatArray
    sigma: float


@dataclass(frozen=True, eq=False)
class GraphEstimate:
    """What a factor graph knows after a frame.

    Attributes:
        frame: Number of the frame.
        chaser: T_WB, shape (4, 4) [-, m].
        velocity: Of the chaser in W [m/s], shape (3,).
        bias: Of the accelerometers [m/s^2] and gyroscopes [rad/s], shape (6,).
        relative: T_GB, shape (4, 4) [-, m]; None where no edge has reached the frame.
        centre: Centre of mass in W [m], shape (3,).
        centre_glued: Centre of mass in G [m], shape (3,).
        model: T_GM, shape (4, 4) [-, m]; None without a pose to the model.
        chaser_covariance: Of the tangent of T_WB (rotation [rad], translation [m]), shape (6, 6).
        velocity_covariance: In W [m^2/s^2], shape (3, 3).
        centre_covariance: Of the centre of mass in B, that is relative to the chaser [m^2], shape (3, 3).
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
