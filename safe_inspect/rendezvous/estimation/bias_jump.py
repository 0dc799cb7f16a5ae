"""Jumps of an inertial unit's biases, suspected where it disagrees with what the actuators are expected to give."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from safe_inspect.rendezvous.back_end.inertial import BIAS_JUMP, BiasJump
from safe_inspect.rendezvous.estimation.response import ExpectedMotion
from safe_inspect.rendezvous.sensors.imu import ImuNoise, InertialSample
from safe_inspect.types import FloatArray

#: Innovation beyond which a jump is suspected, in standard deviations of one axis.
_GATE = 6.0
#: Variance of a motion of which nothing is known.
_UNKNOWN = 1.0


class _Channel:
    """A Kalman filter of a motion and of the jump of its bias since the last frame; the axes have one covariance.

    Args:
        opened: Standard deviation that the jump gets where one is suspected.
    """

    def __init__(self, opened: float) -> None:
        self._opened = opened
        self._state, self._covariance = np.zeros((2, 3)), np.diag([_UNKNOWN, 0.0])

    @property
    def jump(self) -> FloatArray:
        """The jump since the last frame, shape (3,)."""
        jump: FloatArray = self._state[1]
        return jump

    @property
    def variance(self) -> float:
        """Its variance; 0 where none is suspected."""
        return float(self._covariance[1, 1])

    def predict(self, kept: float, change: FloatArray, sigma: float) -> None:
        """Multiply the motion by a factor, and add a change with its standard deviation."""
        transition = np.diag([kept, 1.0])
        self._state = transition @ self._state + np.outer([1.0, 0.0], change)
        self._covariance = transition @ self._covariance @ transition + np.diag([sigma**2, 0.0])

    def measure(self, value: FloatArray, sigma: float) -> None:
        """Take a measurement of the motion with the jump."""
        innovation = value - self._state.sum(axis=0)
        if innovation @ innovation > _GATE**2 * (self._covariance.sum() + sigma**2):
            self._covariance[1, 1] += self._opened**2
        cross = self._covariance.sum(axis=1)
        gain = cross / (cross.sum() + sigma**2)
        self._state = self._state + np.outer(gain, innovation)
        self._covariance = self._covariance - np.outer(gain, cross)

    def settle(self) -> None:
        """Count the jump as part of the bias."""
        self._state = np.stack([self._state.sum(axis=0), np.zeros(3)])
        self._covariance = np.diag([self._covariance.sum(), 0.0])

    def interrupt(self) -> None:
        """Forget the motion; the jump stays."""
        self._covariance = np.diag([_UNKNOWN, self.variance])


class BiasJumps:
    """Compares samples with the expected motion, and reports a jump of the biases until the next frame.

    The mean specific force of a step is ``f / m + b_a``, and the angular velocity changes from the mean time of a
    step's samples to that of the next by the expected angular acceleration. An innovation beyond `_GATE` opens the
    bias: from then on its jump is estimated from the samples with a covariance, which depth frames alone could do only
    seconds later. The factor graph takes jump and covariance at the next frame and estimates the bias further, so that
    nothing is corrected for longer than that.

    Args:
        noise: Errors of the unit.
    """

    def __init__(self, noise: ImuNoise) -> None:
        self._noise = noise
        self._acceleration, self._rate = (_Channel(opened) for opened in BIAS_JUMP)
        #: Angular acceleration that is expected from the last samples to the end of their step, its sigma, that time.
        self._rest: tuple[FloatArray, float, float] = (np.zeros(3), 0.0, 0.0)

    def interrupt(self) -> None:
        """Note that a step has had no sample."""
        self._rate.interrupt()

    def settle(self) -> None:
        """Note that the graph has taken the jump as part of the bias."""
        self._acceleration.settle()
        self._rate.settle()

    def check(
        self, samples: Sequence[InertialSample], expected: ExpectedMotion, bias: FloatArray, duration: float
    ) -> BiasJump | None:
        """Return the jump since the last frame; None where none is suspected, or the step has no sample.

        Args:
            samples: The samples of a step.
            expected: What the actuators are expected to give in the step.
            bias: Of the accelerometers, as it is estimated [m/s^2], shape (3,).
            duration: Duration of the step [s].
        """
        if not samples:
            self.interrupt()
            return None
        noise, count = self._noise, np.sqrt(len(samples))
        middle = sum(sample.time for sample in samples) / len(samples)
        acceleration = np.mean([sample.acceleration for sample in samples], axis=0)
        rate = np.mean([sample.rate for sample in samples], axis=0)
        sigma = float(np.hypot(expected.sigma[0], noise.acceleration_bias))
        self._acceleration.predict(0.0, expected.mean[:3], sigma)
        self._acceleration.measure(acceleration - bias, noise.acceleration / count)
        before, before_sigma, remaining = self._rest
        change = remaining * before + middle * expected.mean[3:]
        rate_sigma = remaining * before_sigma + middle * expected.sigma[1]
        self._rate.predict(1.0, change, rate_sigma)
        self._rate.measure(rate, noise.rate / count)
        self._rest = expected.mean[3:], float(expected.sigma[1]), duration - middle
        if not (self._acceleration.variance or self._rate.variance):
            return None
        # The errors of the actuators and of the known bias are not independent from step to step.
        sigmas = np.sqrt([self._acceleration.variance + sigma**2, self._rate.variance + rate_sigma**2])
        return BiasJump(np.concatenate([self._acceleration.jump, self._rate.jump]), sigmas, duration)
