"""The motion that the actuators are expected to give."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from safe_inspect.dynamics.tumble import angular_acceleration
from safe_inspect.rendezvous.models import ChaserConfig
from safe_inspect.rendezvous.readings import Command
from safe_inspect.types import FloatArray

#: Share of a force or torque that is uncertain whatever the actuators are, since the chaser turns within a step, and
#: the least standard deviation of the angular acceleration [rad/s^2].
_SHARE, _LEAST = 0.02, 1e-4
#: Largest distance of an exponential response from its chord, as a share of its change, over the time of the step.
_CURVATURE = 0.125


class ExpectedMotion(NamedTuple):
    """What the actuators are expected to give in a step of control.

    Attributes:
        mean: Acceleration and angular acceleration in B, mean over the step [m/s^2, rad/s^2], shape (6,).
        sigma: Standard deviations of one axis of both [m/s^2, rad/s^2], shape (2,).
    """

    mean: FloatArray
    sigma: FloatArray


class ActuatorResponse:
    """Predicts a step's motion from commands and the documented errors of the actuators.

    Args:
        config: The chaser; of its actuators the lag shapes the prediction, scale error and noise are its uncertainty.
        step: The step of control [s].
    """

    def __init__(self, config: ChaserConfig, step: float) -> None:
        self._config, self._wrench = config, np.zeros(6)
        lag = config.actuator.lag
        #: Shares of the difference to the command that are left at the end of a step, and in its mean.
        self._left = float(np.exp(-step / lag)) if lag > 0.0 else 0.0
        self._mean = lag / step * (1.0 - self._left)

    def step(self, angular_velocity: FloatArray, command: Command) -> ExpectedMotion:
        """Return the motion that a command gives, which is held for a step.

        Args:
            angular_velocity: Of the chaser before the step, as it is estimated, in B [rad/s], shape (3,).
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
