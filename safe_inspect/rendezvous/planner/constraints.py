"""The constraints g >= 0 that are not linear in the control points, with their gradients, at the samples."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from safe_inspect.rendezvous.planner.problem import ApproachProblem
from safe_inspect.types import FloatArray, IntArray

_NEXT_BOX = 0.1  # m: Boxes farther away than the nearest one by this distance are ignored.


@dataclass(frozen=True, eq=False)
class ConstraintRows:
    """Linearised constraints: ``value + to_position . dp + to_velocity . dv >= -slack[group]``.

    Attributes:
        value: Values of the constraints, in m or scaled to m, shape (m,).
        to_position: Gradients with respect to the position in W, shape (m, 3).
        to_velocity: Gradients with respect to the velocity in W, shape (m, 3).
        sample: Index of each row's sample, shape (m,).
        group: Index of each row's group, shape (m,); the rows of a group, e.g. all boxes near a sample, share a slack.
    """

    value: FloatArray
    to_position: FloatArray
    to_velocity: FloatArray
    sample: IntArray
    group: IntArray

    def violations(self) -> FloatArray:
        """Return the violation of each group, shape (groups,)."""
        worst = np.zeros(int(self.group.max()) + 1)
        np.maximum.at(worst, self.group, -self.value)
        return worst


def _clearance_rows(problem: ApproachProblem, p: FloatArray) -> tuple[FloatArray, FloatArray, IntArray]:
    """Return values, gradients and samples of ``d_j(R_MW p) - radius - margin`` for the boxes near each sample."""
    points = np.einsum("kij,kj->ki", problem.R_MW, p)
    distance, gradient = problem.query.boxes.distances(points)
    sample, box = np.nonzero(distance < distance.min(axis=1, keepdims=True) + _NEXT_BOX)
    value = distance[sample, box] - problem.limits.radius - problem.margin[sample]
    return value, np.einsum("rij,ri->rj", problem.R_MW[sample], gradient[sample, box]), sample


def _line_of_sight_rows(rate: float, p: FloatArray, v: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return values and gradients of the limit ``|p x v| / |p|^2 <= rate`` on the rate of the line of sight.

    With c = p x v, A = rate^2, r = |p| and N = A r^4 - c.c the constraint, scaled to m, is ``h = N / (2 A r^3)``. Its
    gradients are ``dh/dp = (4 A r^2 p - 2 v x c) / (2 A r^3) - 3 N p / (2 A r^5)`` and ``dh/dv = -c x p / (A r^3)``.

    Args:
        rate: The limit [rad/s].
        p: Positions in W [m], shape (K, 3).
        v: Velocities in W [m/s], shape (K, 3).
    """
    r2 = np.maximum((p * p).sum(axis=1), 1e-6)
    c, square = np.cross(p, v), rate * rate
    n = square * r2 * r2 - (c * c).sum(axis=1)
    scale = 1.0 / (2.0 * square * r2 * np.sqrt(r2))
    to_position = (4.0 * square * r2[:, None] * p - 2.0 * np.cross(v, c)) * scale[:, None]
    to_position -= (3.0 * n * scale / r2)[:, None] * p
    return n * scale, to_position, -2.0 * np.cross(c, p) * scale[:, None]


def _cone_rows(axis: FloatArray, half_angle: float, p: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return values and gradients of ``axis . p - cos(half_angle) |p|``.

    Args:
        axis: Unit vectors along the axis of the cone, shape (K, 3).
        half_angle: Half angle of the cone [rad].
        p: Positions [m], shape (K, 3).
    """
    r = np.sqrt(np.maximum((p * p).sum(axis=1), 1e-6))
    cosine = np.cos(half_angle)
    return (axis * p).sum(axis=1) - cosine * r, axis - cosine * p / r[:, None]


def constraint_rows(problem: ApproachProblem, points: FloatArray) -> ConstraintRows:
    """Return the rows of all constraints at the samples between the two ends.

    Args:
        problem: The approach.
        points: Control points [m], shape (n, 3).
    """
    limits, values = problem.limits, problem.basis.values
    p, v = values[0] @ points, values[1] @ points
    k = np.arange(len(p))
    r = np.sqrt(np.maximum((p * p).sum(axis=1), 1e-6))
    value, gradient, sample = _clearance_rows(problem, p)
    sight, sight_p, sight_v = _line_of_sight_rows(limits.line_of_sight_rate, p, v)
    parts = [
        (value, gradient, np.zeros_like(gradient), sample),
        (sight, sight_p, sight_v, k),
        (r - limits.least_range, p / r[:, None], np.zeros_like(p), k),
    ]
    if limits.cone is not None:  # within the cone or far enough away
        cone, cone_p = _cone_rows(problem.mating_direction, limits.cone, p)
        far = r - limits.cone_range > cone
        cone = np.where(far, r - limits.cone_range, cone)
        parts.append((cone, np.where(far[:, None], p / r[:, None], cone_p), np.zeros_like(p), k))
    value, to_position, to_velocity, sample = (np.concatenate(column) for column in zip(*parts, strict=True))
    group = np.concatenate([i * len(p) + part[3] for i, part in enumerate(parts)])
    inner = (sample > 0) & (sample < len(p) - 1)  # The ends are fixed.
    return ConstraintRows(value[inner], to_position[inner], to_velocity[inner], sample[inner], group[inner])
