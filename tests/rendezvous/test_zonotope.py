"""Planar zonotopes against their vertices."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from safe_inspect.rendezvous.control.zonotope import Zonotope, minkowski_sum


@pytest.fixture
def zonotope() -> Zonotope:
    return Zonotope(np.random.default_rng(0).normal(size=(6, 2)))


def corners(zonotope: Zonotope) -> np.ndarray:
    signs = np.array(list(itertools.product((-1.0, 1.0), repeat=len(zonotope.generators))))
    return signs @ zonotope.generators


def test_support_is_the_largest_over_the_corners(zonotope):
    directions = np.random.default_rng(1).normal(size=(50, 2))
    np.testing.assert_allclose(zonotope.support(directions), (corners(zonotope) @ directions.T).max(axis=0), rtol=1e-12)


def test_the_gauge_of_all_corners_is_at_most_one_and_reached(zonotope):
    gauge = zonotope.gauge(corners(zonotope))
    assert gauge.max() == pytest.approx(1.0, rel=1e-12)


def test_gauge_agrees_with_membership_by_linear_programming(zonotope):
    from scipy.optimize import linprog

    for point in np.random.default_rng(2).normal(scale=3.0, size=(20, 2)):
        # least t with point = sum c_i g_i, |c_i| <= t
        n = len(zonotope.generators)
        cost = np.zeros(n + 1)
        cost[-1] = 1.0
        bound = np.hstack((np.eye(n), -np.ones((n, 1))))
        result = linprog(
            cost,
            A_ub=np.vstack((bound, bound * np.r_[-np.ones(n), 1.0])),
            b_ub=np.zeros(2 * n),
            A_eq=np.hstack((zonotope.generators.T, np.zeros((2, 1)))),
            b_eq=point,
            bounds=[(None, None)] * n + [(0, None)],
        )
        assert zonotope.gauge(point) == pytest.approx(result.fun, rel=1e-7)


def test_sums_images_and_merging_keep_supports(zonotope):
    directions = np.random.default_rng(3).normal(size=(50, 2))
    matrix = np.array([[0.9, 0.2], [-0.1, 0.8]])
    both = minkowski_sum((zonotope, zonotope.mapped(matrix), zonotope.scaled(0.5)))
    expected = 1.5 * zonotope.support(directions) + zonotope.support(directions @ matrix)
    np.testing.assert_allclose(both.support(directions), expected, rtol=1e-12)
    np.testing.assert_allclose(both.merged().support(directions), expected, rtol=1e-9)
    assert len(both.merged().generators) == 12  # the scaled copy is parallel to the first


def test_inclusion_is_exact(zonotope):
    assert zonotope.inclusion(zonotope.scaled(0.999)) == pytest.approx(0.999)
    assert zonotope.inclusion(zonotope) == pytest.approx(1.0)
    assert Zonotope.box((1.0, 2.0)).inclusion(Zonotope(np.array([[0.5, 1.0], [0.5, 1.0]]))) == pytest.approx(1.0)


def test_zero_generators_do_not_make_facets():
    assert len(Zonotope(np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])).normals) == 2
    assert len(Zonotope(np.zeros((2, 2))).merged().generators) == 0
