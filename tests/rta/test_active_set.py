"""The joint quadratic programme, against the exact projection of one deputy and against conditions of optimality."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog, minimize, nnls

from safe_inspect.rta.active_set import nearest_joint, qp_workspace
from safe_inspect.rta.projection import nearest, projection_workspace


def problem(seed, variables, count, spread):
    generator = np.random.default_rng(seed)
    rows = generator.normal(size=(count, variables))
    rows /= np.linalg.norm(rows, axis=1, keepdims=True)
    return rows, generator.uniform(-spread, 0.3, count), generator.uniform(-1.5, 1.5, variables)


@pytest.mark.parametrize("seed", range(40))
def test_one_deputy_against_the_exact_projection(seed):
    count = 8
    rows, bounds, target = problem(seed, 3, count, 0.5)
    exact, found = np.empty(3), np.empty(3)
    work = projection_workspace(count)
    good = nearest(rows, bounds, count, 1.0, target, False, exact, work)
    assert nearest_joint(rows, bounds, count, 1.0, target, found, qp_workspace(3)) == good
    if good:
        np.testing.assert_allclose(found, exact, atol=1e-8)


@pytest.mark.parametrize("bound", [0.0, 0.5])
def test_a_row_without_a_direction_holds_or_is_missed_and_the_rows_behind_it_count(bound):
    rows = np.array([[0.0, 0.0, 2.0], [0.0, 0.0, 0.0], [3.0, 0.0, 0.0]])
    bounds, found = np.array([-1.0, bound, 1.5]), np.empty(3)
    met = nearest(rows, bounds, 3, 1.0, np.array([-0.8, 0.3, -0.9]), True, found, projection_workspace(3))
    assert met == (bound <= 0.0)
    np.testing.assert_allclose(found, [0.5, 0.3, -0.5], atol=1e-9)


@pytest.mark.parametrize("variables", [9, 30])
def test_the_answer_meets_the_conditions_of_optimality(variables):
    solved = 0
    for seed in range(12):
        count = 2 * variables
        rows, bounds, target = problem(100 + seed, variables, count, 1.0)
        found = np.empty(variables)
        if not nearest_joint(rows, bounds, count, 1.0, target, found, qp_workspace(variables)):
            continue
        solved += 1
        assert (rows @ found - bounds).min() > -1e-8
        assert np.abs(found).max() <= 1.0
        normals = np.concatenate((rows, np.eye(variables), -np.eye(variables)))
        offsets = np.concatenate((bounds, -np.ones(2 * variables)))
        active = normals @ found - offsets < 1e-7
        # the step away from the target is a sum of active normals with multipliers that are not negative
        _, rest = nnls(normals[active].T, found - target)
        assert rest < 1e-6
    assert solved >= 6


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    variables=st.sampled_from([3, 6, 9]),
    count=st.integers(0, 24),
    spread=st.floats(0.0, 1.5),
    shift=st.floats(-0.6, 0.6),
)
def test_it_agrees_with_scipy_on_whether_there_is_a_point_and_how_far_it_is(seed, variables, count, spread, shift):
    rows, bounds, target = problem(seed, variables, count, spread)
    bounds = bounds + shift
    found = np.empty(variables)
    there_is = nearest_joint(rows, bounds, count, 1.0, target, found, qp_workspace(variables))
    # the largest distance by which a point of the box can keep every half-space
    widest = linprog(
        np.r_[np.zeros(variables), -1.0], A_ub=np.c_[-rows, np.ones(count)] if count else None,
        b_ub=-bounds if count else None, bounds=[(-1.0, 1.0)] * variables + [(None, 10.0)],
    )  # fmt: skip
    if abs(widest.fun) < 1e-7:
        return  # neither solver can tell
    assert there_is == (widest.fun < 0.0)
    if there_is:
        assert (rows @ found - bounds).min(initial=0.0) > -1e-8
        assert np.abs(found).max() <= 1.0
        other = minimize(
            lambda u: ((u - target) ** 2).sum(), widest.x[:-1], jac=lambda u: 2.0 * (u - target), method="SLSQP",
            bounds=[(-1.0, 1.0)] * variables, options={"ftol": 1e-15, "maxiter": 500},
            constraints={"type": "ineq", "fun": lambda u: rows @ u - bounds, "jac": lambda u: rows} if count else (),
        )  # fmt: skip
        assert np.linalg.norm(found - target) <= np.linalg.norm(other.x - target) + 1e-6
