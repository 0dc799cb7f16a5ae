"""Tube model predictive control in closed loop, its tightened limits and what it does without a solution."""

from __future__ import annotations

import numpy as np
import pytest

from safe_inspect.rendezvous.control.gains import natural_gain
from safe_inspect.rendezvous.control.mpc import TubeMPC
from safe_inspect.rendezvous.control.tightening import TightenedLimits, TrackedReference, TrackingLimits
from safe_inspect.rendezvous.control.tracker import AxisStatus, LQRTrackerRun
from safe_inspect.rendezvous.control.tube import Axis, AxisBound, Tube, no_tube, truth_tube

AXIS = Axis(9.583788668)
STEPS = 121
LIMITS = TrackingLimits()


@pytest.fixture
def bound() -> AxisBound:
    ones = np.ones(STEPS)
    return AxisBound(0.02 * ones, 2e-3 * ones, 2e-3 * ones, np.array([5e-6, 5e-5]))


@pytest.fixture
def tube(bound) -> Tube:
    return truth_tube(AXIS, natural_gain(AXIS, 0.3, 0.9), bound)


@pytest.fixture
def reference() -> TrackedReference:
    """A straight line from rest to rest in 24 s (minimum jerk)."""
    s = np.linspace(0.0, 1.0, STEPS)[:, None]
    way = np.array([0.1, 0.8, -0.1])
    position = np.array([0.0, -1.5, 0.0]) + (10 * s**3 - 15 * s**4 + 6 * s**5) * way
    return TrackedReference(position, (30 * s**2 - 60 * s**3 + 30 * s**4) / 24.0 * way)


def fly(tracker, reference, bound, seed=0, start=None):
    """Return (states (K, 3, 2), outputs) about a true reference that is known up to the bound."""
    generator = np.random.default_rng(seed)
    state = np.stack((reference.position[0], reference.velocity[0]), axis=1) if start is None else start
    states, outputs = [], []
    known = reference
    for k in range(STEPS):
        if k % 5 == 0:
            error = generator.choice([-1.0, 1.0], (2, 3)) * [[bound.position[k]], [bound.velocity[k]]]
            known = TrackedReference(reference.position + error[0], reference.velocity + error[1])
        outputs.append(tracker.step(state.T.ravel(), known, k))
        states.append(state)
        state = state @ AXIS.A.T + outputs[-1].force[:, None] * AXIS.B
    return np.array(states), outputs


def test_tightened_limits_lie_inside_the_original_ones(tube, reference):
    tightened = TightenedLimits(AXIS, reference, tube, LIMITS)
    centre = np.stack((reference.position, reference.velocity, tightened.feed_forward), axis=2)
    half = np.stack((LIMITS.keep_in, np.full(3, LIMITS.speed), np.full(3, LIMITS.force)), axis=1)
    widths = np.stack((tube.position, tube.velocity, tube.force), axis=1)[:, None, :]
    assert np.all(tightened.upper + centre + widths <= half + 1e-12)
    assert np.all(tightened.lower + centre - widths >= -half - 1e-12)
    assert np.all(np.diff(tightened.upper, axis=0) >= 0.0)  # they only grow
    assert np.all(np.diff(tightened.lower, axis=0) <= 0.0)
    assert np.all(tightened.reserve() > 0.0)


def test_limits_without_keep_in_do_not_bind_the_position(tube, reference):
    tightened = TightenedLimits(AXIS, reference, tube, TrackingLimits(keep_in=None))
    assert np.all(tightened.upper[:, :, 0] > 1e29)
    assert TubeMPC(AXIS, tube, TrackingLimits(keep_in=None)).step(np.zeros(6), reference, 0).feasible


def test_the_true_error_stays_inside_the_tube(tube, reference, bound):
    for seed in range(3):
        states, outputs = fly(TubeMPC(AXIS, tube, LIMITS), reference, bound, seed)
        for k, output in enumerate(outputs):
            assert max(output.status) is AxisStatus.SOLVED
            error = states[k, :, 0] - reference.position[k] - output.nominal[:, 0]
            assert np.abs(error).max() <= tube.clearance[k] + 1e-12
            assert np.abs(output.force).max() <= LIMITS.force
        assert np.abs(states[:, :, 0] <= np.array(LIMITS.keep_in)).all()


def test_without_error_the_reference_is_met(tube, reference, bound):
    none = AxisBound(*np.zeros((3, STEPS)), bound.process)
    for tracker in (TubeMPC(AXIS, tube, LIMITS), LQRTrackerRun(AXIS)):
        states, _ = fly(tracker, reference, none)
        assert np.abs(states[:, :, 0] - reference.position).max() < 2e-4


