"""Factors of the motion that the inertial unit measures between two frames."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from safe_inspect.rendezvous.back_end.factors import key
from safe_inspect.rendezvous.back_end.inertial import BIAS_JUMP, ImuBuffer
from safe_inspect.rendezvous.libraries import require

#: Standard deviation of the chaser's motion between two frames without an inertial sample [rad, m, m/s].
_UNMEASURED = 0.3
#: Minimum standard deviation of the bias's random walk between two frames [m/s^2, rad/s].
_LEAST_WALK = (1e-5, 1e-6)


class InertialFactor(NamedTuple):
    """Factor together with its replacement after a jump of the bias.

    Attributes:
        usual: Factor with the noise of the unit.
        loose: Factor with a noise that covers a jump.
    """

    usual: Any
    loose: Any


def inertial_factors(before: int, frame: int, imu: ImuBuffer) -> list[InertialFactor]:
    """Return the factors on pose, velocity and bias of two consecutive frames.

    Args:
        before: Number of the earlier frame.
        frame: Number of the later frame.
        imu: Inertial measurements between them.
    """
    gtsam = require("gtsam")
    models, bias = gtsam.noiseModel, gtsam.imuBias.ConstantBias(imu.jump.offset[:3], imu.jump.offset[3:])
    keys = [key("X", before), key("V", before), key("X", frame), key("V", frame), key("B", before)]
    if imu.duration > 0.0:
        usual, loose = (gtsam.ImuFactor(*keys, imu.integrated(jumped=jumped)) for jumped in (False, True))
        factors = [InertialFactor(usual, loose)]
    else:
        rest = gtsam.BetweenFactorPose3(keys[0], keys[2], gtsam.Pose3(), models.Isotropic.Sigma(6, _UNMEASURED))
        same = gtsam.BetweenFactorVector(keys[1], keys[3], np.zeros(3), models.Isotropic.Sigma(3, _UNMEASURED))
        factors = [InertialFactor(rest, rest), InertialFactor(same, same)]
    walk = np.sqrt(max(imu.duration, 1e-3)) * np.array([imu.noise.acceleration_walk, imu.noise.rate_walk])
    usual, loose = (
        gtsam.BetweenFactorConstantBias(
            key("B", before),
            key("B", frame),
            bias,
            models.Diagonal.Sigmas(np.repeat(sigmas, 3)),
        )
        for sigmas in (np.hypot(np.maximum(walk, _LEAST_WALK), imu.jump.sigma), BIAS_JUMP)
    )
    return [*factors, InertialFactor(usual, loose)]
