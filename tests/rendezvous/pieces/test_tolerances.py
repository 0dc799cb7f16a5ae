"""Plans, queries and bounds on both sides of what is refused."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from safe_inspect.rendezvous.control.bound import (
    Bound,
    BoundQuery,
    ConformalBound,
    ErrorSamples,
    conformal_bound,
)
from safe_inspect.rendezvous.control.design import design_tube
from safe_inspect.rendezvous.estimate import EstimateErrors
from safe_inspect.rendezvous.planner.checks import plan_mistake
from safe_inspect.rendezvous.planner.paths import SampledPath, spline_basis
from safe_inspect.rendezvous.planner.query import Plan, PlanQuery

from .control import AXIS, plan, query, request

#: Limits within which the plan keeps far more than is asked for.
_FREE = replace(query().limits, keep_in=np.full(3, np.inf), speed=9.0, planned_force=9.0)


def _asked(**changes: Any) -> PlanQuery:
    return query(limits=_FREE, durations=(30.0,), **changes)


def _limited(**limits: Any) -> PlanQuery:
    return query(limits=replace(_FREE, **limits))


_X = np.eye(3)[0]
_FORCE, _SPEED = float(np.abs(plan().force).max()), float(np.abs(plan().velocity).max())
_REACH = np.abs(plan().position).max(axis=0)


@pytest.mark.parametrize(
    ("change", "allowed", "refused", "message"),
    [
        (lambda by: (_asked(state=query().state + by * np.eye(6)[0]), plan()), 9e-4, 1.1e-3, "it starts 0.0011 m from"),
        (lambda by: (_asked(state=query().state + by * np.eye(6)[4]), plan()), 9e-4, 1.1e-3,
         "it starts 0.0011 m/s off the chaser's velocity"),
        (lambda by: (_asked(mating_point=query().mating_point + by * np.eye(3)[1]), plan()), 9e-4, 1.1e-3,
         "it ends 0.0011 m from the mating point"),
        (lambda by: (_asked(length=3.0, state=query().state + by * np.eye(6)[0]), plan()), 2.9e-3, 3.1e-3, "it starts"),
        (lambda by: (_asked(), replace(plan(), velocity_target=plan().velocity_target + by * _X)), 9e-4, 1.1e-3,
         "it ends 0.0011 m/s off the mating point's velocity"),
        (lambda by: (_asked(), replace(plan(), times=plan().times + by)), 8e-7, 1.3e-6, "samples are not 0.2 s apart"),
        (lambda by: (_asked(), replace(plan(), position=plan().position + by)), 9e-7, 1.2e-6, "of the position"),
        (lambda by: (_asked(length=2.0), replace(plan(), velocity=plan().velocity - by)), 1.9e-6, 2.2e-6,
         "samples of the velocity"),
        (lambda by: (_asked(waits=(9.0, by)), plan()), 9e-7, 1.2e-6, "it starts after 0 s, which is none of the waits"),
        (lambda by: (_limited(planned_force=_FORCE / by), plan()), 1.009, 1.011, "its force is"),
        (lambda by: (_limited(speed=_SPEED / by), plan()), 1.009, 1.011, "its speed is"),
        (lambda by: (_limited(keep_in=_REACH / by), plan()), 1.009, 1.011, "it leaves the keep-in box of half sizes"),
        (lambda by: (_asked(step=0.2 * by), plan()), 1.0, 1.1, "the duration of 30 s is not a multiple of the"),
        (lambda by: (_asked(), replace(plan(), duration=30.0 + by)), 1e-7, 3e-7, "the duration of 30 s is not a mul"),
        (lambda by: (_asked(), replace(plan(), acceleration_target=plan().acceleration_target / by)), 1.0, 0.0,
         "its samples are not finite"),
    ],
)  # fmt: skip
def test_a_plan_may_differ_a_little_from_what_was_asked_for(
    change: Callable[[float], tuple[PlanQuery, Plan]], allowed: float, refused: float, message: str
) -> None:
    assert plan_mistake(*change(allowed)) == ""
    with np.errstate(divide="ignore", invalid="ignore"):
        assert message in plan_mistake(*change(refused))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: SampledPath(np.array([0.0, 1.0, 1.0]), np.zeros((3, 3)), np.zeros((3, 3))), "times start at 0 s"),
        (lambda: SampledPath(np.array([0.1, 1.0]), np.zeros((2, 3)), np.zeros((2, 3))), "times start at 0 s"),
        (lambda: SampledPath(np.array([0.0]), np.zeros((1, 3)), np.zeros((1, 3))), "at least two samples"),
        (lambda: SampledPath(np.array([0.0, 1.0]), np.zeros((2, 3)), np.ones((3, 3))),
         r"velocity must be finite, of shape \(2, 3\), got the shape \(3, 3\)"),
        (lambda: SampledPath(np.array([0.0, 1.0]), np.full((2, 3), np.nan), np.ones((2, 3))), "position must be"),
        (lambda: ConformalBound(epsilon=0.1, trials=8), "0.1 needs 9 trials, and `trials` is 8; raise one of the two"),
    ],
)  # fmt: skip
def test_what_makes_no_sense_is_refused(make: Callable[[], object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make()


def test_what_is_just_allowed_is_taken() -> None:
    spline_basis(8, 20, 10.0)
    SampledPath(np.array([0.0, 1.0]), np.zeros((2, 3)), np.zeros((2, 3)))
    design_tube(request(axis=replace(AXIS, step=0.2 * (1.0 + 5e-7))))
    assert ConformalBound(epsilon=0.1, trials=9).trials == 9


@pytest.mark.parametrize(
    ("period", "expected"),
    [
        (None, (1, 151)), (1.0, (31, 5)), (40.0, (1, 200)), (0.2, (151, 1)),
        (0.2 * (1.0 + 9e-7), (151, 1)),
    ],
)  # fmt: skip
def test_updates_are_whole_steps(period: float | None, expected: Any) -> None:
    assert BoundQuery(plan(), query().inertia, EstimateErrors(0.01, 1e-3), period).windows() == expected


def _samples(count: int, size: float = 1.0) -> ErrorSamples:
    """Return trials whose scores are 1, 2, 3, ... of the first one's."""
    errors = np.arange(1.0, count + 1.0)[:, None, None] * np.ones((count, 4, 3))
    return ErrorSamples(np.arange(4.0), errors, 2.0 * errors, size * errors)


