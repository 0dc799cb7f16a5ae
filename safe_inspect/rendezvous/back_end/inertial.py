"""Preintegration of inertial measurements between two frames."""

from __future__ import annotations

from typing import Any

import numpy as np

from safe_inspect.rendezvous.libraries import require
from safe_inspect.rendezvous.sensors.imu import ImuNoise
from safe_inspect.types import FloatArray

#: Covariance of the integration itself [m^2/s].
_INTEGRATION = 1e-10


class ImuBuffer:
    """Measurements since the last frame, integrated by the trapezoidal rule, without gravity.

    Source:
        Forster et al., "On-manifold preintegration for real-time visual-inertial odometry", IEEE T-RO 33 (2017).

    Args:
        noise: Errors of the unit, per sample.
        period: Time between samples [s].
    """

    def __init__(self, noise: ImuNoise, period: float) -> None:
        gtsam = require("gtsam")
        parameters = gtsam.PreintegrationParams(np.zeros(3))
        parameters.setAccelerometerCovariance(np.eye(3) * noise.acceleration**2 * period)
        parameters.setGyroscopeCovariance(np.eye(3) * noise.rate**2 * period)
        parameters.setIntegrationCovariance(np.eye(3) * _INTEGRATION)
        self._gtsam, self._parameters = gtsam, parameters
        self._before: tuple[FloatArray, FloatArray] | None = None
        self._bias: Any = gtsam.imuBias.ConstantBias()
        self.measurements: Any = gtsam.PreintegratedImuMeasurements(parameters, self._bias)

    @property
    def duration(self) -> float:
        """Time since the last frame that is covered [s]."""
        return float(self.measurements.deltaTij())

    def add(self, acceleration: FloatArray, rate: FloatArray, period: float) -> None:
        """Add a sample at the end of an interval.

        Args:
            acceleration: Specific force in B [m/s^2], shape (3,).
            rate: Angular velocity in B [rad/s], shape (3,).
            period: Time since the last sample [s].
        """
        before = self._before or (acceleration, rate)
        self.measurements.integrateMeasurement(0.5 * (before[0] + acceleration), 0.5 * (before[1] + rate), period)
        self._before = (acceleration, rate)

    def restart(self, bias: Any) -> None:
        """Start anew at a frame, about a bias."""
        self._bias = bias
        self.measurements = self._gtsam.PreintegratedImuMeasurements(self._parameters, bias)

    def predict(self, pose: Any, velocity: FloatArray, bias: Any) -> tuple[Any, FloatArray]:
        """Return pose and velocity now, from those at the last frame."""
        if self.duration == 0.0:
            return pose, velocity
        state = self.measurements.predict(self._gtsam.NavState(pose, velocity), bias)
        return state.pose(), state.velocity()

    @property
    def rotation(self) -> FloatArray:
        """R_B'B from B now to B' at the last frame, shape (3, 3)."""
        matrix: FloatArray = self.measurements.deltaRij().matrix()
        return matrix

    @property
    def last_rate(self) -> FloatArray:
        """The last measured angular velocity [rad/s], shape (3,)."""
        return np.zeros(3) if self._before is None else self._before[1]
