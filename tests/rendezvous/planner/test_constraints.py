from dataclasses import replace

import numpy as np
import pytest

from safe_inspect.rendezvous.planner.problem import approach_problem
from safe_inspect.rendezvous.planner.query import Limits
from safe_inspect.rendezvous.planner.scp import _cone_rows, _line_of_sight_rows, constraint_rows

STEP = 1e-6


def _slopes(function, x):
    return np.stack([(function(x + STEP * e) - function(x - STEP * e)) / (2 * STEP) for e in np.eye(3)], axis=-1)


@pytest.fixture
def states():
    generator = np.random.default_rng(0)
    return generator.uniform(-1.5, 1.5, (200, 3)), generator.uniform(-0.1, 0.1, (200, 3))


def test_the_gradients_of_the_line_of_sight(states):
    p, v = states
    _, to_position, to_velocity = _line_of_sight_rows(0.17, p, v)
    scale = 1e-8 * (1.0 + np.abs(to_position).max())
    assert np.allclose(to_position, _slopes(lambda x: _line_of_sight_rows(0.17, x, v)[0], p), atol=scale, rtol=1e-6)
    assert np.allclose(to_velocity, _slopes(lambda x: _line_of_sight_rows(0.17, p, x)[0], v), atol=scale, rtol=1e-6)


def test_the_line_of_sight_is_limited_where_its_rate_is_the_limit(states):
    p, v = states
    rate = np.linalg.norm(np.cross(p, v), axis=1) / (p * p).sum(axis=1)
    value, _, _ = _line_of_sight_rows(0.1, p, v)
    assert ((value >= 0.0) == (rate <= 0.1)).all()
    assert (value <= 0.5 * np.linalg.norm(p, axis=1)).all()


def test_the_gradient_of_a_cone(states):
    p, _ = states
    axis = np.random.default_rng(1).normal(size=p.shape)
    axis /= np.linalg.norm(axis, axis=1)[:, None]
    value, gradient = _cone_rows(axis, 0.5, p)
    assert np.allclose(gradient, _slopes(lambda x: _cone_rows(axis, 0.5, x)[0], p), atol=1e-8)
    angle = np.arccos((axis * p).sum(axis=1) / np.linalg.norm(p, axis=1))
    assert ((value >= 0.0) == (angle <= 0.5)).all()


def test_the_rows_of_an_approach_are_the_slopes_of_its_constraints(query):
    asked = query(3, limits=Limits(cone=np.deg2rad(30.0)))
    problem = approach_problem(asked, 0.0, 60.0, 20, 61)
    points = problem.cold()
    rows = constraint_rows(problem, points)
    free, values = problem.basis.free, problem.basis.values
    matrix = values[0][rows.sample, free][:, :, None] * rows.to_position[:, None]
    matrix += values[1][rows.sample, free][:, :, None] * rows.to_velocity[:, None]
    change = np.zeros_like(points)
    change[free] = np.random.default_rng(2).normal(size=(14, 3)) * 1e-6
    ahead, behind = constraint_rows(problem, points + change), constraint_rows(problem, points - change)
    assert len(ahead.value) == len(behind.value) == len(rows.value)
    slope = (ahead.value - behind.value) / 2.0
    assert np.allclose(slope, np.einsum("rca,ca->r", matrix, change[free]), atol=2e-11)
    assert rows.sample.min() == 1
    assert rows.sample.max() == 59
    assert len(rows.violations()) > rows.group.max()


def test_the_cone_holds_within_its_range_alone(query):
    problem = approach_problem(query(3, limits=Limits(cone=np.deg2rad(30.0))), 0.0, 60.0, 20, 121)
    near = replace(problem, query=query(3, limits=Limits(cone=np.deg2rad(30.0), cone_range=0.1)))
    without = replace(problem, query=query(3))
    assert constraint_rows(near, problem.cold()).violations().max() == pytest.approx(
        constraint_rows(without, problem.cold()).violations().max()
    )
