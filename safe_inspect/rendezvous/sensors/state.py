"""A simulated sensor of states with stated errors, for tests and for control without estimation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pydantic import Field

from safe_inspect.config.models.experiment import Model
from safe_inspect.dynamics.quaternion import exp, multiply
from safe_inspect.random.streams import Streams
from safe_inspect.rendezvous.bound.query import EstimateErrors
from safe_inspect.rendezvous.estimate import BodyState
from safe_inspect.units import NonNegativeAngle, NonNegativeAngularRate


class StateSensor(Model):
    """Sensor that measures the chaser's state exactly, and the target's with Gaussian errors of attitude and rate.

    With e of unit variance and ``e_j+1 = rho e_j + sqrt(1 - rho^2) n``, the measured attitude is
    ``q Exp(sigma e_1..3)`` and the measured rate is ``w + sigma e_4..6``. Without errors it measures the true state.

    Attributes:
        attitude_sigma: Standard deviation of the attitude about each principal axis [rad].
        rate_sigma: Standard deviation of each component of the angular velocity [rad/s].
        correlation: Correlation rho of the errors of two consecutive measurements.
    """

    attitude_sigma: NonNegativeAngle = 0.0  # type: ignore[valid-type]
    rate_sigma: NonNegativeAngularRate = 0.0  # type: ignore[valid-type]
    correlation: float = Field(default=0.9, ge=0.0, lt=1.0)


@dataclass(frozen=True, eq=False)
class StateReading:
    """The states of chaser and target, as measured by a simulated sensor.

    Attributes:
        chaser: State of the chaser.
        target: State of the target; None if it was not measured in this step.
        errors: Errors of the measurement.
        correlation: Correlation of the errors of two consecutive measurements of the target.
    """

    chaser: BodyState
    target: BodyState | None
    errors: EstimateErrors
    correlation: float


class StateSensorRun:
    """The state sensor of one mission.

    Args:
        sensor: Errors of the sensor.
        period: Time between two measurements of the target [s].
        streams: The random streams of the mission.
    """

    def __init__(self, sensor: StateSensor, period: float, streams: Streams) -> None:
        self._errors, self._correlation = EstimateErrors(sensor.attitude_sigma, sensor.rate_sigma), sensor.correlation
        self._period, self._streams = period, streams
        self._unit = streams.normal("estimate.error", 6, 0)[0]
        self._count, self._last = 0, -np.inf

    def measure(self, time: float, chaser: BodyState, target: BodyState, *, silent: bool) -> StateReading:
        """Return the measurement at a time.

        Args:
            time: The time [s].
            chaser: The chaser's true state.
            target: The target's true state.
            silent: Whether the target is not measured now.
        """
        seen = None
        if not silent and time >= self._last + self._period - 1e-9:
            seen = self._target(target)
            self._last = time
        return StateReading(chaser, seen, self._errors, self._correlation)

    def _target(self, target: BodyState) -> BodyState:
        if np.isfinite(self._last):
            self._count += 1
            fresh = self._streams.normal("estimate.error", 6, self._count)[0]
            self._unit = self._correlation * self._unit + np.sqrt(1.0 - self._correlation**2) * fresh
        orientation = multiply(target.orientation, exp(self._errors.attitude * self._unit[:3]))
        rate = target.angular_velocity + self._errors.rate * self._unit[3:]
        return BodyState(target.position, target.velocity, orientation, rate)
