"""Limits of the nominal errors: the chaser's limits minus the reference and minus the tube."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from safe_inspect.rendezvous.control.tube import Axis, Tube
from safe_inspect.types import FloatArray

UNLIMITED = 1e31  # the solver treats 1e30 and more as infinite
# Tolerance of a solution, in m, m/s and N.
_ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class TrackingSolution:
    """Solution of a `TrackingQP`.

    Attributes:
        states: Nominal errors z_0 .. z_N, shape (N+1, 2).
        forces: Nominal forces v_0 .. v_{N-1} [N], shape (N,).
        steady: Position error of the artificial steady state [m].
    """

    states: FloatArray
    forces: FloatArray
    steady: float


@dataclass(frozen=True, eq=False)
class AxisLimits:
    """Admissible nominal errors z and forces v of one axis.

    Attributes:
        lower: Lower limits of position error [m] and velocity error [m/s], shape (2,).
        upper: Upper limits of them, shape (2,).
        least_force: Lower limit of the nominal force v [N].
        largest_force: Upper limit of the nominal force v [N].
    """

    lower: FloatArray
    upper: FloatArray
    least_force: float
    largest_force: float

    def holding(self, solution: TrackingSolution, jump: float) -> AxisLimits:
        """Return limits that also admit the rest of a solution: its states from z_2 on and its forces from v_1 on.

        Args:
            solution: The solution.
            jump: Largest change of a position limit [m]; if a larger change is needed, the limits are not changed.
        """
        states, forces = solution.states[2:], solution.forces[1:]
        if not len(states):
            return self
        lower = np.minimum(self.lower, states.min(axis=0) - _ROUNDING)
        upper = np.maximum(self.upper, states.max(axis=0) + _ROUNDING)
        if max(self.lower[0] - lower[0], upper[0] - self.upper[0]) > jump + _ROUNDING:
            return self
        least = min(self.least_force, float(forces.min(initial=0.0)) - _ROUNDING)
        return AxisLimits(lower, upper, least, max(self.largest_force, float(forces.max(initial=0.0)) + _ROUNDING))


@dataclass(frozen=True, eq=False)
class TrackedReference:
    """Reference to follow, sampled at the control steps.

    Attributes:
        position: Position in W [m], shape (K, 3).
        velocity: Velocity in W [m/s], shape (K, 3).
        tide: Acceleration that needs no force, on an orbit [m/s^2], shape (K, 3); None in free space.
    """

    position: FloatArray
    velocity: FloatArray
    tide: FloatArray | None = None

    def feed_forward(self, axis: Axis) -> FloatArray:
        """Return the mean force of each step that follows the reference [N], shape (K, 3); the last is repeated."""
        force = axis.feed_forward(self.velocity)
        if self.tide is None:
            return force
        mean = self.tide.copy()
        mean[:-1] = 0.5 * (self.tide[:-1] + self.tide[1:])
        return force - axis.mass * mean


@dataclass(frozen=True)
class TrackingLimits:
    """Limits that tracking must respect along each axis of W.

    Attributes:
        force: Maximum force [N].
        speed: Maximum speed [m/s]; higher than that of a plan, so that errors can be corrected.
        keep_in: Half sizes of the keep-in box about the origin of W [m]; None for no box.
    """

    force: float = 0.30
    speed: float = 0.20
    keep_in: Sequence[float] | None = (0.8, 3.0, 0.8)


class TightenedLimits:
    """Limits of z and v from a step to the end of the reference: the intersection of ``(X - r_k) - tube`` over those k.

    They only widen with time, so that a feasible programme remains feasible.
    """

    def __init__(self, axis: Axis, reference: TrackedReference, tube: Tube, limits: TrackingLimits) -> None:
        """Intersect the limits, from the end of the reference to its start."""
        self.feed_forward = reference.feed_forward(axis)
        steps = np.minimum(np.arange(len(reference.position)), len(tube.position) - 1)
        unlimited = np.full(3, UNLIMITED)
        box = unlimited if limits.keep_in is None else np.asarray(limits.keep_in, dtype=float)
        half = np.stack((box, np.full(3, limits.speed), np.full(3, limits.force)), axis=1)
        centre = np.stack((reference.position, reference.velocity, self.feed_forward), axis=2)
        half_k = half - np.stack((tube.position, tube.velocity, tube.force), axis=1)[steps][:, None, :]
        # Shape (K, 3 axes, 3 for position, velocity and force); each entry is the intersection over the rest of the
        # reference.
        self.upper = _remaining_least(half_k - centre)
        self.lower = -_remaining_least(half_k + centre)

    def reserve(self, k: int = 0) -> FloatArray:
        """Return the remaining position [m], velocity [m/s] and force [N] about z = 0, v = 0 from step k on.

        The shape is (3, 3); the rows are the axes of W. A negative entry means that the reference itself cannot be
        followed within that limit.
        """
        return np.asarray(np.minimum(self.upper[k], -self.lower[k]))

    def at(self, k: int, axis: int) -> AxisLimits:
        """Return the limits along an axis of W from step k on."""
        lower, upper = self.lower[k, axis], self.upper[k, axis]
        return AxisLimits(lower[:2], upper[:2], float(lower[2]), float(upper[2]))


def _remaining_least(values: FloatArray) -> FloatArray:
    """Return the minimum of each value and all later ones, along the first axis."""
    return np.asarray(np.minimum.accumulate(values[::-1])[::-1])
