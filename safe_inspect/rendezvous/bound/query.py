"""Inputs from which a bound is computed: the plan, the errors of estimates and their updates."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from safe_inspect.rendezvous.planner.query import Plan
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


@dataclass(frozen=True)
class JointErrors(EstimateErrors):
    """Correlated errors of an estimate; they are sampled from `joint`, and the other fields only summarise it.

    Attributes:
        joint: Covariance of the logits of the inertia ratios (2), attitude a (3) and rate r (3) in T, and of the centre
            of mass (3) and the chaser's velocity (3) in W, both relative to the other body, shape (14, 14). The
            attitude is ``q Exp(a)`` and the rate ``Exp(-a) w + r``: r is the error in axes that a does not rotate.
    """

    joint: FloatArray = field(default_factory=lambda: np.zeros((14, 14)), compare=False)


@dataclass(frozen=True)
class Updates:
    """Updates of the estimate during the approach.

    Attributes:
        period: Time T_u from one update to the next [s], a multiple of the plan's step.
        latency: Time from a measurement to the use of its estimate [s], a multiple of the plan's step.
        correlation: Correlation rho of the errors of two successive updates, at least 0 and less than 1.
    """

    period: float = 1.0
    latency: float = 0.0
    correlation: float = 0.0


@dataclass(frozen=True, eq=False)
class BoundQuery:
    """Query for the bound of the difference between the estimated and the true reference.

    Attributes:
        plan: The plan, with its path in T and the predicted motion of the target.
        inertia: The target's principal moments J1 <= J2 <= J3, up to a common factor, shape (3,).
        errors: Errors of an estimate.
        updates: Updates of the estimate; None for one estimate at the start that is propagated to the end.
        mass: Mass of the chaser [kg].
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
        """Return a time as a number of steps of the plan.

        Args:
            name: Name of the field of `Updates`, for the error message.
            seconds: The time [s].

        Raises:
            ValueError: The time is not a multiple of the plan's step.
        """
        count = round(seconds / self.step)
        if abs(count * self.step - seconds) > 1e-6 * self.step:
            raise ValueError(f"updates.{name}: {seconds} s is no multiple of the plan's step of {self.step:.6g} s")
        return count

    def windows(self) -> tuple[int, int, int]:
        """Return the number of estimates, the number of steps between two, and the latency in steps.

        Raises:
            ValueError: A field of the updates is not in the range that `Updates` states.
        """
        if self.updates is None:
            return 1, len(self.plan.times), 0
        period, latency = self.steps_of("period", self.updates.period), self.steps_of("latency", self.updates.latency)
        if period < 1 or latency < 0:
            raise ValueError("updates: the period must be positive and the latency not negative")
        if not 0.0 <= self.updates.correlation < 1.0:
            raise ValueError(f"updates.correlation: must be in [0, 1), got {self.updates.correlation}")
        return int(np.ceil(max(len(self.plan.times) - latency, 1) / period)), period, latency
