"""Feedback in a tube, in closed loop, and what a reference and its tube leave of the limits."""

from __future__ import annotations

import numpy as np
import pytest

from safe_inspect.rendezvous.control.design import natural_gain
from safe_inspect.rendezvous.control.tracker import LinearFeedback
from safe_inspect.rendezvous.control.tube import (
    Axis,
    AxisBound,
    TrackedReference,
    TrackingLimits,
    Tube,
    no_tube,
    remaining,
    truth_tube,
)

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


def test_what_remains_is_the_least_of_all_steps_from_the_given_one_on(tube, reference):
    force = reference.feed_forward(AXIS)
    for k in (0, 50, STEPS - 1):
        expected = np.full((3, 3), np.inf)
        for j in range(k, STEPS):
            for axis in range(3):
                used = (
                    abs(reference.position[j, axis]) + tube.position[j],
                    abs(reference.velocity[j, axis]) + tube.velocity[j],
                    abs(force[j, axis]) + tube.force[j],
                )
                limits = (LIMITS.keep_in[axis], LIMITS.speed, LIMITS.force)
                expected[axis] = np.minimum(expected[axis], np.subtract(limits, used))
        np.testing.assert_allclose(remaining(AXIS, reference, tube, LIMITS, k), expected, rtol=0, atol=1e-12)


def test_a_tube_without_width_and_limits_without_a_box(reference):
    found = remaining(AXIS, reference, no_tube(1), TrackingLimits(keep_in=np.full(3, np.inf)))
    assert np.isinf(found[:, 0]).all()
    np.testing.assert_allclose(found[:, 1], LIMITS.speed - np.abs(reference.velocity).max(axis=0))
    np.testing.assert_allclose(found[:, 2], LIMITS.force - np.abs(reference.feed_forward(AXIS)).max(axis=0))


def test_a_reference_of_one_sample_needs_no_force():
    rest = TrackedReference(np.zeros((1, 3)), np.ones((1, 3)))
    np.testing.assert_array_equal(rest.feed_forward(AXIS), np.zeros((1, 3)))


def test_the_force_is_that_of_the_reference_and_the_feedback_of_the_step_s_gain(tube, reference):
    gains = np.linspace(1.0, 2.0, STEPS)[:, None] * tube.gain
    varying = Tube(gains, tube.position, tube.velocity, tube.clearance, tube.force)
    error = np.array([[0.01, 0.002], [-0.02, 0.001], [0.005, -0.003]])
    for k in (0, 70):
        state = np.stack((reference.position[k], reference.velocity[k]), axis=1) + error
        output = LinearFeedback(AXIS, varying, 0.3).step(state.T.ravel(), reference, k)
        demand = reference.feed_forward(AXIS)[k] + error @ gains[k]
        np.testing.assert_allclose(output.force, demand, atol=1e-15)
        clipped = LinearFeedback(AXIS, varying, 0.01).step(state.T.ravel(), reference, k).force
        np.testing.assert_allclose(clipped, np.clip(demand, -0.01, 0.01), atol=1e-15)


def test_an_error_counts_as_outside_as_far_as_it_leaves_the_tube_at_its_step(tube, reference):
    run = LinearFeedback(AXIS, tube)
    for k in (0, 40, STEPS - 1):
        width = tube.position[k]
        off = np.array([0.9 * width, -width - 0.03, width + 0.01])
        state = np.r_[reference.position[k] + off, reference.velocity[k]]
        np.testing.assert_allclose(run.step(state, reference, k).outside, [0.0, -0.03, 0.01], atol=1e-12)
        np.testing.assert_allclose(LinearFeedback.of_lqr(AXIS).step(state, reference, k).outside, off, atol=1e-12)


def test_the_true_error_stays_inside_the_tube(tube, reference, bound):
    for seed in range(3):
        states, outputs = fly(LinearFeedback(AXIS, tube), reference, bound, seed)
        for k, output in enumerate(outputs):
            assert not output.outside.any()
            assert np.abs(states[k, :, 0] - reference.position[k]).max() <= tube.clearance[k] + 1e-12
            assert np.abs(output.force).max() < LIMITS.force
        assert np.abs(states[:, :, 0] <= np.array(LIMITS.keep_in)).all()


def test_without_error_the_reference_is_met(tube, reference, bound):
    none = AxisBound(*np.zeros((3, STEPS)), bound.process)
    for tracker in (LinearFeedback(AXIS, tube), LinearFeedback.of_lqr(AXIS)):
        states, _ = fly(tracker, reference, none)
        assert np.abs(states[:, :, 0] - reference.position).max() < 2e-4


def test_a_start_off_the_reference_is_corrected(tube, reference, bound):
    none = AxisBound(*np.zeros((3, STEPS)), bound.process)
    start = np.stack((reference.position[0] + [0.1, -0.1, 0.05], np.zeros(3)), axis=1)
    for tracker in (LinearFeedback(AXIS, tube), LinearFeedback.of_lqr(AXIS)):
        states, outputs = fly(tracker, reference, none, start=start)
        assert np.abs(states[-1, :, 0] - reference.position[-1]).max() < 2e-3
        assert all(np.abs(output.force).max() <= LIMITS.force for output in outputs)
