"""Motion that the actuators are expected to cause."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from safe_inspect.dynamics.tumble import angular_acceleration
from safe_inspect.rendezvous.models import ChaserConfig
from safe_inspect.rendezvous.readings import Command
from safe_inspect.types import FloatArray

#: Fraction of a force or torque that is uncertain for any actuators, because the chaser turns within a step, and the
#: smallest standard deviation of the angular acceleration [rad/s^2].
_SHARE, _LEAST = 0.02, 1e-4
#: Largest distance of an exponential response from its chord within a step, as a fraction of its change.
_CURVATURE = 0.125


class ExpectedMotion(NamedTuple):
    """Motion that the actuators are expected to cause in a control step.

    Attributes:
        mean: Mean acceleration and angular acceleration over the step, in B [m/s^2, rad/s^2], shape (6,).
        sigma: Standard deviations of one axis of each [m/s^2, rad/s^2], shape (2,).
    """

    mean: FloatArray
    sigma: FloatArray


class ActuatorResponse:
    """Predictor of the motion of a step from commands and the documented errors of the actuators.

    Args:
        config: The chaser. The lag of its actuators shapes the prediction; scale error and noise give its uncertainty.
        step: The control period [s].
    """

    def __init__(self, config: ChaserConfig, step: float) -> None:
        self._config, self._wrench = config, np.zeros(6)
        lag = config.actuator.lag
        #: Fractions of the difference to the command that remain at the end of a step, and in its mean.
        self._left = float(np.exp(-step / lag)) if lag > 0.0 else 0.0
        self._mean = lag / step * (1.0 - self._left)

    def step(self, angular_velocity: FloatArray, command: Command) -> ExpectedMotion:
        """Return the motion caused by a command that is constant over a step.

        Args:
            angular_velocity: Estimated angular velocity of the chaser before the step, in B [rad/s], shape (3,).
            command: The command.
        """
        config, own = self._config, self._config.actuator
        moments: FloatArray = np.array(config.inertia)
        held = np.concatenate(command)
        difference = self._wrench - held
        mean, self._wrench = held + self._mean * difference, held + self._left * difference
        bent = _CURVATURE * (1.0 - self._left) * difference if own.lag > 0.0 else np.zeros(6)
        sizes = np.linalg.norm(np.reshape([mean, bent], (2, 2, 3)), axis=2)
        sigma = (_SHARE + abs(own.scale_error)) * sizes[0] + sizes[1]
        sigma = np.hypot(sigma, np.array([own.force_noise, own.torque_noise]) / np.sqrt(3.0))
        free = angular_acceleration(moments, angular_velocity)
        return ExpectedMotion(
            np.concatenate([mean[:3] / config.mass, free + mean[3:] / moments]),
            np.array([sigma[0] / config.mass, np.hypot(sigma[1] / moments.min(), _LEAST)]),
        )
