"""Detection of jumps of an inertial unit's biases by comparison with the expected effect of the actuators."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from safe_inspect.rendezvous.back_end.inertial import BIAS_JUMP, BiasJump
from safe_inspect.rendezvous.estimation.response import ExpectedMotion
from safe_inspect.rendezvous.sensors.imu import ImuNoise, InertialSample
from safe_inspect.types import FloatArray

#: Innovation beyond which a jump is suspected, in standard deviations of one axis.
_GATE = 6.0
#: Variance of an unknown motion.
_UNKNOWN = 1.0


class _Channel:
    """Kalman filter of a motion and of the jump of its bias since the last frame; the axes share one covariance.

    Args:
        opened: Standard deviation that is assigned to the jump when one is suspected.
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
        """Variance of the jump; 0 if none is suspected."""
        return float(self._covariance[1, 1])

    def predict(self, kept: float, change: FloatArray, sigma: float) -> None:
        """Multiply the motion by the factor `kept` and add a change with its standard deviation."""
        transition = np.diag([kept, 1.0])
        self._state = transition @ self._state + np.outer([1.0, 0.0], change)
        self._covariance = transition @ self._covariance @ transition + np.diag([sigma**2, 0.0])

    def measure(self, value: FloatArray, sigma: float) -> None:
        """Update the filter with a measurement of the motion plus the jump."""
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
        """Discard the motion; the jump is not changed."""
        self._covariance = np.diag([_UNKNOWN, self.variance])


class BiasJumps:
    """Detector of bias jumps that compares samples with the expected motion between two frames.

    The mean specific force of a step is ``f / m + b_a``, and the angular velocity changes from the mean time of a
    step's samples to that of the next by the expected angular acceleration. An innovation beyond `_GATE` opens the
    bias: from then on its jump and a covariance are estimated from the samples, which depth frames alone would allow
    only seconds later. At the next frame the factor graph takes over jump and covariance and continues to estimate the
    bias, so that no correction lasts longer than that.

    Args:
        noise: Errors of the unit.
    """

    def __init__(self, noise: ImuNoise) -> None:
        self._noise = noise
        self._acceleration, self._rate = (_Channel(opened) for opened in BIAS_JUMP)
        #: Angular acceleration expected from the last samples to the end of their step, its sigma, and that duration.
        self._rest: tuple[FloatArray, float, float] = (np.zeros(3), 0.0, 0.0)

    def interrupt(self) -> None:
        """Record that a step had no sample."""
        self._rate.interrupt()

    def settle(self) -> None:
        """Record that the graph now counts the jump as part of the bias."""
        self._acceleration.settle()
        self._rate.settle()

    def check(
        self, samples: Sequence[InertialSample], expected: ExpectedMotion, bias: FloatArray, duration: float
    ) -> BiasJump | None:
        """Return the jump since the last frame; None if none is suspected or the step has no sample.

        Args:
            samples: The samples of a step.
            expected: Motion that the actuators are expected to cause in the step.
            bias: Estimated bias of the accelerometers [m/s^2], shape (3,).
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
