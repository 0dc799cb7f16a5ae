"""What a bound is asked about."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from safe_inspect.rendezvous.planner.query import Plan
from safe_inspect.types import FloatArray


@dataclass(frozen=True)
class EstimateErrors:
    """Standard deviations of the errors of an estimate, independent and normal, of each component.

    Attributes:
        attitude: Of the target's attitude, about each axis of T [rad].
        rate: Of its angular velocity, along each axis of T [rad/s].
        centre: Of its centre of mass, along each axis of W [m].
        inertia: Of the logits of its inertia ratios; the ratios stay those of a rigid body.
        position: Of the chaser's own position, along each axis of W [m].
        velocity: Of the chaser's own velocity, along each axis of W [m/s].
    """

    attitude: float
    rate: float
    centre: float = 0.0
    inertia: float = 0.0
    position: float = 0.0
    velocity: float = 0.0


@dataclass(frozen=True)
class JointErrors(EstimateErrors):
    """Errors of an estimate that depend on each other; they are drawn from `joint`, which the numbers only describe.

    Attributes:
        joint: Covariance of the logits of the inertia ratios (2), attitude a (3) and rate r (3) in T, and of the centre
            of mass (3) and the chaser's velocity (3) in W, both relative to the other body, shape (14, 14). The
            attitude is ``q Exp(a)`` and the rate ``Exp(-a) w + r``: r is the error in axes that a does not turn.
    """

    joint: FloatArray = field(default_factory=lambda: np.zeros((14, 14)), compare=False)


@dataclass(frozen=True)
class Updates:
    """When the estimate is renewed during the approach.

    Attributes:
        period: T_u, time from one update to the next [s], a multiple of the plan's step.
        latency: Time from the measurement to the use of its estimate [s], a multiple of the plan's step.
        correlation: rho, correlation of the errors of two successive updates, at least 0 and less than 1.
    """

    period: float = 1.0
    latency: float = 0.0
    correlation: float = 0.0


@dataclass(frozen=True, eq=False)
class BoundQuery:
    """How far may the estimated reference be from the true one?

    Attributes:
        plan: The plan, with its path in T and the predicted motion of the target.
        inertia: The target's principal moments J1 <= J2 <= J3, up to one factor, shape (3,).
        errors: How wrong an estimate is.
        updates: When it is renewed; None for one estimate at the start, propagated to the end.
        mass: Of the chaser [kg].
    """

    plan: Plan
    inertia: FloatArray
    errors: EstimateErrors
    updates: Updates | None = field(default_factory=Updates)
    mass: float = 9.583788668

    @property
    def step(self) -> float:
        """Time between two samples of the plan [s]."""
        return float((self.plan.times[-1] - self.plan.times[0]) / (len(self.plan.times) - 1))

    def steps_of(self, name: str, seconds: float) -> int:
        """Return how many samples of the plan a time is.

        Raises:
            ValueError: It is no multiple of the plan's step.
        """
        count = round(seconds / self.step)
        if abs(count * self.step - seconds) > 1e-6 * self.step:
            raise ValueError(f"updates.{name}: {seconds} s is no multiple of the plan's step of {self.step:.6g} s")
        return count

    def windows(self) -> tuple[int, int, int]:
        """Return (number of estimates, steps between two, steps of latency).

        Raises:
            ValueError: The updates are not as `Updates` wants them.
        """
        if self.updates is None:
            return 1, len(self.plan.times), 0
        period, latency = self.steps_of("period", self.updates.period), self.steps_of("latency", self.updates.latency)
        if period < 1 or latency < 0:
            raise ValueError("updates: the period must be positive and the latency not negative")
        if not 0.0 <= self.updates.correlation < 1.0:
            raise ValueError(f"updates.correlation: must be in [0, 1), got {self.updates.correlation}")
        return int(np.ceil(max(len(self.plan.times) - latency, 1) / period)), period, latency
