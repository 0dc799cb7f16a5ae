"""A reference that has left what the tube was designed for is noticed."""

from __future__ import annotations

import numpy as np
import pytest

from safe_inspect.rendezvous.control.bound import Bound
from safe_inspect.rendezvous.control.design import DesignRequest, TubeDesign, design_tube
from safe_inspect.rendezvous.control.tube import Axis, TrackedReference, TrackingLimits
from safe_inspect.rendezvous.coordination.actions import reference_problem


@pytest.fixture(scope="module")
def bound(plan) -> Bound:
    ones = np.ones(len(plan.times))
    return Bound(plan.times, 0.03 * ones, 3e-3 * ones, 2e-3 * ones, 0.95, 300)


@pytest.fixture(scope="module")
def design(plan, bound) -> TubeDesign:
    far = np.full(len(plan.times), np.inf)
    design = design_tube(
        DesignRequest(plan, bound, far, Axis(9.583788668), TrackingLimits(keep_in=np.array([2.0, 3.0, 2.0])), 3e-3)
    )
    assert design.accepted
    return design


def test_the_plans_own_reference_has_no_problem(plan, bound, design):
    for k in (0, 100, len(plan.times) - 1):
        assert reference_problem(design, plan, bound, TrackedReference(plan.position, plan.velocity), k) == ""


def test_a_reference_beyond_the_bound_is_named_with_its_time(plan, bound, design):
    position = plan.position.copy()
    position[50, 1] += 0.04
    moved = TrackedReference(position, plan.velocity)
    assert "by 0.040 m at 10.0 s, more than the bound of 0.030 m" in reference_problem(design, plan, bound, moved)
    assert reference_problem(design, plan, bound, moved, 51) == ""  # that is over


def test_a_reference_that_needs_too_much_force_is_named(plan, bound, design):
    velocity = plan.velocity.copy()
    velocity[100:] += 0.0029
    velocity[101:] -= 0.0058  # a step of the velocity that no force of 0.3 N gives in 0.2 s with feedback left
    assert "the force limit" in reference_problem(design, plan, bound, TrackedReference(plan.position, velocity))


def test_rows_after_the_plan_are_held_to_the_limits_only(plan, bound, design):
    still = np.repeat(plan.position[-1:], 50, axis=0)
    hold = TrackedReference(
        np.vstack((plan.position, still)), np.vstack((plan.velocity, np.zeros_like(still) + plan.velocity[-1]))
    )
    assert reference_problem(design, plan, bound, hold, len(plan.times) + 10) == ""
    away = TrackedReference(hold.position + 5.0 * (np.arange(len(hold.position)) > 310)[:, None], hold.velocity)
    assert "keep-in box" in reference_problem(design, plan, bound, away)
