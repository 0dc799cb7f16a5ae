"""Jumps of an inertial unit's biases, found by what the actuators were asked for."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from safe_inspect.dynamics.quaternion import conjugate, rotate
from safe_inspect.dynamics.tumble import angular_acceleration
from safe_inspect.rendezvous.estimate import BodyState
from safe_inspect.rendezvous.models import ChaserConfig
from safe_inspect.types import FloatArray

#: Difference of measured and commanded motion that is a jump [m/s^2, rad/s], beside a share of the command; and that
#: share for gyroscopes whose accelerometers have jumped in the same step.
_LEAST, _SHARE, _LEAST_SHARE = (5e-3, 3e-4), 0.1, 0.02
#: Steps over which the size of a jump is averaged: of the accelerometers, of the gyroscopes.
_AVERAGED = (25, 5)
#: Share of a measured angular velocity in the one that the next is compared with.
_GAIN = 0.2


class _Offset:
    """The jumps of one kind of bias up to now, in B."""

    def __init__(self, averaged: int) -> None:
        self._averaged, self._sum, self._steps = averaged, np.zeros(3), 0
        self.value = np.zeros(3)

    @property
    def is_new(self) -> bool:
        """Whether the last step was the first of a jump."""
        return self._steps == 1

    def check(self, difference: FloatArray, allowed: float) -> bool:
        """Take a step's difference of measured and expected values; return whether the jump is being averaged."""
        if np.linalg.norm(difference - self.value) > allowed:
            self._sum, self._steps = np.zeros(3), 0
        elif not 0 < self._steps < self._averaged:
            return False
        self._sum, self._steps = self._sum + difference, self._steps + 1
        self.value = self._sum / self._steps
        return True


class BiasJumps:
    """Takes jumps of the biases out of the samples of an inertial unit.

    Over a step the mean specific force is ``f / m + b_a``, and between the means of two steps the angular velocity
    changes by ``J^-1 (torque - w x J w)`` times the time between them. A difference beyond what actuators and noise
    explain is a jump of the bias. Depth frames alone show it seconds later, and not at all where they do not show the
    target. Samples without a jump stay as they are, to the bit.

    A thruster that fails looks like a jump of the accelerometers. The frames then disagree with what was corrected, and
    `distrust` is called: nothing is corrected further.
    """

    def __init__(self) -> None:
        self._acceleration, self._rate = (_Offset(averaged) for averaged in _AVERAGED)
        self._is_trusted = True
        #: Mean angular velocity with its bias, without jumps, and commanded angular acceleration of the last step.
        self._before: tuple[FloatArray, FloatArray] | None = None

    def distrust(self) -> None:
        """Correct no jumps from now on; those that were found stay corrected."""
        self._is_trusted = False

    def interrupt(self) -> None:
        """Note that a step has had no sample."""
        self._before = None

    def corrected(
        self,
        samples: Sequence[tuple[FloatArray, FloatArray]],
        commanded: FloatArray,
        bias: FloatArray,
        duration: float,
    ) -> list[tuple[FloatArray, FloatArray]]:
        """Return the samples of a step without the jumps of the biases.

        Args:
            samples: Acceleration [m/s^2] and angular velocity [rad/s] in B, at least one.
            commanded: Acceleration and angular acceleration in B that were asked for [m/s^2, rad/s^2], shape (6,).
            bias: The biases as they are estimated [m/s^2, rad/s], shape (6,).
            duration: Duration of the step [s].
        """
        acceleration, rate = (np.mean([sample[k] for sample in samples], axis=0) for k in range(2))
        if self._is_trusted:
            allowed = _LEAST[0] + _SHARE * float(np.linalg.norm(commanded[:3]))
            self._acceleration.check(acceleration - commanded[:3] - bias[:3], allowed)
            middle = 0.5 * (1.0 + 1.0 / len(samples))  # of the times of the samples, each at the end of its period
            self._check_rate(rate, commanded[3:], duration * np.array([1.0 - middle, middle]))
        if not (self._acceleration.value.any() or self._rate.value.any()):
            return list(samples)
        return [(one - self._acceleration.value, other - self._rate.value) for one, other in samples]

    def _check_rate(self, rate: FloatArray, commanded: FloatArray, durations: FloatArray) -> None:
        if self._before is None:
            self._before = rate - self._rate.value, commanded
            return
        change = durations[0] * self._before[1] + durations[1] * commanded
        expected = self._before[0] + change
        share = _LEAST_SHARE if self._acceleration.is_new else _SHARE
        if not self._rate.check(rate - expected, _LEAST[1] + share * float(np.linalg.norm(change))):
            expected = expected + _GAIN * (rate - self._rate.value - expected)
        self._before = expected, commanded


def commanded_motion(config: ChaserConfig, chaser: BodyState, force: FloatArray, torque: FloatArray) -> FloatArray:
    """Return acceleration and angular acceleration in B as they are asked for [m/s^2, rad/s^2], shape (6,).

    Args:
        config: The chaser's mass and moments of inertia.
        chaser: Where it is estimated to be.
        force: In W [N], shape (3,).
        torque: In B [N m], shape (3,).
    """
    moments: FloatArray = np.array(config.inertia)
    in_body = rotate(conjugate(chaser.orientation), force) / config.mass
    return np.concatenate([in_body, angular_acceleration(moments, chaser.angular_velocity) + torque / moments])
