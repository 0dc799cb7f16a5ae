"""Reference and tube: the largest distance of the chaser from the true reference for errors within their bounds.

With the control ``u = u_r + K (x_hat - r_hat)``, the error ``e = x - r`` about the true reference r obeys
``e+ = A_K e - B K delta + B delta_F + w``: the error delta of the estimated reference and the error delta_F of its
force act as bounded disturbances, no matter when updates occur. The tube bounds the distance to the true reference, so
that the clearance depends on the tube alone.

Source:
    Albee et al., "A robust observation, planning, and control pipeline for autonomous rendezvous with tumbling
    targets", Frontiers in Robotics and AI 8, 2021, for tubes about a reference that is estimated during the approach.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from safe_inspect.compiling import njit
from safe_inspect.dynamics.cwh import transition
from safe_inspect.types import FloatArray

# Time after the last bound, in time constants of the slowest mode, after which 1e-9 of an error remains.
_HOLD_CONSTANTS = 20.0


@dataclass(frozen=True)
class Axis:
    """Double integrator ``x+ = A x + B u`` with state (position [m], velocity [m/s]) and force u [N].

    Attributes:
        mass: Mass of the chaser [kg].
        step: Control period [s].
    """

    mass: float
    step: float = 0.2

    @cached_property
    def A(self) -> FloatArray:  # noqa: N802 - the field's name
        """State matrix ``[[1, dt], [0, 1]]``, shape (2, 2)."""
        return transition(0.0, self.mass, self.step)[0][np.ix_((0, 3), (0, 3))]

    @cached_property
    def B(self) -> FloatArray:  # noqa: N802 - the field's name
        """Input vector ``[dt^2/2, dt] / m``, shape (2,)."""
        return transition(0.0, self.mass, self.step)[1][[0, 3], 0]

    def closed_loop(self, gain: FloatArray) -> FloatArray:
        """Return ``A_K = A + B K``, shape (..., 2, 2), for gains K of shape (..., 2)."""
        return self.A + self.B[:, None] * np.asarray(gain)[..., None, :]

    def feed_forward(self, velocity: FloatArray) -> FloatArray:
        """Return the forces ``m (v_{k+1} - v_k) / dt`` [N] that produce velocities (K, ...); the last is repeated."""
        force = self.mass * np.diff(velocity, axis=0) / self.step
        return np.concatenate((force, force[-1:])) if len(force) else np.zeros_like(velocity)


@dataclass(frozen=True, eq=False)
class AxisBound:
    """Bounds of the disturbances of one axis at each of K steps; they hold for all three axes of W.

    Attributes:
        position: Bound of the reference's position error [m], shape (K,).
        velocity: Bound of its velocity error [m/s], shape (K,).
        force: Bound of the error of its feed-forward force [N], shape (K,).
        process: Change of position [m] and velocity [m/s] per step due to other causes, shape (2,).
        start: Distance [m] and velocity [m/s] of the chaser from the start of the plan due to other causes, shape (2,).
    """

    position: FloatArray
    velocity: FloatArray
    force: FloatArray
    process: FloatArray
    start: FloatArray = field(default_factory=lambda: np.zeros(2))

    def feedback(self, gain: FloatArray) -> FloatArray:
        """Return ``|K| b``, the largest feedback force that the reference's error causes [N], shape (K,).

        Args:
            gain: Gain K, shape (2,), or one for each step, shape (K, 2).
        """
        return np.asarray(np.abs(gain[..., 0]) * self.position + np.abs(gain[..., 1]) * self.velocity)


@dataclass(frozen=True, eq=False)
class Tube:
    """Half widths along each axis of W at each of K steps; the last also holds at all later steps.

    Attributes:
        gain: Gain K = (N/m, N s/m), shape (2,), or one for each step, shape (K, 2).
        position: Half width about the followed reference [m], shape (K,); it tightens the position limits.
        velocity: Likewise for velocity [m/s], shape (K,).
        clearance: Half width about the true reference [m], shape (K,); it reduces distances to the target.
        force: Largest feedback force ``h_Z(K) + |K| b`` [N], shape (K,).
    """

    gain: FloatArray
    position: FloatArray
    velocity: FloatArray
    clearance: FloatArray
    force: FloatArray

    def gain_at(self, k: int) -> FloatArray:
        """Return the gain of step k, shape (2,)."""
        return self.gain if self.gain.ndim == 1 else self.gain[min(k, len(self.gain) - 1)]


def no_tube(steps: int, gain: FloatArray | None = None) -> Tube:
    """Return a tube of zero width, by default without feedback, for control that ignores disturbances."""
    return Tube(np.zeros(2) if gain is None else gain, *np.zeros((4, steps)))


def truth_tube(axis: Axis, gain: FloatArray, bound: AxisBound) -> Tube:
    """Return the tube that follows from the bounds: Z_0 = +-(b(t_0) + start), Z_{k+1} = A_K Z_k + W_k.

    After the last step, bounds and gain are constant, and the last width is the largest of all later ones.

    Args:
        axis: The axis.
        gain: Gain K, shape (2,), or one for each step, shape (K, 2).
        bound: Disturbance of the axis.
    """
    gain = np.asarray(gain, dtype=float)
    gains = np.array(np.broadcast_to(gain, (len(bound.position), 2)))
    closed_loop = axis.closed_loop(gains)
    pushed = axis.B * (bound.feedback(gains) + bound.force)[:, None]
    rate = -np.log(np.abs(np.linalg.eigvals(closed_loop[-1])).max())
    first = np.array((bound.position[0], bound.velocity[0])) + bound.start
    process = np.asarray(bound.process, dtype=float)
    widths = _truth_widths(closed_loop, gains, first, pushed, process, int(np.ceil(_HOLD_CONSTANTS / rate)))
    clearance, speed, force = widths
    return Tube(gain, clearance + bound.position, speed + bound.velocity, clearance, force + bound.feedback(gain))


@njit
def _truth_widths(
    closed_loop: FloatArray, gains: FloatArray, first: FloatArray, pushed: FloatArray, process: FloatArray, held: int
) -> FloatArray:
    """Return the half widths of ``Z_{k+1} = A_k Z_k + W_k`` in position, velocity and feedback, shape (3, K).

    W_k is the zonotope of the generator `pushed` and the box `process`. The last width is the largest over `held` more
    steps with the last A and W.

    Args:
        closed_loop: Matrices A_k, shape (K, 2, 2).
        gains: Gains, the directions of feedback, shape (K, 2).
        first: Half sizes of the box Z_0, shape (2,).
        pushed: Generator of W_k, shape (K, 2).
        process: Half sizes of the box in W_k, shape (2,).
        held: Number of steps after the last.
    """
    steps = len(gains)
    x, y = np.zeros(2 + 3 * (steps - 1)), np.zeros(2 + 3 * (steps - 1))
    x[0], y[1] = first[0], first[1]
    widths = np.zeros((3, steps))
    for k in range(steps):
        used = 2 + 3 * k
        for i in range(used):
            widths[0, k] += abs(x[i])
            widths[1, k] += abs(y[i])
            widths[2, k] += abs(gains[k, 0] * x[i] + gains[k, 1] * y[i])
        if k + 1 < steps:
            a = closed_loop[k]
            for i in range(used):
                x[i], y[i] = a[0, 0] * x[i] + a[0, 1] * y[i], a[1, 0] * x[i] + a[1, 1] * y[i]
            x[used], y[used] = pushed[k, 0], pushed[k, 1]
            x[used + 1], y[used + 2] = process[0], process[1]
    a = closed_loop[-1]
    for row in range(3):
        p = gains[-1, 0] if row == 2 else 1.0 - row
        v = gains[-1, 1] if row == 2 else 1.0 * row
        added = 0.0
        for _ in range(held):
            width = added
            for i in range(len(x)):
                width += abs(p * x[i] + v * y[i])
            widths[row, -1] = max(widths[row, -1], width)
            added += abs(p * pushed[-1, 0] + v * pushed[-1, 1]) + abs(p) * process[0] + abs(v) * process[1]
            p, v = p * a[0, 0] + v * a[1, 0], p * a[0, 1] + v * a[1, 1]
    return widths


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
        keep_in: Half sizes of the keep-in box about the origin of W [m], shape (3,); infinite for no box.
    """

    force: float = 0.30
    speed: float = 0.20
    keep_in: FloatArray = field(default_factory=lambda: np.array([0.8, 3.0, 0.8]))


def remaining(axis: Axis, reference: TrackedReference, tube: Tube, limits: TrackingLimits, k: int = 0) -> FloatArray:
    """Return what a reference and its tube leave of the limits from step k on, shape (3, 3).

    The rows are the axes of W, the columns the position [m], the velocity [m/s] and the force [N]. A negative entry
    means that the tube about the reference exceeds the limit.
    """
    steps = np.minimum(np.arange(len(reference.position)), len(tube.position) - 1)
    most = np.stack((limits.keep_in, np.full(3, limits.speed), np.full(3, limits.force)), axis=1)
    widths = np.stack((tube.position, tube.velocity, tube.force), axis=1)[steps][:, None, :]
    centre = np.stack((reference.position, reference.velocity, reference.feed_forward(axis)), axis=2)
    return np.asarray((most - widths - np.abs(centre))[k:].min(axis=0))
