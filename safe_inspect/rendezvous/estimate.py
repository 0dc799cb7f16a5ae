"""What the chaser knows of itself and of the target, and how its truth looks with stated errors."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from safe_inspect.dynamics.quaternion import exp, multiply
from safe_inspect.dynamics.tumble import tumble
from safe_inspect.random.streams import Streams
from safe_inspect.rendezvous.bound.query import EstimateErrors
from safe_inspect.rendezvous.chaser import ChaserState
from safe_inspect.rendezvous.target.model import Target
from safe_inspect.types import FloatArray


class BodyState(NamedTuple):
    """MissionState of one rigid body.

    Attributes:
        position: Of the centre of mass in W [m], shape (3,).
        velocity: In W [m/s], shape (3,).
        orientation: Quaternion [x, y, z, w] from the body's frame to W, shape (4,).
        angular_velocity: In the body's frame [rad/s], shape (3,).
    """

    position: FloatArray
    velocity: FloatArray
    orientation: FloatArray
    angular_velocity: FloatArray


@dataclass(frozen=True, eq=False)
class EstimatorContext:
    """What an estimator is made with.

    Attributes:
        target: The target.
        period: Time between two updates of the reference [s].
        step: Time between two calls [s].
        tick: Length of a tick of the truth [s].
        mass: Of the chaser [kg].
        camera_position: Of the camera in B [m], shape (3,); it looks along x.
        streams: The random streams of one mission.
    """

    target: Target
    period: float
    step: float
    streams: Streams
    tick: float = 0.008
    mass: float = 9.583788668
    camera_position: tuple[float, float, float] = (0.13, 0.0, 0.0)


class ExpectedMotion(NamedTuple):
    """What the actuators are expected to give in a step of control.

    Attributes:
        mean: Acceleration and angular acceleration in B, mean over the step [m/s^2, rad/s^2], shape (6,).
        sigma: Standard deviations of one axis of both [m/s^2, rad/s^2], shape (2,).
    """

    mean: FloatArray
    sigma: FloatArray


class InertialTruth(NamedTuple):
    """What an inertial unit has felt in one step of control.

    Attributes:
        history: The chaser after each tick, one row, shape (1, ticks, ...).
        silent: Whether the unit gives nothing.
        bias: What a fault adds to its measurements [m/s^2, rad/s], shape (6,).
        expected: What the actuators are expected to have given; None where their commands are not known.
    """

    history: ChaserState
    silent: bool
    bias: FloatArray
    expected: ExpectedMotion | None = None


@dataclass(frozen=True, eq=False)
class StateEstimate:
    """An estimate at one time.

    Attributes:
        time: When it holds [s].
        updated: When the camera has last contributed to it [s].
        chaser: The chaser, in B.
        target: The target, in T; its velocity is zero.
        inertia: The target's principal moments, up to one factor, shape (3,).
        errors: How wrong it is.
        correlation: Correlation of the errors of two updates that follow each other.
        problem: Why no approach may be planned with it; empty where one may.
        alarm: Why an approach must not go on; empty where it may.
        mismatch: Largest distance in T between where one of the newest frames alone shows the chaser and where it was
            estimated, with the standard deviation of that frame [m]; infinite where one of them shows nothing.
    """

    time: float
    updated: float
    chaser: BodyState
    target: BodyState
    inertia: FloatArray
    errors: EstimateErrors
    correlation: float
    problem: str = ""
    alarm: str = ""
    mismatch: float = 0.0

    @property
    def translation(self) -> FloatArray:
        """Position [m] and velocity [m/s] of the chaser in W, shape (6,)."""
        return np.concatenate([self.chaser.position, self.chaser.velocity])

    @property
    def relative(self) -> FloatArray:
        """The same relative to the target's centre of mass, shape (6,): what plans are made in."""
        return np.concatenate([self.chaser.position - self.target.position, self.chaser.velocity])

    def predict(self, times: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the target's attitudes q_WT, shape (K, 4), and angular velocities in T [rad/s], shape (K, 3).

        Args:
            times: Times [s], shape (K,), also before the estimate's.
        """
        elapsed = np.asarray(times, dtype=np.float64) - self.time
        q, w = tumble(self.inertia, self.target.orientation[None], self.target.angular_velocity[None], elapsed)
        return q[0], w[0]


class TruthWithErrors:
    """Gives the truth at every call, with errors of the target's attitude and rate that change at updates.

    With e of unit variance, ``e_j+1 = rho e_j + sqrt(1 - rho^2) n``: the attitude is ``q Exp(sigma e_1..3)`` at the
    time of an update and the rate ``w + sigma e_4..6``; between updates the estimate moves as a free body.

    Args:
        errors: The errors; those of attitude and rate count.
        correlation: Correlation of two updates that follow each other.
        inertia: Principal moments of the target, up to one factor, shape (3,).
        period: Time between two updates [s].
        step: Time between two calls [s].
        streams: The random streams of one mission.
    """

    def __init__(
        self,
        errors: EstimateErrors,
        correlation: float,
        inertia: FloatArray,
        period: float,
        step: float,
        streams: Streams,
    ) -> None:
        self._errors, self._correlation, self._inertia, self._streams = errors, correlation, inertia, streams
        self._period, self._step = period, step
        self._unit = streams.normal("estimate.error", 6, 0)[0]
        self._count = 0
        self._last: StateEstimate | None = None
        # The prediction from the last update, of the calls until the next one, and the number of the first of them.
        self._first = -1
        self._predicted = (np.empty((0, 4)), np.empty((0, 3)))

    def update(
        self,
        time: float,
        chaser: BodyState,
        target: BodyState,
        *,
        blind: bool = False,
        inertial: InertialTruth | None = None,
    ) -> StateEstimate:
        """Return the estimate.

        Args:
            time: The time [s].
            chaser: The chaser's true state.
            target: The target's true state.
            blind: Whether the camera gives nothing; the last estimate of the target is then predicted.
            inertial: Not used.
        """
        last = self._last
        if last is None or (not blind and time >= last.updated + self._period - 1e-9):
            self._last = last = self._updated(time, chaser, target)
            self._first = -1
        calls = round((time - last.time) / self._step)
        count = max(round(self._period / self._step), 1)
        first = calls - calls % count
        if first != self._first:
            self._first = first
            self._predicted = last.predict(last.time + self._step * np.arange(first, first + count, dtype=np.float64))
        q, w = self._predicted[0][calls - first], self._predicted[1][calls - first]
        return replace(last, time=time, chaser=chaser, target=BodyState(target.position, target.velocity, q, w))

    def _updated(self, time: float, chaser: BodyState, target: BodyState) -> StateEstimate:
        errors = self._errors
        if self._last is not None:
            self._count += 1
            fresh = self._streams.normal("estimate.error", 6, self._count)[0]
            self._unit = self._correlation * self._unit + np.sqrt(1.0 - self._correlation**2) * fresh
        orientation = multiply(target.orientation, exp(errors.attitude * self._unit[:3]))
        rate = target.angular_velocity + errors.rate * self._unit[3:]
        seen = BodyState(target.position, target.velocity, orientation, rate)
        return StateEstimate(time, time, chaser, seen, self._inertia, errors, self._correlation)
