"""The joint quadratic programme, against the exact projection of one deputy and against conditions of optimality."""

from __future__ import annotations

import numpy as np
import pytest

from safe_inspect.rta.filters.projection import nearest
from safe_inspect.rta.filters.team_programme import nearest_joint, programme


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
    good = nearest(
        rows, bounds, count, 1.0, target, False, exact, np.empty(count, bool), np.empty((count + 6, 3)),
        np.empty(count + 6), np.empty(count), np.empty(3),
    )  # fmt: skip
    assert nearest_joint(rows, bounds, count, 1.0, target, found, programme(3)) == good
    if good:
        np.testing.assert_allclose(found, exact, atol=1e-8)


@pytest.mark.parametrize("variables", [9, 30])
def test_the_answer_meets_the_conditions_of_optimality(variables):
    scipy_optimize = pytest.importorskip("scipy.optimize")
    solved = 0
    for seed in range(12):
        count = 2 * variables
        rows, bounds, target = problem(100 + seed, variables, count, 1.0)
        found = np.empty(variables)
        if not nearest_joint(rows, bounds, count, 1.0, target, found, programme(variables)):
            continue
        solved += 1
        assert (rows @ found - bounds).min() > -1e-8
        assert np.abs(found).max() <= 1.0
        normals = np.concatenate((rows, np.eye(variables), -np.eye(variables)))
        offsets = np.concatenate((bounds, -np.ones(2 * variables)))
        active = normals @ found - offsets < 1e-7
        # the step away from the target is a sum of active normals with multipliers that are not negative
        _, rest = scipy_optimize.nnls(normals[active].T, found - target)
        assert rest < 1e-6
    assert solved >= 6
