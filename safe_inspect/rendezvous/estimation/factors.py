"""Factors of the graph, made of factors of gtsam: preintegrated inertial samples, relative poses, and priors."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from safe_inspect.rendezvous.inertial_unit import ImuNoise
from safe_inspect.rendezvous.libraries import require
from safe_inspect.rendezvous.poses import Edge
from safe_inspect.types import FloatArray

#: Covariance of the integration itself [m^2/s].
_INTEGRATION = 1e-10
#: Noise densities that represent the motion of a chaser without inertial samples [m/s^2, rad/s per sqrt(Hz)].
_COASTING = (0.05, 0.01)
#: Standard deviations of the bias at a jump [m/s^2, rad/s]; also densities of a noise that covers a jump for a second.
BIAS_JUMP = (0.05, 1e-3)
#: Standard deviation of the chaser's motion between two frames without an inertial sample [rad, m, m/s].
_UNMEASURED = 0.3
#: Minimum standard deviation of the bias's random walk between two frames [m/s^2, rad/s].
_LEAST_WALK = (1e-5, 1e-6)
#: Types of the variables, as in the names of gtsam's priors, and letters of the variables that belong to a frame.
_TYPES = dict.fromkeys("XGM", "Pose3") | dict.fromkeys("YOPZ", "Point3") | {"V": "Vector", "B": "ConstantBias"}
OF_FRAMES = "XVBGY"


class BiasJump(NamedTuple):
    """Jump of the biases between two frames.

    Attributes:
        offset: Change of the biases [m/s^2, rad/s], shape (6,).
        sigma: Standard deviations of one axis of each, shape (2,).
        within: Duration within which it happened [s].
    """

    offset: FloatArray
    sigma: FloatArray
    within: float


_NO_JUMP = BiasJump(np.zeros(6), np.zeros(2), 0.0)


class ImuBuffer:
    """Inertial measurements since the last frame, integrated by the trapezoidal rule, without gravity.

    Source:
        Forster et al., "On-manifold preintegration for real-time visual-inertial odometry", IEEE T-RO 33 (2017).

    Args:
        noise: Errors of the unit, per sample.
        period: Time between samples [s].
    """

    def __init__(self, noise: ImuNoise, period: float) -> None:
        gtsam = require("gtsam")
        self._gtsam, self.noise, self.period = gtsam, noise, period
        self._densities = np.array([noise.acceleration, noise.rate]) * np.sqrt(period)
        self._before: tuple[FloatArray, FloatArray] | None = None
        self._samples: list[tuple[FloatArray, FloatArray, float]] = []
        self.is_coasting = False
        self.restart(gtsam.imuBias.ConstantBias())

    @property
    def duration(self) -> float:
        """Integrated time since the last frame [s]."""
        return float(self.measurements.deltaTij())

    def add(self, acceleration: FloatArray, rate: FloatArray, period: float) -> None:
        """Add a sample at the end of an interval.

        Args:
            acceleration: Specific force in B [m/s^2], shape (3,).
            rate: Angular velocity in B [rad/s], shape (3,).
            period: Time since the last sample [s].
        """
        before, offset = self._before or (acceleration, rate), self.jump.offset
        self._take(0.5 * (before[0] + acceleration) - offset[:3], 0.5 * (before[1] + rate) - offset[3:], period)
        self._before = (acceleration, rate)

    def _take(self, *sample: Any) -> None:
        """Integrate a mean acceleration [m/s^2] and rate [rad/s] over a period [s]."""
        self.measurements.integrateMeasurement(*sample)
        self._samples.append(sample)

    def correct(self, jump: BiasJump) -> None:
        """Assume from the next sample on that the biases have changed by a jump.

        Until the next frame, the offset is subtracted from the samples. At the frame, the random walk of the bias gets
        the offset and its covariance, so that the graph estimates the bias, and the inertial factor of the interval
        gets the noise that the jump causes.
        """
        self.jump = jump

    def coast(self, period: float, commanded: FloatArray) -> None:
        """Assume that the commanded motion was flown in a period without a sample, from the last angular velocity on.

        Args:
            period: Length of the period [s].
            commanded: Acceleration and angular acceleration in B [m/s^2, rad/s^2], shape (6,); zeros for free flight.
        """
        self.is_coasting = True
        acceleration, turned = self._bias.accelerometer() + commanded[:3], commanded[3:] * period
        rate, offset = self.last_rate + turned, self.jump.offset
        self._take(acceleration, rate - 0.5 * turned, period)
        self._before = (acceleration + offset[:3], rate + offset[3:])

    def restart(self, bias: Any) -> None:
        """Clear the buffer at a frame and integrate from there with a given bias."""
        self._bias, self.is_coasting, self.jump = bias, False, _NO_JUMP
        self._samples = []
        self.measurements = self._integration(self._densities)

    def integrated(self, *, jumped: bool) -> Any:
        """Return the integrated samples, with their noise or with that of an unmeasured motion or a bias jump."""
        if not (self.is_coasting or jumped or self.jump.within):
            return self.measurements
        if self.is_coasting or jumped:
            densities = np.array(_COASTING if self.is_coasting else BIAS_JUMP)
        else:
            size = np.abs(self.jump.offset).reshape(2, 3).max(axis=1)
            change = self.jump.within * size + self.duration * self.jump.sigma
            densities = np.hypot(self._densities, change / np.sqrt(self.duration))
        again = self._integration(densities)
        for sample in self._samples:
            again.integrateMeasurement(*sample)
        return again

    def _integration(self, densities: FloatArray) -> Any:
        parameters = self._gtsam.PreintegrationParams(np.zeros(3))
        parameters.setAccelerometerCovariance(np.eye(3) * densities[0] ** 2)
        parameters.setGyroscopeCovariance(np.eye(3) * densities[1] ** 2)
        parameters.setIntegrationCovariance(np.eye(3) * _INTEGRATION)
        return self._gtsam.PreintegratedImuMeasurements(parameters, self._bias)

    def predict(self, pose: Any, velocity: FloatArray, bias: Any) -> tuple[Any, FloatArray]:
        """Return pose and velocity at the last sample, given those at the last frame."""
        if self.duration == 0.0:
            return pose, velocity
        state = self.measurements.predict(self._gtsam.NavState(pose, velocity), bias)
        return state.pose(), state.velocity()

    @property
    def rotation(self) -> FloatArray:
        """Rotation R_B'B from B now to B' at the last frame, shape (3, 3)."""
        return np.asarray(self.measurements.deltaRij().matrix())

    @property
    def last_rate(self) -> FloatArray:
        """Last measured angular velocity without the offset of a jump [rad/s], shape (3,)."""
        return np.zeros(3) if self._before is None else self._before[1] - self.jump.offset[3:]


def key(letter: str, index: int = 0) -> int:
    """Return the key of a variable.

    Variables of each frame: X is T_WB, V the velocity in W, B the bias, G the pose T_GB and Y the centre of mass in B.
    Constant variables: O is the centre of mass in G, P that in W, M the pose T_GM and Z the centre of mass in M.
    """
    return int(require("gtsam").symbol(letter.lower(), index))


def edge_factor(edge: Edge, first: int, second: int, huber: float) -> Any:
    """Return ``T_ij = G_i^-1 G_j`` with Huber's weights as a factor between two keys."""
    gtsam = require("gtsam")
    models = gtsam.noiseModel
    gaussian = models.Gaussian.Covariance(np.ascontiguousarray(edge.covariance))
    noise = models.Robust.Create(models.mEstimator.Huber.Create(huber), gaussian)
    return gtsam.BetweenFactorPose3(first, second, gtsam.Pose3(edge.pose), noise)


