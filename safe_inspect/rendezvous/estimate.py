"""Estimates of the states of the chaser and of the target."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import NamedTuple, Self

import numpy as np

from safe_inspect.dynamics.tumble import tumble
from safe_inspect.rendezvous.target.model import Target
from safe_inspect.types import FloatArray


@dataclass(frozen=True)
class EstimateErrors:
    """Standard deviations of the errors of an estimate; the components are independent and normally distributed.

    Attributes:
        attitude: Error of the target's attitude, about each axis of T [rad].
        rate: Error of its angular velocity, along each axis of T [rad/s].
        centre: Error of its centre of mass, along each axis of W [m].
        inertia: Error of the logits of its inertia ratios; the ratios remain those of a rigid body.
        position: Error of the chaser's position, along each axis of W [m].
        velocity: Error of the chaser's velocity, along each axis of W [m/s].
    """

    attitude: float
    rate: float
    centre: float = 0.0
    inertia: float = 0.0
    position: float = 0.0
    velocity: float = 0.0

    def in_units_of(self, length: float) -> Self:
        """Return the errors with all lengths divided by a length [m]."""
        names = ("centre", "position", "velocity")
        return replace(self, **{name: getattr(self, name) / length for name in names})


@dataclass(frozen=True)
class JointErrors(EstimateErrors):
    """Correlated errors of an estimate; they are sampled from `joint`, and the other fields only summarise it.

    Attributes:
        joint: Covariance of the logits of the inertia ratios (2), attitude a (3) and rate r (3) in T, and of the centre
            of mass (3) and the chaser's velocity (3) in W, both relative to the other body, shape (14, 14). The
            attitude is ``q Exp(a)`` and the rate ``Exp(-a) w + r``: r is the error in axes that a does not rotate.
        offset: Covariance of the true centre of mass relative to the point that is taken for it, in T [m^2], shape
            (3, 3). The point rotates about the true centre, and its position is known as well as `joint` says.
    """

    joint: FloatArray = field(default_factory=lambda: np.zeros((14, 14)), compare=False)
    offset: FloatArray = field(default_factory=lambda: np.zeros((3, 3)), compare=False)

    def in_units_of(self, length: float) -> JointErrors:
        """Return the errors with all lengths divided by a length [m]."""
        factors = np.repeat([1.0, 1.0 / length], [8, 6])
        joint, offset = self.joint * np.outer(factors, factors), self.offset / length**2
        return replace(super().in_units_of(length), joint=joint, offset=offset)


#: Errors of the estimate of a target whose motion is not known yet [rad, rad/s, m].
UNKNOWN = EstimateErrors(attitude=np.pi, rate=1.0, centre=1.0, inertia=1.0, velocity=0.1)


class BodyState(NamedTuple):
    """State of one rigid body.

    Attributes:
        position: Position of the centre of mass in W [m], shape (3,).
        velocity: Velocity of the centre of mass in W [m/s], shape (3,).
        orientation: Quaternion [x, y, z, w] from the body's frame to W, shape (4,).
        angular_velocity: Angular velocity in the body's frame [rad/s], shape (3,).
    """

    position: FloatArray
    velocity: FloatArray
    orientation: FloatArray
    angular_velocity: FloatArray

    def in_units_of(self, length: float) -> BodyState:
        """Return the state with all lengths divided by a length [m]."""
        return self._replace(position=self.position / length, velocity=self.velocity / length)


@dataclass(frozen=True, eq=False)
class StateEstimate:
    """An estimate of the states of chaser and target at one time.

    Attributes:
        time: Time of the estimate [s].
        updated: Time of the last camera frame that contributed to the estimate [s].
        chaser: State of the chaser; its body frame is B.
        target: State of the target; its body frame is T, and its velocity is zero.
        inertia: The target's principal moments, up to a common factor, shape (3,).
        errors: Errors of the estimate.
        correlation: Correlation of the errors of two consecutive updates.
        problem: Why no approach may be planned with this estimate; empty if one may be planned.
        alarm: Why an approach must not continue; empty if it may continue.
        mismatch: Largest distance in T between the chaser's position as one of the newest frames alone shows it and the
            estimated position, plus the standard deviation of that frame [m]; infinite if one of these frames does not
            show the target.
        mapped: The target as mapped during the mission; None if it was known before, or is not mapped yet. Its axes T
            are those of the estimate.
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
    mapped: Target | None = None

    def in_units_of(self, length: float) -> StateEstimate:
        """Return the estimate of a target that is not mapped, with all lengths divided by a length [m]."""
        return replace(
            self,
            chaser=self.chaser.in_units_of(length),
            target=self.target.in_units_of(length),
            errors=self.errors.in_units_of(length),
            mismatch=self.mismatch / length,
        )

    @property
    def translation(self) -> FloatArray:
        """Position [m] and velocity [m/s] of the chaser in W, shape (6,)."""
        return np.concatenate([self.chaser.position, self.chaser.velocity])

    @property
    def relative(self) -> FloatArray:
        """Position [m] and velocity [m/s] in W relative to the target's centre of mass, as in plans, shape (6,)."""
        return np.concatenate([self.chaser.position - self.target.position, self.chaser.velocity])

    def predict(self, times: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the target's attitudes q_WT, shape (K, 4), and angular velocities in T [rad/s], shape (K, 3).

        Args:
            times: Times [s], shape (K,); they may be before the time of the estimate.
        """
        elapsed = np.asarray(times, dtype=np.float64) - self.time
        q, w = tumble(self.inertia, self.target.orientation[None], self.target.angular_velocity[None], elapsed)
        return q[0], w[0]


def unknown_estimate(
    time: float,
    updated: float,
    chaser: BodyState,
    inertia: FloatArray,
    correlation: float,
    centre: FloatArray | None = None,
) -> StateEstimate:
    """Return the estimate of a target whose motion is not known yet.

    Args:
        time: Time of the estimate [s].
        updated: Time of the last camera frame that contributed to the estimate [s].
        chaser: State of the chaser.
        inertia: The target's principal moments, up to a common factor, shape (3,).
        correlation: Correlation of the errors of two consecutive updates.
        centre: The target's centre of mass in W [m], shape (3,); None for the origin.
    """
    still, level = np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0])
    target = BodyState(still if centre is None else centre, still, level, still)
    return StateEstimate(
        time, updated, chaser, target, inertia, UNKNOWN, correlation, "the target's motion is not known yet"
    )