@pytest.mark.parametrize(
    ("epsilon", "scale", "rank"), [(0.2, 1, 8), (0.5, 1, 5), (0.11, 1, 9), (0.1, 1, 9), (0.3, 3, 6)]
)
def test_a_bound_is_the_error_of_one_trial(epsilon: float, scale: int, rank: int) -> None:
    """Of 10 trials the first give the scale; the scores of the others ascend."""
    found = conformal_bound(_samples(10), epsilon, scale)
    assert found.level == rank / (10 - scale + 1)
    assert found.trials == 10
    np.testing.assert_allclose(found.position, rank + scale)
    np.testing.assert_allclose(found.velocity, 2.0 * (rank + scale))
    np.testing.assert_array_equal(found.covers(_samples(12)), np.arange(12) < rank + scale)


def test_an_error_of_no_scale_is_refused_and_none_of_none_is_covered() -> None:
    samples = _samples(10, size=0.0)
    assert not conformal_bound(samples, 0.2, 1).force.any()
    samples.force[5:] = 1.0
    with pytest.raises(ValueError, match="an error is zero in all trials of the scale but not in others"):
        conformal_bound(samples, 0.2, 1)
    nothing = Bound(samples.times, np.zeros(4), np.zeros(4), np.zeros(4), 1.0, 1)
    assert not nothing.covers(_samples(2)).any()
    assert math.isclose(float(conformal_bound(_samples(10), 0.2, 1).force[0]), 9.0)