def test_a_start_off_the_reference_is_corrected(tube, reference, bound):
    none = AxisBound(*np.zeros((3, STEPS)), bound.process)
    start = np.stack((reference.position[0] + [0.1, -0.1, 0.05], np.zeros(3)), axis=1)
    for tracker in (TubeMPC(AXIS, tube, LIMITS), LQRTrackerRun(AXIS)):
        states, outputs = fly(tracker, reference, none, start=start)
        assert np.abs(states[-1, :, 0] - reference.position[-1]).max() < 2e-3
        assert all(np.abs(output.force).max() <= LIMITS.force for output in outputs)


def test_a_fast_start_takes_a_longer_horizon_and_a_hopeless_one_the_regulator(tube, reference):
    position = reference.position[0]
    fast = TubeMPC(AXIS, tube, LIMITS).step(np.r_[position, 0.1, 0.0, 0.0], reference, 0)
    assert fast.status == (AxisStatus.LONGER_HORIZON, AxisStatus.SOLVED, AxisStatus.SOLVED)
    hopeless = TubeMPC(AXIS, tube, LIMITS).step(np.r_[position, 3.0, 0.0, 0.0], reference, 0)
    assert hopeless.status[0] is AxisStatus.REGULATOR
    assert not hopeless.feasible
    assert hopeless.force[0] == -LIMITS.force


def test_limits_that_close_after_the_first_step_fly_the_rest_of_the_last_solution(tube, reference):
    mpc = TubeMPC(AXIS, tube, LIMITS)
    estimate = np.r_[reference.position[0] + [0.05, 0.0, 0.0], np.zeros(3)]
    first = mpc.step(estimate, reference, 0)
    outside = TrackedReference(reference.position + np.array([2.0, 0.0, 0.0]), reference.velocity)
    second = mpc.step(estimate, outside, 1)
    assert first.status[0] is AxisStatus.SOLVED
    assert second.status == (AxisStatus.SHIFTED, AxisStatus.SOLVED, AxisStatus.SOLVED)
    assert second.feasible
    later = [mpc.step(estimate, outside, k).status[0] for k in range(2, 25)]
    worst = later.index(AxisStatus.REGULATOR)
    assert set(later[:worst]) == {AxisStatus.SHIFTED}
    assert set(later[worst + 1 :]) == {AxisStatus.SOLVED}  # restarted, from the error about the new reference


def test_a_reference_that_jumps_within_its_bound_leaves_the_programme_feasible(tube, reference):
    jump = 2.0 * float((tube.position - tube.clearance).max())
    assert jump > 0.0
    mpc = TubeMPC(AXIS, tube, LIMITS)
    # The limits just hold the nominal error of the first step; the next reference takes some of it away.
    room = mpc_room(tube, reference)
    start = np.r_[reference.position[0] + [0.9 * room, 0.0, 0.0], np.zeros(3)]
    first = mpc.step(start, reference, 0)
    nearer = TrackedReference(reference.position + np.array([0.9 * jump, 0.0, 0.0]), reference.velocity)
    outputs = [mpc.step(start, nearer, k) for k in range(1, 60)]
    assert first.status[0] is AxisStatus.SOLVED
    assert {output.status[0] for output in outputs} == {AxisStatus.SOLVED}


def mpc_room(tube, reference):
    """Return how far the position may be above the reference's along the first axis [m]."""
    return float(TightenedLimits(AXIS, reference, tube, LIMITS).upper[0, 0, 0])


def test_a_longer_horizon_is_kept(tube, reference):
    mpc = TubeMPC(AXIS, tube, LIMITS)
    estimate = np.r_[reference.position[0], 0.13, 0.0, 0.0]
    assert mpc.step(estimate, reference, 0).status[0] is AxisStatus.LONGER_HORIZON
    later = {mpc.step(estimate, reference, k).status[0] for k in range(1, 30)}
    assert later == {AxisStatus.LONGER_HORIZON}


def test_a_tube_of_width_zero_changes_nothing(reference):
    tightened = TightenedLimits(AXIS, reference, no_tube(1), LIMITS)
    np.testing.assert_allclose(tightened.upper[-1, :, 2] + tightened.feed_forward[-1], LIMITS.force)


def test_two_trackers_of_one_design_give_the_same_bytes(tube, reference, bound):
    flights = [fly(TubeMPC(AXIS, tube, LIMITS), reference, bound)[0] for _ in range(2)]
    assert flights[0].tobytes() == flights[1].tobytes()
