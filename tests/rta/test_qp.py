"""The quadratic programme against independent solvers: least distance by NNLS, SLSQP, and a linear programme."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linprog, minimize, nnls

from safe_inspect.rta.projection import solve_qp

BOX = np.concatenate((np.eye(3), -np.eye(3)))


def feasible_problems(seed, count, rows=8):
    """Draw problems with a point of the box that meets every row; a fifth of the rows pass through it."""
    generator = np.random.default_rng(seed)
    normals = generator.normal(size=(count, rows, 3))
    normals *= generator.choice([0.01, 1.0, 100.0], (count, rows, 1))
    point = generator.uniform(-1.0, 1.0, (count, 1, 3))
    scale = np.linalg.norm(normals, axis=-1)
    room = generator.exponential(0.3, (count, rows)) * (generator.random((count, rows)) > 0.2)
    return generator.normal(size=(count, 3)) * 1.5, normals, (normals * point).sum(axis=-1) - room * scale


def least_distance(desired, normals, bounds, limit=1.0):
    """Solve by Lawson and Hanson's reduction to non-negative least squares, or by SLSQP where that is inaccurate."""
    scale = np.linalg.norm(normals, axis=1)
    a = np.concatenate((BOX, normals / scale[:, None]))
    c = np.concatenate((np.full(6, -limit), bounds / scale))
    matrix = np.concatenate((a.T, (c - a @ desired)[None]))
    try:
        residual = matrix @ nnls(matrix, np.array([0.0, 0.0, 0.0, 1.0]))[0] - [0.0, 0.0, 0.0, 1.0]
        answer = desired - residual[:3] / residual[3] if residual[3] != 0.0 else np.full(3, np.nan)
    except RuntimeError:
        answer = np.full(3, np.nan)
    if not (a @ answer - c).min() >= -1e-9:
        found = minimize(
            lambda u: ((u - desired) ** 2).sum(), np.zeros(3), jac=lambda u: 2.0 * (u - desired), method="SLSQP",
            constraints={"type": "ineq", "fun": lambda u: a @ u - c, "jac": lambda u: a},
            options={"ftol": 1e-16, "maxiter": 500},
        )  # fmt: skip
        answer = found.x
        assert (a @ answer - c).min() >= -1e-9
    return answer


def agree(seed, count):
    desired, normals, bounds = feasible_problems(seed, count)
    control, feasible = solve_qp(desired, normals, bounds, 1.0)
    assert feasible.all()
    other = np.stack([least_distance(*problem) for problem in zip(desired, normals, bounds, strict=True)])
    assert np.abs(control - other).max() < 1e-6


def test_it_agrees_with_an_independent_solver():
    agree(0, 3_000)


@pytest.mark.slow
def test_it_agrees_with_an_independent_solver_on_100_000_problems():
    agree(1, 100_000)


def infeasible_problems(seed, count):
    desired, normals, bounds = feasible_problems(seed, count)
    bounds = bounds + np.random.default_rng(seed).exponential(1.5, bounds.shape) * np.linalg.norm(normals, axis=-1)
    control, feasible = solve_qp(desired, normals, bounds, 1.0)
    keep = ~feasible
    assert keep.mean() > 0.9
    return desired[keep], normals[keep], bounds[keep], control[keep]


def test_the_least_violating_control_minimises_the_largest_violation():
    for desired, normals, bounds, control in zip(*infeasible_problems(2, 300), strict=True):
        found = linprog(
            [0, 0, 0, 1], A_ub=np.concatenate((-normals, -np.ones((len(normals), 1))), axis=1), b_ub=-bounds,
            bounds=[(-1, 1)] * 3 + [(0, None)],
        )  # fmt: skip
        short = bounds - normals @ control
        assert np.abs(control).max() <= 1.0
        assert short.max() == pytest.approx(found.fun, rel=1e-7, abs=1e-9)
        assert (short > 1e-9 * (1.0 + np.abs(bounds))).any()
        # of all such controls it is the nearest to the desired one
        nearest = least_distance(desired, normals, bounds - short.max() - 1e-9 * (1.0 + short.max()))
        assert np.linalg.norm(control - desired) == pytest.approx(np.linalg.norm(nearest - desired), abs=1e-5)


def test_a_control_that_breaks_nothing_is_unchanged_bit_for_bit():
    desired, normals, bounds = feasible_problems(3, 20_000)
    desired *= 0.3
    free = (np.abs(desired).max(axis=1) <= 1.0) & ((normals * desired[:, None]).sum(axis=-1) >= bounds).all(axis=1)
    assert free.sum() > 20
    np.testing.assert_array_equal(solve_qp(desired, normals, bounds, 1.0)[0][free], desired[free])


def test_parallel_repeated_and_empty_rows():
    x = [1.0, 0.0, 0.0]
    rows = np.array([[x, x, [2.0, 0.0, 0.0], [0.0, 0.0, 0.0]]])
    control, feasible = solve_qp(np.zeros((1, 3)), rows, np.array([[0.5, 0.5, 1.0, -1.0]]), 1.0)
    np.testing.assert_allclose(control, [[0.5, 0.0, 0.0]], atol=1e-12)
    assert feasible.all()
    # a row that does not depend on the control is met or not, and has no part in the choice
    control, feasible = solve_qp(np.zeros((1, 3)), rows, np.array([[0.5, 0.5, 1.0, 1.0]]), 1.0)
    np.testing.assert_allclose(control, [[0.5, 0.0, 0.0]], atol=1e-12)
    assert not feasible.any()
    # opposed planes: halfway between them
    rows = np.array([[x, [-1.0, 0.0, 0.0]]])
    control, feasible = solve_qp(np.array([[0.9, 0.2, 0.3]]), rows, np.array([[0.6, -0.2]]), 1.0)
    np.testing.assert_allclose(control, [[0.4, 0.2, 0.3]], atol=1e-9)
    assert not feasible.any()


def test_no_rows_leave_the_box():
    control, _ = solve_qp(np.array([[2.0, -3.0, 0.1]]), np.zeros((1, 0, 3)), np.zeros((1, 0)), 1.0)
    np.testing.assert_array_equal(control, [[1.0, -1.0, 0.1]])


def test_a_problem_does_not_depend_on_its_batch():
    desired, normals, bounds = feasible_problems(4, 60)
    bounds[::2] += 2.0
    whole = solve_qp(desired, normals, bounds, 1.0)
    for i in range(60):
        alone = solve_qp(desired[i : i + 1], normals[i : i + 1], bounds[i : i + 1], 1.0)
        for part, parts in zip(alone, whole, strict=True):
            np.testing.assert_array_equal(part[0], parts[i])


def test_bad_input_is_named():
    desired, normals, bounds = feasible_problems(5, 4)
    with pytest.raises(ValueError, match="row 2 of the programme"):
        solve_qp(desired, normals, np.where(np.arange(4)[:, None] == 2, np.nan, bounds), 1.0)
