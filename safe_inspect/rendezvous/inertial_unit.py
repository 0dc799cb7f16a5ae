"""An inertial measurement unit: gyroscopes and accelerometers with noise and drifting biases."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from safe_inspect.random.streams import Streams
from safe_inspect.types import FloatArray


@dataclass(frozen=True)
class ImuNoise:
    """Errors of the inertial unit, each as the standard deviation of one axis.

    Attributes:
        acceleration: Noise of a sample of the specific force [m/s^2].
        rate: Noise of a sample of the angular velocity [rad/s].
        acceleration_bias: Initial bias of the specific force [m/s^2].
        rate_bias: Initial bias of the angular velocity [rad/s].
        acceleration_walk: Random walk of the bias of the specific force [m/s^2 per sqrt(s)].
        rate_walk: Random walk of the bias of the angular velocity [rad/s per sqrt(s)].
    """

    acceleration: float = 2e-3
    rate: float = 1.5e-4
    acceleration_bias: float = 1e-3
    rate_bias: float = 5e-5
    acceleration_walk: float = 1e-5
    rate_walk: float = 1e-6

    def in_units_of(self, length: float) -> ImuNoise:
        """Return the errors with all lengths divided by a length [m]."""
        names = ("acceleration", "acceleration_bias", "acceleration_walk")
        return replace(self, **{name: getattr(self, name) / length for name in names})


def checked_noise(noise: ImuNoise) -> ImuNoise:
    """Return the errors of an inertial unit after checking that an estimator can compute weights from them.

    Raises:
        ValueError: An error is not a positive number.
    """
    for name, value in vars(noise).items():
        if not (math.isfinite(value) and value > 0.0):
            raise ValueError(f"{name} is {value:g}; an estimator needs a positive standard deviation, however small")
    return noise


class InertialSample(NamedTuple):
    """The inertial measurement at one time.

    Attributes:
        time: Time since the start of the control step [s].
        acceleration: Specific force in B [m/s^2], shape (3,).
        rate: Angular velocity in B [rad/s], shape (3,).
    """

    time: float
    acceleration: FloatArray
    rate: FloatArray


class Imu:
    """The inertial unit of one mission, whose only memory are the biases.

    In B it measures ``a = p'' + b_a + n_a`` (without gravity, as in free fall) and ``w = omega + b_g + n_g``.

    Args:
        noise: Errors of the unit.
        period: Time between samples [s].
        streams: The random streams of one mission.
    """

    def __init__(self, noise: ImuNoise, period: float, streams: Streams) -> None:
        self._noise, self._period, self._streams = noise, period, streams
        self._bias = streams.normal("imu.bias", 6)[0] * np.repeat([noise.acceleration_bias, noise.rate_bias], 3)
        self._count = 0

    def measure(self, accelerations: FloatArray, angular_velocities: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return specific forces [m/s^2] and angular velocities [rad/s] of the next samples in B, shape (n, 3) each.

        Args:
            accelerations: Accelerations of the centre of mass in B, without gravity [m/s^2], shape (n, 3).
            angular_velocities: Angular velocities in B [rad/s], shape (n, 3).
        """
        noise, number = self._noise, len(accelerations)
        drawn = self._streams.normal("imu.samples", 12 * number, self._count)[0].reshape(number, 12)
        walk = np.repeat([noise.acceleration_walk, noise.rate_walk], 3) * np.sqrt(self._period)
        biases = self._bias + np.cumsum(np.concatenate((np.zeros((1, 6)), walk * drawn[:, 6:])), axis=0)
        errors = biases[:-1] + drawn[:, :6] * np.repeat([noise.acceleration, noise.rate], 3)
        self._bias, self._count = biases[-1], self._count + 1
        return accelerations + errors[:, :3], angular_velocities + errors[:, 3:]