def rotation_kinematic_factors(frame: int, sigma: float) -> list[Any]:
    """Return ``X^-1 p_W - G^-1 o = 0`` for one frame: the target rotates about a centre that is at rest in W.

    It is expressed with an auxiliary point y, the centre in B: ``X y = p_W`` and ``G y = o``, each with
    sigma / sqrt(2). Eliminating y gives the factor above with sigma.

    Source:
        Setterfield et al., "Mapping and determining the center of mass of a rotating object using a moving observer",
        IJRR 37 (2018).
    """
    gtsam = require("gtsam")
    noise = gtsam.noiseModel.Isotropic.Sigma(3, sigma / np.sqrt(2.0))
    y = key("Y", frame)
    return [
        gtsam.ReferenceFrameFactorPoint3Pose3(y, key("X", frame), key("P"), noise),
        gtsam.ReferenceFrameFactorPoint3Pose3(y, key("G", frame), key("O"), noise),
    ]


def model_centre_factors(sigma: float) -> list[Any]:
    """Return factors for ``o = T_GM z`` and ``z = 0``: the model's origin is the centre of mass."""
    gtsam = require("gtsam")
    noise = gtsam.noiseModel.Isotropic.Sigma(3, sigma)
    return [
        gtsam.ReferenceFrameFactorPoint3Pose3(key("Z"), key("M"), key("O"), noise),
        gtsam.PriorFactorPoint3(key("Z"), np.zeros(3), gtsam.noiseModel.Isotropic.Sigma(3, sigma)),
    ]


def inertial_factors(before: int, frame: int, imu: ImuBuffer) -> list[tuple[Any, Any]]:
    """Return the factors on pose, velocity and bias of two consecutive frames.

    Each is returned with the noise of the unit and again with a noise that covers a jump of the bias.

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
        factors = [(usual, loose)]
    else:
        rest = gtsam.BetweenFactorPose3(keys[0], keys[2], gtsam.Pose3(), models.Isotropic.Sigma(6, _UNMEASURED))
        same = gtsam.BetweenFactorVector(keys[1], keys[3], np.zeros(3), models.Isotropic.Sigma(3, _UNMEASURED))
        factors = [(rest, rest), (same, same)]
    walk = np.sqrt(max(imu.duration, 1e-3)) * np.array([imu.noise.acceleration_walk, imu.noise.rate_walk])
    noises = (np.hypot(np.maximum(walk, _LEAST_WALK), imu.jump.sigma), BIAS_JUMP)
    usual, loose = (
        gtsam.BetweenFactorConstantBias(keys[4], key("B", frame), bias, models.Diagonal.Sigmas(np.repeat(sigmas, 3)))
        for sigmas in noises
    )
    return [*factors, (usual, loose)]


def value_of(values: Any, letter: str, index: int = 0) -> Any:
    """Return the value of a variable from a `gtsam.Values`; for the letters see `key`."""
    return getattr(values, f"at{_TYPES[letter]}")(key(letter, index))


def marginal_factors(factors: Sequence[Any], values: Any, eliminated: Sequence[int]) -> list[Any]:
    """Return what factors say about their other variables when some are eliminated: factors linear about `values`.

    Args:
        factors: The factors.
        values: Values of their variables, a `gtsam.Values`.
        eliminated: Keys of the variables that are eliminated.
    """
    gtsam = require("gtsam")
    graph = gtsam.NonlinearFactorGraph()
    for factor in factors:
        graph.add(factor)
    _, rest = graph.linearize(values).eliminatePartialMultifrontal(eliminated, gtsam.EliminateQR)
    return [gtsam.LinearContainerFactor(rest.at(k), values) for k in range(rest.size())]
