"""A cross-check of the convex programming: the same approach by SciPy's sequential least squares programming."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.optimize import minimize

from safe_inspect.rendezvous.planner.problem import ApproachProblem
from safe_inspect.rendezvous.planner.scp import (
    ITERATIONS,
    RESERVE,
    ConstraintRows,
    LinearLimits,
    ScpResult,
    constraint_rows,
    within_limits,
)
from safe_inspect.types import FloatArray

_ACCURACY = 1e-7  # of SciPy's stopping rule
_FEASIBLE = 1e-4  # m: it ends on the constraints, not inside them


def optimise_slsqp(problem: ApproachProblem, points: FloatArray) -> ScpResult:
    """Return the approach that SLSQP reaches from a start in at most four times as many iterations as `optimise_scp`.

    Args:
        problem: The approach.
        points: Control points to start from [m], shape (n, 3); those of the ends are kept.
    """
    feasible_points = within_limits(problem, points)
    if feasible_points is None:
        return ScpResult(points, problem.cost(points), np.inf, 0, False)
    linear, free, basis = LinearLimits.of(problem), problem.basis.free, problem.basis
    hull = np.kron(linear.rows, np.eye(3))

    def whole(x: FloatArray) -> FloatArray:
        full = feasible_points.copy()
        full[free] = x.reshape(-1, 3)
        return full

    def worst(x: FloatArray) -> tuple[ConstraintRows, Any]:
        """Return the rows, and of each group the index of the smallest value."""
        rows = constraint_rows(problem, whole(x))
        order = np.lexsort((rows.value, rows.group))
        return rows, order[np.unique(rows.group[order], return_index=True)[1]]

    def value(x: FloatArray) -> FloatArray:
        rows, index = worst(x)
        return np.asarray(rows.value[index] - RESERVE)

    def jacobian(x: FloatArray) -> FloatArray:
        rows, index = worst(x)
        sample = rows.sample[index]
        matrix = basis.values[0][sample, free][:, :, None] * rows.to_position[index][:, None]
        matrix += basis.values[1][sample, free][:, :, None] * rows.to_velocity[index][:, None]
        return np.asarray(matrix.reshape(len(index), -1))

    lower, upper = linear.lower.ravel(), linear.upper.ravel()
    result = minimize(
        lambda x: problem.cost(whole(x)),
        feasible_points[free].ravel(),
        jac=lambda x: (problem.hessian @ whole(x))[free].ravel(),
        method="SLSQP",
        bounds=np.stack((-np.tile(linear.box, len(linear.rows[0])), np.tile(linear.box, len(linear.rows[0]))), axis=1),
        constraints=[
            {"type": "ineq", "fun": value, "jac": jacobian},
            {"type": "ineq", "fun": lambda x: hull @ x - lower, "jac": lambda x: hull},
            {"type": "ineq", "fun": lambda x: upper - hull @ x, "jac": lambda x: -hull},
        ],
        options={"maxiter": 4 * ITERATIONS, "ftol": _ACCURACY},
    )
    found = whole(result.x)
    violation = float(constraint_rows(problem, found).violations().max())
    kept = linear.hold(found[free], _FEASIBLE)
    return ScpResult(found, problem.cost(found), violation, int(result.nit), violation <= _FEASIBLE and kept)
