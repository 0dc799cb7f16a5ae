"""The continuous-time filter: its conditions against derivatives along the motion, and its answers."""

from __future__ import annotations

import numpy as np
import pytest

from safe_inspect.dynamics.cwh import transition
from safe_inspect.rta.constraints import RelativeState
from safe_inspect.rta.continuous import ContinuousFilter

N, MASS = 0.001027, 12.0
SMOOTH = ["chief_collision", "rel_vel", "sun", "r_max", "x_vel", "y_vel", "z_vel"]


def moved(state, control, time):
    phi, gamma = transition(N, MASS, time)
    after = np.concatenate((state.position, state.velocity), axis=1) @ phi.T + control @ gamma.T
    return RelativeState(after[:, :3], after[:, 3:], state.sun_angle + N * time)


def test_the_conditions_are_the_derivative_of_h_along_the_motion(draw):
    state = draw(1, 500, nearest=20.0, farthest=700.0, fastest=0.5)
    control = np.random.default_rng(1).uniform(-1.0, 1.0, (500, 3))
    run = ContinuousFilter(names=SMOOTH)
    evaluations = [constraint.evaluate(state) for constraint in run.constraints.values()]
    rows, bounds = run.conditions(state, evaluations)
    step = 1e-3
    for j, (constraint, value) in enumerate(zip(run.constraints.values(), evaluations, strict=True)):
        slope = constraint.h(moved(state, control, step)) - constraint.h(moved(state, control, -step))
        slope /= 2.0 * step
        alpha = np.where(
            value.h < 0, 10 * constraint.alpha(value.h - 0.01), constraint.alpha(value.h + constraint.bias)
        )
        size = np.linalg.norm(value.gradient[:, 3:], axis=1) / MASS
        smooth = np.abs(value.phi) > 0.05  # the root of h is steep on the boundary
        np.testing.assert_allclose(
            ((rows[:, j] * control).sum(axis=1) - bounds[:, j])[smooth] * size[smooth],
            (slope + alpha)[smooth], rtol=1e-4, atol=1e-6,
        )  # fmt: skip


def test_the_answer_meets_the_conditions_that_can_be_met(draw):
    state = draw(2, 2_000, nearest=15.0, farthest=400.0, fastest=0.3)
    desired = np.random.default_rng(2).uniform(-1.0, 1.0, (2_000, 3))
    run = ContinuousFilter()
    result = run(state, desired)
    rows, bounds = run.conditions(state, [constraint.evaluate(state) for constraint in run.constraints.values()])
    short = bounds - (rows * result.control[:, None]).sum(axis=-1)
    met = ~result.infeasible
    assert 0.1 < met.mean() < 1.0
    assert short[met].max() < 1e-8
    assert (short[~met].max(axis=1) > 0.0).all()
    assert (result.active[met & result.intervening] != 0).all()
    np.testing.assert_array_equal(result.phi, run.phi(state))


def test_where_infeasible_it_passes_the_desired_control_on_if_asked_to(draw):
    state = draw(3, 500, fastest=1.5)
    desired = np.random.default_rng(3).uniform(-2.0, 2.0, (500, 3))
    passing, least = ContinuousFilter(infeasible="pass")(state, desired), ContinuousFilter()(state, desired)
    rows = passing.infeasible
    assert rows.any()
    np.testing.assert_array_equal(rows, least.infeasible)
    np.testing.assert_array_equal(passing.control[rows], np.clip(desired[rows], -1.0, 1.0))
    np.testing.assert_array_equal(passing.control[~rows], least.control[~rows])
    assert np.abs(least.control).max() <= 1.0


def test_outside_the_safe_set_it_brakes_harder():
    run = ContinuousFilter(names=["x_vel"])
    state = RelativeState(np.full((1, 3), 50.0), np.array([[1.1, 0.0, 0.0]]), np.zeros(1))
    rows, bounds = run.conditions(state, [run.constraints["x_vel"].evaluate(state)])
    h = 1.0 - 1.1**2
    descent = 10.0 * (0.1 * (h - 0.01) + 0.01 * (h - 0.01) ** 3)
    slope = -2.0 * 1.1 * 3.0 * N * N * 50.0
    assert rows[0, 0] == pytest.approx([-1.0, 0.0, 0.0])
    assert bounds[0, 0] == pytest.approx(-(slope + descent) * MASS / 2.2)


def test_bad_input_is_named(draw):
    state = draw(4, 5)
    desired = np.zeros((5, 3))
    desired[3, 1] = np.nan
    with pytest.raises(ValueError, match="desired control of row 3 is not finite"):
        ContinuousFilter()(state, desired)
    with pytest.raises(ValueError, match="shape"):
        ContinuousFilter()(state, np.zeros((4, 3)))
