"""Preintegration of inertial measurements between two frames."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from safe_inspect.rendezvous.libraries import require
from safe_inspect.rendezvous.sensors.imu import ImuNoise
from safe_inspect.types import FloatArray

#: Covariance of the integration itself [m^2/s].
_INTEGRATION = 1e-10
#: Noise densities that represent the motion of a chaser without inertial samples [m/s^2, rad/s per sqrt(Hz)].
_COASTING = (0.05, 0.01)
#: Standard deviations of the bias at a jump [m/s^2, rad/s]; also densities of a noise that covers a jump for a second.
BIAS_JUMP = (0.05, 1e-3)


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
        self._gtsam, self.noise = gtsam, noise
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
        sample = (0.5 * (before[0] + acceleration) - offset[:3], 0.5 * (before[1] + rate) - offset[3:], period)
        self.measurements.integrateMeasurement(*sample)
        self._samples.append(sample)
        self._before = (acceleration, rate)

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
        sample = (acceleration, rate - 0.5 * turned, period)
        self.measurements.integrateMeasurement(*sample)
        self._samples.append(sample)
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
        matrix: FloatArray = self.measurements.deltaRij().matrix()
        return matrix

    @property
    def last_rate(self) -> FloatArray:
        """Last measured angular velocity without the offset of a jump [rad/s], shape (3,)."""
        return np.zeros(3) if self._before is None else self._before[1] - self.jump.offset[3:]
