"""From plan and bound to a tube: accepted, flown, or refused with remedies."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from safe_inspect.random.streams import Streams
from safe_inspect.rendezvous.control.bound import (
    Bound,
    BoundQuery,
    ErrorSamples,
    conformal_bound,
    sample_errors,
)
from safe_inspect.rendezvous.control.design import DesignRequest, TubeDesign, design_tube
from safe_inspect.rendezvous.control.tracker import LinearFeedback
from safe_inspect.rendezvous.control.tube import Axis, TrackedReference, TrackingLimits
from safe_inspect.rendezvous.estimate import EstimateErrors

AXIS = Axis(9.583788668)
LIMITS = TrackingLimits(keep_in=np.array([2.0, 3.0, 2.0]))
RESERVE = 0.03
ERRORS = EstimateErrors(np.deg2rad(0.7), np.deg2rad(0.07))


@pytest.fixture(scope="module")
def samples(plan, query) -> ErrorSamples:
    streams = Streams(3, np.arange(320), np.zeros(320, dtype=np.int64))
    return sample_errors(BoundQuery(plan, query.inertia, ERRORS), streams)


@pytest.fixture(scope="module")
def bound(samples) -> Bound:
    return conformal_bound(samples[:300])


def designed(plan, bound, limits: TrackingLimits = LIMITS) -> TubeDesign:
    far = np.full(len(plan.times), np.inf)
    return design_tube(DesignRequest(plan, bound, far, AXIS, limits, force_error=3e-3), reserve=RESERVE)


@pytest.fixture(scope="module")
def design(plan, bound) -> TubeDesign:
    return designed(plan, bound)


def test_an_accepted_design_keeps_its_reserves(plan, bound, design):
    assert design.accepted
    assert design.refusal == ""
    force = np.abs(AXIS.feed_forward(plan.velocity)).max(axis=1) + bound.force + design.tube.force
    np.testing.assert_allclose(force + design.force_reserve, LIMITS.force, rtol=1e-12)
    assert design.force_reserve.min() >= RESERVE
    assert design.state_reserve.min() >= 0.0
    np.testing.assert_allclose(design.margin, np.sqrt(3.0) * design.tube.clearance + 0.02)


def test_the_margin_between_two_steps_is_the_larger_one(design):
    k = int(np.abs(np.diff(design.margin)).argmax())
    low, high = sorted(design.margin[k : k + 2])
    np.testing.assert_allclose(design.margin_at(0.2 * np.array([k + 0.3, k + 0.9])), high)
    assert low < high
    np.testing.assert_allclose(design.margin_at(0.2 * np.arange(len(design.margin))), design.margin)
    np.testing.assert_allclose(design.margin_at(np.array([-1.0, 1e4])), design.margin[[0, -1]])


def test_flights_with_drawn_errors_stay_in_the_tube(plan, bound, samples, design):
    """True reference as planned; what the tracker is given is wrong by a trial's error, and so is the force noise."""
    generator = np.random.default_rng(0)
    flown = [i for i in range(300, 320) if bound.covers(samples[i : i + 1])[0]][:2]
    assert flown
    for i in flown:
        tracker = LinearFeedback(AXIS, design.tube, LIMITS.force)
        state = np.stack((plan.position[0], plan.velocity[0]), axis=1)
        for k in range(len(plan.times)):
            known = TrackedReference(plan.position + samples.position[i, k], plan.velocity + samples.velocity[i, k])
            output = tracker.step(state.T.ravel(), known, k)
            assert not output.outside.any()
            error = state[:, 0] - plan.position[k]
            assert np.abs(error).max() <= design.tube.clearance[k]
            noise = generator.uniform(-3e-3, 3e-3, 3)
            state = state @ AXIS.A.T + (output.force + noise)[:, None] * AXIS.B
        assert np.linalg.norm(state[:, 0] - plan.position[-1]) < design.margin[-1]


def test_too_large_errors_are_refused_with_remedies(plan, bound):
    worse = dataclasses.replace(bound, position=10.0 * bound.position, velocity=10.0 * bound.velocity)
    design = designed(plan, worse)
    assert not design.accepted
    for remedy in ("mission.update_ticks", "tracker.config.least_frequency", "chaser.actuator.force_noise"):
        assert remedy in design.refusal
    assert design.force_reserve.min() < 0.0


def test_a_tube_outside_of_the_box_is_refused(plan, bound):
    limits = TrackingLimits(keep_in=np.array([*np.abs(plan.position).max(axis=0)[:2], 3.0]))
    assert "smaller by" in designed(plan, bound, limits).refusal


def test_a_tube_above_the_speed_limit_is_refused(plan, bound):
    limits = TrackingLimits(speed=float(np.abs(plan.velocity).max()), keep_in=np.full(3, np.inf))
    assert "lower speed" in designed(plan, bound, limits).refusal
