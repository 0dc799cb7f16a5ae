"""Tubes: how far the chaser may be from the nominal trajectory, for all disturbances within their bounds.

The nominal error z and the control ``u = u_r + v + K (x_hat - r_hat - z)`` are those of `mpc`. Two tubes bound what is
left.

``jump``: ``e = (x - r_hat) - z`` obeys ``e+ = A_K e + w``, and changes by at most the reference's jump at each update,
every p-th step. It is the distance to the reference that is followed, so that clearance needs the tube plus the
bound of the reference.

``truth``: ``e = (x - r) - z``, of the true reference r, obeys ``e+ = A_K e - B K delta + B delta_F + w``: delta, the
reference's error, and delta_F, that of its force, act as bounded disturbances, whatever the times of updates. It
bounds the distance to the true reference, so that clearance needs the tube alone.

Source:
    Rakovic, Kerrigan, Kouramas and Mayne, "Invariant approximations of the minimal robust positively invariant set",
    2005; Albee et al. 2021 for tubes about a reference that is estimated on the way.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from safe_inspect.compiling import njit
from safe_inspect.rendezvous.control.axis import Axis
from safe_inspect.rendezvous.control.zonotope import Zonotope, minkowski_sum
from safe_inspect.types import FloatArray

# The most terms of the sum that approximates an invariant set.
_MOST_TERMS = 20_000
# Hold after the last bound, in time constants of the slowest mode: what is left of an error then is 1e-9 of it.
_HOLD_CONSTANTS = 20.0


@dataclass(frozen=True, eq=False)
class AxisBound:
    """What may disturb one axis, at each of K steps. The same bounds hold for the three axes of W.

    Attributes:
        position: Bound of the reference's error in position [m], shape (K,).
        velocity: Bound of its error in velocity [m/s], shape (K,).
        force: Bound of the error of its feed-forward force [N], shape (K,).
        process: Change of the position [m] and the velocity [m/s] by other causes in a step, shape (2,).
        jump: Largest jump of the reference's position [m] and velocity [m/s] at an update, shape (2,).
        period: Steps between two updates.
    """

    position: FloatArray
    velocity: FloatArray
    force: FloatArray
    process: FloatArray
    jump: FloatArray
    period: int = 5

    def feedback(self, gain: FloatArray) -> FloatArray:
        """Return ``|K| b``, the largest feedback force of the reference's error [N], shape (K,).

        Args:
            gain: K, shape (2,), or of each step, shape (K, 2).
        """
        return np.asarray(np.abs(gain[..., 0]) * self.position + np.abs(gain[..., 1]) * self.velocity)


@dataclass(frozen=True, eq=False)
class Tube:
    """Half widths along each axis of W, at each of K steps and, by the last, at all later ones.

    Attributes:
        gain: K = (N/m, N s/m), shape (2,), or of each step, shape (K, 2).
        position: About the reference that is followed plus z [m], shape (K,): what state limits are tightened by.
        velocity: Likewise [m/s], shape (K,).
        clearance: About the true reference plus z [m], shape (K,): what distances to the target lose.
        force: Feedback that may be needed [N], shape (K,): ``h_Z(K) + |K| b`` (truth) or ``h_Z(K)`` (jump).
        start: Set of ``x_hat - r_hat - z`` in which the nominal state may start anew at an update; None where z
            may not start anew.
        certificate: Largest ``h(A_K Z + W) / h(Z)`` over the facets: at most 1 (up to rounding) for a valid tube.
    """

    gain: FloatArray
    position: FloatArray
    velocity: FloatArray
    clearance: FloatArray
    force: FloatArray
    start: Zonotope | None = None
    certificate: float = 1.0

    def gain_at(self, k: int) -> FloatArray:
        """Return the gain of step k, shape (2,)."""
        return self.gain if self.gain.ndim == 1 else self.gain[min(k, len(self.gain) - 1)]


def no_tube(steps: int) -> Tube:
    """Return the tube of width zero without feedback, for control that ignores disturbances."""
    return Tube(np.zeros(2), *np.zeros((4, steps)))


def invariant_set(closed_loop: FloatArray, disturbance: Zonotope, contraction: float = 0.02) -> Zonotope:
    """Return a robust positively invariant set: A_K Z + W inside Z.

    ``Z = (W + A_K W + ... + A_K^(s-1) W) / (1 - alpha)`` with the least s for which A_K^s W lies inside alpha W.
    It is at most 1 / (1 - alpha) times the least such set.

    Args:
        closed_loop: A_K, shape (2, 2), stable.
        disturbance: W, with an interior.
        contraction: alpha, between 0 and 1.

    Raises:
        ValueError: W has no interior, or A_K contracts too slowly.

    Source:
        Rakovic et al. 2005, theorem 1.
    """
    disturbance = disturbance.merged()
    if len(disturbance.generators) < 2:
        raise ValueError("a disturbance set without interior has no invariant approximation; give a process bound > 0")
    terms, image = [], disturbance
    for _ in range(_MOST_TERMS):
        terms.append(image)
        image = image.mapped(closed_loop)
        if disturbance.inclusion(image) <= contraction:
            return minkowski_sum(terms).merged().scaled(1.0 / (1.0 - contraction))
    raise ValueError(f"the closed loop contracts too slowly: {_MOST_TERMS} steps do not shrink W to {contraction}")


def certificate(closed_loop: FloatArray, tube: Zonotope, disturbance: Zonotope) -> float:
    """Return the largest ``h(A_K Z + W) / h(Z)`` over the facets of Z; at most 1 exactly if Z is invariant."""
    return tube.inclusion(tube.mapped(closed_loop) + disturbance)


def truth_disturbance(axis: Axis, gain: FloatArray, bound: AxisBound, k: int | None = None) -> Zonotope:
    """Return W = B (|K| b) + B b_F + W_p at step k, or for the largest bounds of all steps."""
    forces = bound.feedback(gain) + bound.force
    force = float(forces.max()) if k is None else float(forces[k])
    return Zonotope(np.vstack((axis.B * force, np.diag(bound.process))))


def truth_set(axis: Axis, gain: FloatArray, bound: AxisBound) -> Zonotope:
    """Return the invariant set of the ``truth`` tube, scaled (by 1 or more) until it holds the box of +-b."""
    tube = invariant_set(axis.closed_loop(gain), truth_disturbance(axis, gain, bound))
    errors = Zonotope.box((float(bound.position.max()), float(bound.velocity.max())))
    return tube.scaled(max(1.0, tube.inclusion(errors)))


def jump_sets(axis: Axis, gain: FloatArray, bound: AxisBound) -> list[Zonotope]:
    """Return the sets Z_0 (just after an update) to Z_{p-1} of the ``jump`` tube."""
    closed_loop, process = axis.closed_loop(gain), Zonotope.box(bound.process)
    cycle, image = [Zonotope.box(bound.jump)], process
    for _ in range(bound.period):
        cycle.append(image)
        image = image.mapped(closed_loop)
    sets = [invariant_set(np.linalg.matrix_power(closed_loop, bound.period), minkowski_sum(cycle))]
    for _ in range(bound.period - 1):
        sets.append((sets[-1].mapped(closed_loop) + process).merged())
    return sets


def jump_certificate(axis: Axis, gain: FloatArray, bound: AxisBound, sets: list[Zonotope]) -> float:
    """Return the largest ``h(A_K Z_{p-1} + W_p + W_u) / h(Z_0)`` over the facets of Z_0."""
    disturbance = Zonotope.box(bound.process) + Zonotope.box(bound.jump)
    return sets[0].inclusion(sets[-1].mapped(axis.closed_loop(gain)) + disturbance)


def invariant_tube(axis: Axis, gain: FloatArray, bound: AxisBound) -> Tube:
    """Return the ``truth`` tube of constant width, for the largest bounds of all steps."""
    tube = truth_set(axis, gain, bound)
    value = certificate(axis.closed_loop(gain), tube, truth_disturbance(axis, gain, bound))
    widths = np.broadcast_to(_supports([tube], gain)[:, None], (3, len(bound.position)))
    return _truth(gain, widths, bound, value)


def jump_tube(axis: Axis, gain: FloatArray, bound: AxisBound) -> Tube:
    """Return the ``jump`` tube: the width is the largest of a cycle of p steps, at all steps."""
    sets = jump_sets(axis, gain, bound)
    value = jump_certificate(axis, gain, bound, sets)
    position, velocity, force = np.broadcast_to(_supports(sets, gain)[:, None], (3, len(bound.position)))
    return Tube(np.asarray(gain, float), position, velocity, position + bound.position, force, sets[0], value)


def truth_tube(axis: Axis, gain: FloatArray, bound: AxisBound) -> Tube:
    """Return the ``truth`` tube that follows the bounds: Z_0 = +-b(t_0), Z_{k+1} = A_K Z_k + W_k.

    By its definition it needs no certificate; 1 is returned. After the last step bounds and gain stay as they are
    there, and the last width is the largest of all later ones.

    Args:
        axis: The axis.
        gain: K, shape (2,), or of each step, shape (K, 2).
        bound: What disturbs the axis.
    """
    gain = np.asarray(gain, dtype=float)
    gains = np.array(np.broadcast_to(gain, (len(bound.position), 2)))
    closed_loop = axis.closed_loop(gains)
    pushed = axis.B * (bound.feedback(gains) + bound.force)[:, None]
    rate = -np.log(np.abs(np.linalg.eigvals(closed_loop[-1])).max())
    first = np.array((bound.position[0], bound.velocity[0]))
    process = np.asarray(bound.process, dtype=float)
    widths = _truth_widths(closed_loop, gains, first, pushed, process, int(np.ceil(_HOLD_CONSTANTS / rate)))
    return _truth(gain, widths, bound, 1.0)


@njit
def _truth_widths(
    closed_loop: FloatArray, gains: FloatArray, first: FloatArray, pushed: FloatArray, process: FloatArray, held: int
) -> FloatArray:
    """Return the half widths of ``Z_{k+1} = A_k Z_k + W_k`` in position, velocity and feedback, shape (3, K).

    W_k is the zonotope of the generator `pushed` and the box `process`. The last width is the largest of `held` steps
    with the last A and W.

    Args:
        closed_loop: A_k, shape (K, 2, 2).
        gains: Directions of feedback, shape (K, 2).
        first: Half sizes of the box Z_0, shape (2,).
        pushed: A generator of W_k, shape (K, 2).
        process: Half sizes of the box that W_k has too, shape (2,).
        held: Number of steps.
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


def _supports(sets: list[Zonotope], gain: FloatArray) -> FloatArray:
    """Return the largest half widths of some sets in position [m], velocity [m/s] and feedback [N], shape (3,)."""
    directions = np.array([[1.0, 0.0], [0.0, 1.0], gain])
    return np.asarray(np.max([item.support(directions) for item in sets], axis=0))


def _truth(gain: FloatArray, widths: FloatArray, bound: AxisBound, value: float) -> Tube:
    """Return a ``truth`` tube of half widths in position, velocity and feedback, shape (3, K)."""
    position, velocity, force = widths
    return Tube(
        np.asarray(gain, dtype=float),
        position + bound.position,
        velocity + bound.velocity,
        position,
        force + bound.feedback(gain),
        None,
        value,
    )
