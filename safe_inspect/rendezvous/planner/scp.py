"""Sequential convex programming of the free control points, with a trust region and an exact penalty; its constraints.

Each iteration linearises the constraints, gives each group of rows a slack with L1 cost, treats the linear limits as
hard constraints, and solves ``min cost + weight sum(slack)`` within the trust region. Source: Nocedal and Wright,
"Numerical Optimization", Springer 2006, chapter 18 (Sl1QP).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from safe_inspect.rendezvous.libraries import require
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
    distance, gradient = problem.query.solid.distances(points)
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


#: Largest number of iterations.
ITERATIONS = 25
#: Initial bound of the change of each coordinate of a control point [m], and initial weight of a violation [1/m].
_TRUST, _WEIGHT = 0.3, 10.0
#: Change of a coordinate [m] and relative predicted decrease of the merit below which the iteration has converged.
_STEP, _GAIN = 2e-3, 1e-3
#: Largest violation of a feasible plan [m].
_TOLERANCE = 1e-6
#: Value that the linearised constraints must exceed, because of the error of the linearisation [m].
RESERVE = 1e-4


@dataclass(frozen=True, eq=False)
class ScpResult:
    """The result of the optimisation.

    Attributes:
        points: Control points [m], shape (n, 3).
        cost: The cost.
        violation: Largest violation at the samples [m].
        iterations: Number of solved quadratic programmes.
        feasible: Whether the violation is within the tolerance, and the linear limits hold.
    """

    points: FloatArray
    cost: float
    violation: float
    iterations: int
    feasible: bool


@dataclass(frozen=True, eq=False)
class LinearLimits:
    """Limits of the hulls of velocity and acceleration, ``lower <= rows @ free points <= upper``, a column per axis."""

    rows: FloatArray
    lower: FloatArray
    upper: FloatArray
    box: FloatArray

    @classmethod
    def of(cls, problem: ApproachProblem) -> LinearLimits:
        """Return the limits of an approach as limits on its free control points."""
        limits, basis = problem.limits, problem.basis
        hulls = np.concatenate((basis.velocity_hull, basis.acceleration_hull))
        bound = np.repeat(
            (limits.speed, problem.query.planned_acceleration), (len(basis.velocity_hull), len(basis.acceleration_hull))
        )
        touched = np.abs(hulls[:, basis.free]).max(axis=1) > 0.0
        fixed = hulls[touched] @ problem.ends
        scale = 1.0 / bound[touched][:, None]
        return cls(hulls[touched][:, basis.free] * scale, -1.0 - fixed * scale, 1.0 - fixed * scale, limits.keep_in)

    def hold(self, free: FloatArray, tolerance: float = 1e-6) -> bool:
        """Return whether free control points satisfy the limits."""
        hull = self.rows @ free
        inside = (np.abs(free) <= self.box + tolerance).all()
        return bool(inside and (hull >= self.lower - tolerance).all() and (hull <= self.upper + tolerance).all())


def within_limits(problem: ApproachProblem, points: FloatArray) -> FloatArray | None:
    """Return the nearest control points that satisfy the linear limits, or None if there are none.

    Args:
        problem: The approach.
        points: Control points [m], shape (n, 3); those of the ends do not change.
    """
    linear, free = LinearLimits.of(problem), problem.basis.free
    wanted = points[free]
    if linear.hold(wanted):
        return points
    count, result = len(wanted), points.copy()
    for axis in range(3):
        solved = _solve(
            np.eye(count),
            -wanted[:, axis],
            linear.rows,
            (linear.lower[:, axis], linear.upper[:, axis]),
            (np.full(count, -linear.box[axis]), np.full(count, linear.box[axis])),
        )
        if solved is None:
            return None
        result[free, axis] = solved
    return result if linear.hold(result[free]) else None


def optimise_scp(problem: ApproachProblem, points: FloatArray) -> ScpResult:
    """Optimise an approach from initial control points.

    Args:
        problem: The approach.
        points: Initial control points [m], shape (n, 3); those of the ends do not change.
    """
    feasible_points = within_limits(problem, points)
    if feasible_points is None:
        return ScpResult(points, problem.cost(points), np.inf, 0, False)
    points, linear = feasible_points, LinearLimits.of(problem)
    trust, weight = _TRUST, _WEIGHT
    cost, rows = problem.cost(points), constraint_rows(problem, points)
    violations = rows.violations()
    iteration = 0
    while iteration < ITERATIONS:
        iteration += 1
        candidate, model, slack = _step(problem, linear, points, rows, trust, weight)
        if candidate is None:
            trust *= 0.4
            if trust < _STEP:
                break
            continue
        step = float(np.abs(candidate - points).max())
        new_cost, new_rows = problem.cost(candidate), constraint_rows(problem, candidate)
        new_violations = new_rows.violations()
        merit = cost + weight * violations.sum()
        predicted = merit - model - weight * slack
        actual = merit - new_cost - weight * new_violations.sum()
        converged = step < _STEP or predicted < _GAIN * cost
        if actual >= 0.1 * predicted or (converged and new_violations.max() <= _TOLERANCE):
            points, cost, rows, violations = candidate, new_cost, new_rows, new_violations
            trust = min(1.5 * trust, 1.0)
        else:
            trust *= 0.4
            converged = converged or trust < _STEP
        if converged:
            if violations.max() <= _TOLERANCE or weight >= 1e5:
                break
            weight, trust = 10.0 * weight, max(trust, 0.1 * _TRUST)
    violation = float(violations.max())
    return ScpResult(points, cost, violation, iteration, violation <= _TOLERANCE)


def _step(
    problem: ApproachProblem,
    linear: LinearLimits,
    points: FloatArray,
    rows: ConstraintRows,
    trust: float,
    weight: float,
) -> tuple[FloatArray | None, float, float]:
    """Return the solution of the convex subproblem, its modelled cost and the sum of its slacks; None if unsolved."""
    from scipy.sparse import csc_matrix, hstack  # This import is slow.

    basis = problem.basis
    free, values = basis.free, basis.values[:, :, basis.free]
    current, size = points[free], 3 * (basis.gram.shape[0] - 6)
    row = values[0][rows.sample][:, :, None] * rows.to_position[:, None]
    row += values[1][rows.sample][:, :, None] * rows.to_velocity[:, None]
    row = row.reshape(len(rows.value), size)
    active = rows.value < RESERVE + trust * np.abs(row).sum(axis=1)  # The others hold in all of the trust region.
    row, value = row[active], rows.value[active] - RESERVE
    used, slack = np.unique(rows.group[active], return_inverse=True)
    hull = np.kron(linear.rows, np.eye(3))
    shift = linear.rows @ current
    slope = problem.hessian @ points
    dense = np.kron(problem.hessian[free, free], np.eye(3))
    hessian = csc_matrix(dense.T)
    hessian.resize((size + len(used), size + len(used)))
    ones = (np.ones(len(row)), (len(hull) + np.arange(len(row)), slack))
    groups = csc_matrix(ones, shape=(len(hull) + len(row), len(used)))
    matrix = hstack((csc_matrix(np.concatenate((hull, row))), groups), format="csc")
    solved = _solve(
        hessian,
        np.concatenate((slope[free].ravel(), np.full(len(used), weight))),
        matrix,
        (
            np.concatenate(((linear.lower - shift).ravel(), -value)),
            np.concatenate(((linear.upper - shift).ravel(), np.full(len(row), np.inf))),
        ),
        (
            np.concatenate((np.maximum(-trust, -linear.box - current).ravel(), np.zeros(len(used)))),
            np.concatenate((np.minimum(trust, linear.box - current).ravel(), np.full(len(used), np.inf))),
        ),
    )
    if solved is None:
        return None, 0.0, 0.0
    change, candidate = solved[:size], points.copy()
    candidate[free] += change.reshape(-1, 3)
    cost = problem.cost(points) + float(slope[free].ravel() @ change + 0.5 * change @ dense @ change)
    return candidate, cost, float(np.maximum(solved[size:], 0.0).sum())


def _solve(
    hessian: Any,
    gradient: FloatArray,
    matrix: Any,
    row_bounds: tuple[FloatArray, FloatArray],
    bounds: tuple[FloatArray, FloatArray],
) -> FloatArray | None:
    """Solve a convex quadratic programme with dense or sparse matrices; return None without a solution."""
    from scipy.sparse import csc_matrix  # This import is slow.

    piqp = require("piqp")
    solver = piqp.SparseSolver()
    solver.settings.eps_abs = solver.settings.eps_rel = 1e-9
    solver.setup(csc_matrix(hessian), gradient, None, None, csc_matrix(matrix), *row_bounds, *bounds)
    if solver.solve() != piqp.PIQP_SOLVED:
        return None
    return np.array(solver.result.x)  # Copy the result: the next solve overwrites it.
