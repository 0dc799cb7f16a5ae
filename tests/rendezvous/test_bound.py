"""Bounds of the reference's error: their limits, their growth and their coverage."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from safe_inspect.dynamics.quaternion import to_matrix
from safe_inspect.random.streams import Streams
from safe_inspect.rendezvous.control.bound import BoundQuery, ErrorSamples, conformal_bound, sample_errors
from safe_inspect.rendezvous.estimate import EstimateErrors, JointErrors

from .conftest import unobstructed_plan

INERTIA = np.array([0.1314, 0.9661, 1.0])
ERRORS = EstimateErrors(np.deg2rad(0.7), np.deg2rad(0.07), 0.005, 0.02, 0.002, 0.0005)


def streams(count: int, seed: int = 0) -> Streams:
    return Streams(seed, np.arange(count), np.zeros(count, dtype=np.int64))


@pytest.fixture
def bound_query(plan) -> BoundQuery:
    return BoundQuery(plan, INERTIA, ERRORS, 2.0, 0.3)


@pytest.fixture(scope="module")
def many(query) -> ErrorSamples:
    """A thousand trials, of a plan with one sample a second."""
    plan = unobstructed_plan(dataclasses.replace(query, step=1.0))
    return sample_errors(BoundQuery(plan, INERTIA, ERRORS, 5.0), streams(1000, 7))


@pytest.mark.parametrize("updates", [(None,), (1.0,), (5.0, 0.9)])
def test_without_errors_the_bound_is_zero(plan, updates):
    samples = sample_errors(BoundQuery(plan, INERTIA, EstimateErrors(0.0, 0.0), *updates), streams(20))
    bound = conformal_bound(samples, 0.2, 10)
    for values in (bound.position, bound.velocity, bound.force):
        assert not values.any()


@pytest.mark.parametrize("updates", [(None,), (2.0, 0.5)])
def test_small_errors_act_linearly(plan, updates):
    def bound(factor: float):
        errors = EstimateErrors(*(1e-5 * factor * np.array(dataclasses.astuple(ERRORS))))
        return conformal_bound(sample_errors(BoundQuery(plan, INERTIA, errors, *updates), streams(60)), 0.1, 20)

    one, two = bound(1.0), bound(2.0)
    for a, b in ((one.position, two.position), (one.velocity, two.velocity), (one.force, two.force)):
        np.testing.assert_allclose(b, 2.0 * a, rtol=1e-3)


def test_rarer_updates_make_larger_bounds(plan):
    """Compared by the root mean square error late in the approach: bounds by themselves scatter."""
    late = []
    for period in (1.0, 5.0, 20.0, None):
        samples = sample_errors(BoundQuery(plan, INERTIA, EstimateErrors(0.0, 1e-3), period), streams(100))
        late.append(np.sqrt((samples.position[:, 150:] ** 2).mean()))
    assert np.all(np.diff(late) > 0.0)


def test_an_error_of_attitude_moves_the_reference_by_at_most_its_angle_times_the_distance(plan):
    samples = sample_errors(BoundQuery(plan, INERTIA, EstimateErrors(0.01, 0.0), 0.2), streams(200))
    radius = np.linalg.norm(plan.position_target, axis=1)
    drawn = 0.01 * streams(200).normal("bound.attitude", 3 * len(plan.times)).reshape(200, -1, 3)
    ratio = np.linalg.norm(samples.position, axis=2) / (np.linalg.norm(drawn, axis=2) * radius)
    assert ratio.max() <= 1.0 + 1e-9
    assert ratio.max() > 0.95


@pytest.mark.parametrize("period", [None, 2.0])
def test_the_point_that_is_taken_for_the_centre_of_mass_rotates_about_the_true_one(plan, period):
    spread = np.diag([0.02, 0.01, 0.03]) ** 2
    errors = JointErrors(0.0, 0.0, offset=spread)
    samples = sample_errors(BoundQuery(plan, INERTIA, errors, period), streams(50))
    offset = streams(50).normal("bound.offset", 3) * np.sqrt(np.diag(spread))
    axes, step = to_matrix(plan.orientation), BoundQuery(plan, INERTIA, errors).step
    since = np.arange(len(axes)) // (len(axes) if period is None else round(period / step))
    first = since * (0 if period is None else round(period / step))
    expected = np.einsum("kij,nj->nki", axes - axes[first], offset)
    np.testing.assert_allclose(samples.position, expected, atol=1e-6)
    velocity = np.einsum("kij,nkj->nki", axes, np.cross(plan.angular_velocity[None], offset[:, None]))
    np.testing.assert_allclose(samples.velocity, velocity, atol=1e-6)


def test_errors_of_centre_and_navigation_shift_the_reference(plan):
    centre = sample_errors(BoundQuery(plan, INERTIA, EstimateErrors(0.0, 0.0, centre=0.01), None), streams(50))
    drawn = 0.01 * streams(50).normal("bound.centre", 3)
    np.testing.assert_allclose(centre.position, np.broadcast_to(drawn[:, None], centre.position.shape), atol=1e-12)
    assert not centre.force.any()
    own = sample_errors(
        BoundQuery(plan, INERTIA, EstimateErrors(0.0, 0.0, position=0.01, velocity=0.02), None), streams(50)
    )
    drawn = 0.02 * streams(50).normal("bound.velocity", 3)
    np.testing.assert_allclose(own.velocity, np.broadcast_to(-drawn[:, None], own.velocity.shape), atol=1e-12)


def test_successive_errors_are_correlated(plan):
    query = BoundQuery(plan, INERTIA, EstimateErrors(0.0, 0.0, centre=1.0), 1.0, 0.8)
    errors = sample_errors(query, streams(400)).position[:, ::5]
    assert errors.std() == pytest.approx(1.0, abs=0.03)
    assert (errors[:, 1:] * errors[:, :-1]).mean() == pytest.approx(0.8, abs=0.05)


def test_large_errors_of_inertia_stay_physical(plan):
    errors = EstimateErrors(0.0, 0.0, inertia=3.0)
    for inertia in (INERTIA, np.array([1.0, 1.0, 1.0]), np.array([0.5, 0.5, 1.0]), np.array([0.2, 1.0, 1.0])):
        samples = sample_errors(BoundQuery(plan, inertia, errors, None), streams(100))
        assert np.isfinite(samples.position).all()


def test_the_conformal_bound_covers_what_it_promises(many):
    """New trials by repeated splitting; the mean coverage of one split scatters by 2.2 %, of fifteen by less."""
    generator = np.random.default_rng(0)
    coverage = []
    for _ in range(15):
        order = generator.permutation(len(many))
        bound = conformal_bound(many[order[:299]], 0.05)
        coverage.append(bound.covers(many[order[299:]]).mean())
    assert np.mean(coverage) == pytest.approx(0.95, abs=0.02)
    assert bound.level == pytest.approx(0.95)


def test_a_smaller_epsilon_makes_a_larger_bound(many):
    widths = [conformal_bound(many, epsilon).position.max() for epsilon in (0.2, 0.1, 0.05, 0.01)]
    assert np.all(np.diff(widths) > 0.0)


def test_the_fewest_trials_for_an_epsilon_state_it_exactly(many):
    assert conformal_bound(many[:199], 0.01).level == pytest.approx(0.99)


def test_a_trial_does_not_depend_on_the_others(bound_query):
    alone = sample_errors(bound_query, streams(8)[5:6])
    together = sample_errors(bound_query, streams(8))[5:6]
    np.testing.assert_array_equal(alone.position, together.position)
    np.testing.assert_array_equal(alone.velocity, together.velocity)


def test_the_query_is_left_as_it_is(bound_query):
    before = {name: np.array(value) for name, value in vars(bound_query.plan).items() if isinstance(value, np.ndarray)}
    sample_errors(bound_query, streams(3))
    for name, value in before.items():
        np.testing.assert_array_equal(getattr(bound_query.plan, name), value)
