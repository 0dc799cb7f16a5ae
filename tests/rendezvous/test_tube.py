"""Tubes: their certificates, and errors that never leave them whatever the disturbance."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from safe_inspect.rendezvous.control.bound import Bound
from safe_inspect.rendezvous.control.design import (
    DesignRequest,
    candidate_gains,
    clearance_margin,
    design_tube,
    lqr_gain,
    natural_gain,
)
from safe_inspect.rendezvous.control.tube import Axis, AxisBound, TrackingLimits, Tube, truth_tube
from safe_inspect.rendezvous.planner.query import Plan, PlanStatus

AXIS = Axis(9.583788668)
STEPS = 301
PROCESS = np.array([5e-6, 5e-5])


def falling(first: float, last: float) -> np.ndarray:
    return np.linspace(first, last, STEPS)


@pytest.fixture
def bound() -> AxisBound:
    """The bounds of an approach with errors of 0.7 degrees and 0.07 degrees per second."""
    return AxisBound(falling(0.072, 0.025), falling(7.2e-3, 2e-3), falling(4.8e-3, 1.4e-3), PROCESS)


@pytest.mark.parametrize("frequency", [0.25, np.linspace(0.25, 0.5, STEPS)])
def test_the_time_varying_tube_has_the_supports_of_its_sets(bound, frequency):
    tube = truth_tube(AXIS, natural_gain(AXIS, frequency, 0.9), bound)
    held = np.diag((bound.position[0], bound.velocity[0]))  # generators: the set of their sums times -1 to 1
    for k in range(60):
        gain = tube.gain_at(k)
        closed_loop = AXIS.closed_loop(gain)
        directions = np.array([[1.0, 0.0], [0.0, 1.0], gain])
        position, velocity, force = np.abs(held @ directions.T).sum(axis=0)
        assert tube.clearance[k] == pytest.approx(position, rel=1e-9)
        assert tube.position[k] == pytest.approx(position + bound.position[k], rel=1e-9)
        assert tube.velocity[k] == pytest.approx(velocity + bound.velocity[k], rel=1e-9)
        assert tube.force[k] == pytest.approx(force + bound.feedback(gain)[k], rel=1e-9)
        pushed = AXIS.B * (bound.feedback(gain)[k] + bound.force[k])
        held = np.vstack((held @ closed_loop.T, pushed, np.diag(PROCESS)))


@pytest.mark.parametrize("frequency", [0.22, np.linspace(0.22, 0.6, STEPS)])
def test_errors_stay_inside_the_time_varying_tube(bound, frequency):
    """Also long after its last step, with bounds as at the last."""
    tube = truth_tube(AXIS, natural_gain(AXIS, frequency, 0.9), bound)
    generator = np.random.default_rng(8)
    rows = 300
    error = generator.choice([-1.0, 1.0], (rows, 2)) * [bound.position[0], bound.velocity[0]]
    b_k = np.stack((bound.position, bound.velocity), axis=1)
    sign = generator.choice([-1.0, 1.0], (rows, 1))
    for step in range(2 * STEPS):
        k = min(step, STEPS - 1)
        assert np.abs(error[:, 0]).max() <= tube.clearance[k] * (1.0 + 1e-9)
        gain = tube.gain_at(step)
        closed_loop = AXIS.closed_loop(gain)
        flips = generator.uniform(size=(rows, 1)) < np.linspace(0.0, 0.3, rows)[:, None]
        sign = np.where(flips, -sign, sign)
        delta = -sign * np.sign(gain) * b_k[k]
        force = -delta @ gain + sign[:, 0] * bound.force[k]
        error = error @ closed_loop.T + force[:, None] * AXIS.B + sign * PROCESS


def test_the_tube_holds_for_a_plan_from_where_a_holding_chaser_was_seen():
    """Forces that are not commanded move the chaser until it is seen there, and until the plan starts."""
    force, rest, none = 5e-3, np.zeros((STEPS, 3)), np.zeros(STEPS)
    times = AXIS.step * np.arange(STEPS)
    plan = Plan(PlanStatus.SOLVED, 0.0, times[-1], times=times, position=rest, velocity=rest, force=rest)
    exact = Bound(times, none, none, none, 0.95, 100)
    tube = design_tube(DesignRequest(plan, exact, np.ones(STEPS), AXIS, TrackingLimits(), force)).tube
    generator = np.random.default_rng(4)
    rows, planning = 2000, 10
    kept = 1.0 - np.linspace(0.0, 0.3, rows)  # how often the force of a row keeps its sign
    x, signs = np.zeros((rows, 2)), generator.choice([-1.0, 1.0], rows)
    seen = x
    for step in range(400 + STEPS):
        if step == 400 - planning:
            seen = x
        elif step == 400:
            x = x - seen
            assert np.abs(x[:, 0]).max() > 0.3 * tube.clearance[0]
        if step >= 400:
            assert np.abs(x[:, 0]).max() <= tube.clearance[step - 400] * (1.0 + 1e-9)
        gain = tube.gain_at(step - 400) if step >= 400 else lqr_gain(AXIS)
        signs = np.where(generator.uniform(size=rows) < kept, signs, -signs)
        x = x @ AXIS.closed_loop(gain).T + force * signs[:, None] * AXIS.B


def test_more_error_makes_a_wider_tube(bound):
    gain = natural_gain(AXIS, 0.22, 0.9)
    more = AxisBound(2.0 * bound.position, bound.velocity, bound.force, bound.process)
    assert np.all(truth_tube(AXIS, gain, more).clearance >= truth_tube(AXIS, gain, bound).clearance)


def searched(bound: AxisBound, force: float, **given: Any) -> tuple[Tube, np.ndarray]:
    """Return the tube of a plan at rest for actuators with a largest force, and the force that remains."""
    still, times = np.zeros((STEPS, 3)), 0.2 * np.arange(STEPS)
    plan = Plan(PlanStatus.SOLVED, 0.0, times[-1], times=times, position=still, velocity=still, force=still)
    own = Bound(times, bound.position, bound.velocity, bound.force, 0.95, 100)
    design = design_tube(DesignRequest(plan, own, np.ones(STEPS), AXIS, TrackingLimits(force=force), 0.0), **given)
    return design.tube, design.force_reserve


def test_the_gain_search_keeps_a_reserve_and_says_when_there_is_none(bound):
    tube, reserve = searched(bound, 0.205)
    assert reserve.min() >= 0.0
    assert clearance_margin(tube).max() < 0.25
    np.testing.assert_allclose(reserve, 0.205 - bound.force - tube.force, rtol=1e-9)
    _, more = searched(bound, 0.205, reserve=0.05)
    assert more.min() >= 0.05
    none, lacking = searched(bound, 0.025)
    assert lacking.min() < 0.0
    assert none.force.max() < tube.force.max()


def test_stiffening_gains_narrow_the_end_within_the_same_force(bound):
    constant, _ = searched(bound, 0.205, gains=tuple(candidate_gains(AXIS)))
    stiffening, reserve = searched(bound, 0.205)
    assert stiffening.gain.shape == (STEPS, 2)
    assert reserve.min() >= 0.0
    assert stiffening.clearance[-1] < 0.9 * constant.clearance[-1]
    assert stiffening.clearance.max() < 1.05 * constant.clearance.max()


def test_the_regulator_is_stable_and_solves_the_riccati_equation():
    gain = lqr_gain(AXIS)
    closed_loop = AXIS.closed_loop(gain)
    assert np.abs(np.linalg.eigvals(closed_loop)).max() < 1.0
    q, r, b = np.diag((400.0, 1.0 / 0.03**2)), 100.0, AXIS.B[:, None]
    cost = np.zeros((2, 2))
    for _ in range(3000):
        step = np.linalg.solve(r + b.T @ cost @ b, b.T @ cost @ AXIS.A)
        cost = q + AXIS.A.T @ cost @ (AXIS.A - b @ step)
    np.testing.assert_allclose(gain, -step[0], rtol=1e-9)
