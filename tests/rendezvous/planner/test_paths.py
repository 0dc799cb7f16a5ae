"""Plans of any planner: a path that is evaluated at a time, its bounds, its certificate, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest

from safe_inspect.rendezvous.planner.approach import SplineSCPPlanner
from safe_inspect.rendezvous.planner.checks import certify, plan_mistake
from safe_inspect.rendezvous.planner.paths import SampledPath
from safe_inspect.rendezvous.planner.problem import sampled_plan
from safe_inspect.rendezvous.planner.query import Plan, PlanStatus

pytest.importorskip("piqp")


def _resampled(plan, step=0.2):
    """Return the path through samples of a plan."""
    times = np.linspace(0.0, plan.duration, round(plan.duration / step) + 1)
    position, velocity, _ = plan.path.at(times)
    return SampledPath(times, position, velocity)


@pytest.fixture(scope="module")
def solved(query):
    asked = query(0, waits=(0.0, 5.0))
    return asked, SplineSCPPlanner()(asked)


def test_a_sampled_path_goes_through_its_samples_and_its_derivatives_are_those_of_its_positions():
    generator = np.random.default_rng(1)
    times = np.array([0.0, 0.5, 2.0, 2.1, 7.0])
    path = SampledPath(times, generator.normal(size=(5, 3)), generator.normal(size=(5, 3)))
    p, v, _ = path.at(times)
    np.testing.assert_allclose(p, path.position, atol=1e-14)
    np.testing.assert_allclose(v, path.velocity, atol=1e-13)
    assert path.duration == 7.0
    inside, h = np.linspace(0.1, 6.9, 57), 1e-6
    before, here, after = (path.at(inside + shift) for shift in (-h, 0.0, h))
    np.testing.assert_allclose((after[0] - before[0]) / (2.0 * h), here[1], atol=1e-6)
    np.testing.assert_allclose((after[1] - before[1]) / (2.0 * h), here[2], rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("seed", range(20))
def test_the_bounds_of_a_sampled_path_hold_between_its_samples(seed):
    generator = np.random.default_rng(seed)
    times = np.concatenate([[0.0], np.cumsum(generator.uniform(0.05, 3.0, 6))])
    path = SampledPath(times, generator.normal(size=(7, 3)), generator.normal(size=(7, 3)))
    p, v, _ = path.at(np.linspace(0.0, path.duration, 5001))
    assert np.linalg.norm(v, axis=1).max() <= path.largest_speed
    assert np.linalg.norm(p, axis=1).max() <= path.largest_distance


@pytest.mark.parametrize(
    ("times", "rows", "message"),
    [
        ([0.0], 1, "start at 0 s and increase"),
        ([0.1, 1.0], 2, "start at 0 s and increase"),
        ([0.0, 1.0, 1.0], 3, "start at 0 s and increase"),
        ([0.0, 1.0], 3, "shape"),
    ],
)
def test_samples_that_are_no_path_are_refused(times, rows, message):
    with pytest.raises(ValueError, match=message):
        SampledPath(np.array(times), np.zeros((rows, 3)), np.zeros((rows, 3)))


@pytest.mark.parametrize("seed", range(8))
def test_samples_of_a_spline_are_certified_where_the_spline_is(query, seed):
    asked = query(seed)
    plan = SplineSCPPlanner()(asked)
    path = _resampled(plan)
    assert certify(asked, path).certified
    assert certify(asked, path).clearance == pytest.approx(plan.report.clearance, abs=3e-3)
    closer = replace(asked, margin=lambda times: np.full(np.shape(times), 0.3))
    assert not certify(closer, path).certified
    assert not certify(closer, plan.path).certified


def test_a_plan_of_samples_may_be_flown_like_the_spline_that_they_are_of(solved):
    asked, plan = solved
    again = sampled_plan(asked, _resampled(plan), plan.t_start - asked.t0)
    assert plan_mistake(asked, plan) == plan_mistake(asked, again) == ""
    assert again.solved
    for name in ("times", "position", "velocity", "position_target", "velocity_target", "orientation"):
        np.testing.assert_allclose(getattr(again, name), getattr(plan, name), atol=1e-9)
    np.testing.assert_allclose(again.force, plan.force, atol=1e-3)


def _moved(path, **changes):
    return SampledPath(**{"times": path.times, "position": path.position, "velocity": path.velocity} | changes)


class _Boastful(SampledPath):
    largest_speed = 1e-3


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda asked, plan, path: replace(plan, path=None), "the plan has no path; return `sampled_plan"),
        (
            lambda asked, plan, path: sampled_plan(asked, _moved(path, times=1.001 * path.times)),
            r"duration of 60\.06 s is not a multiple of the control step, 0\.2 s",
        ),
        (lambda asked, plan, path: sampled_plan(asked, path, 3.0), "starts after 3 s, which is none of the waits"),
        (lambda asked, plan, path: replace(plan, times=plan.times + 1e-3), r"samples are not 0\.2 s apart"),
        (
            lambda asked, plan, path: replace(plan, position=plan.position + 1e-3),
            "samples of the position are not those",
        ),
        (lambda asked, plan, path: replace(plan, velocity=plan.velocity[1:]), "samples of the velocity are not those"),
        (lambda asked, plan, path: replace(plan, force=np.full_like(plan.force, np.nan)), "samples are not finite"),
        (
            lambda asked, plan, path: sampled_plan(asked, _Boastful(path.times, path.position, path.velocity)),
            r"states bounds of 0\.001 m/s",
        ),
        (
            lambda asked, plan, path: sampled_plan(
                asked, _moved(path, position=path.position + np.array([0.01, 0, 0]))
            ),
            r"starts 0\.01 m from the chaser",
        ),
        (
            lambda asked, plan, path: sampled_plan(
                replace(asked, angular_velocity=1.01 * asked.angular_velocity), path
            ),
            "ends 0.* m from the mating point",
        ),
    ],
)
def test_what_was_not_asked_for_is_refused_with_its_reason(query, change, message):
    asked = query(0, waits=(0.0, 5.0))
    plan = SplineSCPPlanner()(replace(asked, waits=(0.0,)))
    assert plan.solved
    with pytest.raises(AssertionError, match=message):
        assert plan_mistake(asked, change(asked, plan, _resampled(plan))) == ""


def test_a_plan_beyond_the_limits_is_refused(solved):
    asked, plan = solved
    for name, value, message in (
        ("planned_force", 0.5 * np.abs(plan.force).max(), "its force is .* N along an axis; the limit is"),
        ("speed", 0.5 * np.abs(plan.velocity).max(), "its speed is .* m/s along an axis; the limit is"),
        ("keep_in", np.array([0.8, 1.4, 0.8]), r"it leaves the keep-in box of half sizes \(0\.80, 1\.40, 0\.80\) m"),
    ):
        limited = replace(asked, limits=replace(asked.limits, **{name: value}))
        with pytest.raises(AssertionError, match=message):
            assert plan_mistake(limited, plan) == ""


def test_no_plan_has_no_path(query):
    nothing = Plan(PlanStatus.NOT_CONVERGED, 0.0, 60.0)
    assert nothing.path is None
