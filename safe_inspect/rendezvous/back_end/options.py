"""What a factor graph assumes: noise of the inertial unit, priors, and its size."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

from safe_inspect.rendezvous.sensors.imu import ImuNoise
from safe_inspect.types import FloatArray


@dataclass(frozen=True)
class GraphOptions:
    """What a factor graph assumes; standard deviations are of one axis.

    Attributes:
        imu: Errors of the inertial unit.
        attitude: Of the chaser's attitude at the start [rad].
        position: Of its position at the start [m].
        velocity: Of its velocity at the start [m/s].
        kinematic: Of the rotation kinematic factor, which holds the centre of mass at rest in W [m].
        model_centre: Of the model's origin as the centre of mass [m].
        huber: Residual beyond which an edge counts less, in standard deviations.
        relinearise: Change beyond which iSAM2 linearises a variable anew [rad, m, m/s].
        largest: Number of frames beyond which the older half is replaced by priors.
        memory: Time over which errors of poses to the model stay alike [s]: their covariances are multiplied by
            ``(1 + rho) / (1 - rho)`` with ``rho = exp(-dt / memory)``; 0 for independent ones.
    """

    imu: ImuNoise = field(default_factory=ImuNoise)
    attitude: float = 1e-4
    position: float = 1e-4
    velocity: float = 1e-3
    kinematic: float = 5e-3
    model_centre: float = 1e-3
    huber: float = 1.345
    relinearise: float = 1e-3
    largest: int = 600
    memory: float = 0.0


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
