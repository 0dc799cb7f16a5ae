"""What a refused tube asks of the next plan, and the gain that the next tube keeps."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from safe_inspect.random.streams import Streams
from safe_inspect.rendezvous.control.bound import Bound, BoundQuery, conformal_bound, sample_errors
from safe_inspect.rendezvous.control.design import DesignRequest, TubeDesign, design_by_clearance, natural_gain
from safe_inspect.rendezvous.control.tube import Axis, TrackingLimits
from safe_inspect.rendezvous.coordination.context import PlanDemands
from safe_inspect.rendezvous.estimate import EstimateErrors
from safe_inspect.rendezvous.planner.query import Limits

AXIS = Axis(9.583788668)
TIMES = np.linspace(0.0, 60.0, 31)


@pytest.fixture(scope="module")
def request_(plan, query) -> DesignRequest:
    streams = Streams(3, np.arange(120), np.zeros(120, dtype=np.int64))
    errors = EstimateErrors(np.deg2rad(0.7), np.deg2rad(0.07))
    bound: Bound = conformal_bound(sample_errors(BoundQuery(plan, query.inertia, errors), streams))
    limits = TrackingLimits(keep_in=np.array([2.0, 3.0, 2.0]))
    return DesignRequest(plan, bound, np.full(len(plan.times), np.inf), AXIS, limits, 3e-3, 5)


@pytest.fixture(scope="module")
def design(request_) -> TubeDesign:
    return design_by_clearance(request_)


def test_without_a_tube_only_the_first_margin_is_asked_for() -> None:
    demands, limits = PlanDemands(), Limits()
    assert (demands.margin(TIMES) == 0.08).all()
    assert demands.gain is None
    same = demands.limits(limits, np.zeros(3))
    np.testing.assert_array_equal(same.keep_in, limits.keep_in)
    assert (same.speed, same.planned_force, same.force) == (limits.speed, limits.planned_force, limits.force)


def test_the_margin_is_the_tubes_and_grows_where_its_gain_was_known(design) -> None:
    refused = dataclasses.replace(design, refusal="too wide")
    first = PlanDemands().after(refused)
    np.testing.assert_allclose(first.margin(TIMES), design.margin_at(TIMES) - 0.006)
    again = first.after(refused)
    np.testing.assert_allclose(again.margin(TIMES), design.margin_at(TIMES) - 0.003)
    np.testing.assert_allclose(again.after(design).margin(TIMES), again.margin(TIMES))  # what was needed is kept
    for _ in range(20):
        again = again.after(refused)
    np.testing.assert_allclose(again.margin(TIMES), design.margin_at(TIMES) + 0.009)


def test_a_plan_within_the_limits_that_are_asked_for_fits_the_tube(design) -> None:
    tube = design.tube
    start = np.array([0.0, -1.5, 0.0])
    wide = dataclasses.replace(
        tube, position=tube.position + 0.1, velocity=tube.velocity + 0.05, force=0.7 * tube.force
    )
    short = dataclasses.replace(
        design,
        limits=TrackingLimits(),
        tube=wide,
        state_reserve=np.array([[-0.05, 0.1], [0.2, -0.01], [0.0, 0.0]]),
        force_reserve=np.array([0.1, -0.02]),
    )
    once = PlanDemands().after(short)
    limits = once.limits(Limits(), start)
    inside = 0.8 - wide.position.max()
    np.testing.assert_allclose(limits.keep_in, [inside - 0.002, 3.0, 0.8])
    assert limits.speed == pytest.approx(min(0.115, 0.2 - wide.velocity.max()))
    assert limits.planned_force == pytest.approx(min(0.168, 0.3 - wide.force.max() - 0.005))
    # What one tube has asked for holds for the plans after it, too.
    np.testing.assert_allclose(once.after(design).limits(Limits(), start).keep_in, limits.keep_in)
    # A plan may start outside of the tightened box, and some of each limit is always left.
    outside = once.limits(Limits(), np.array([-0.77, 0.0, 0.0]))
    np.testing.assert_allclose(outside.keep_in, [0.79, 3.0, 0.8])
    much = dataclasses.replace(short, tube=dataclasses.replace(wide, force=wide.force + 5.0))
    assert PlanDemands().after(much).limits(Limits(), start).planned_force == pytest.approx(0.3 * 0.168)


def test_demands_on_the_rest_of_a_plan_are_those_of_its_later_times(design) -> None:
    demands = PlanDemands().after(design)
    rest = demands.later(20.0)
    np.testing.assert_allclose(rest.margin(TIMES), demands.margin(TIMES + 20.0))
    assert rest.gain is None


def test_the_gain_that_a_plan_was_made_for_is_kept_where_the_force_allows_it(request_, design) -> None:
    gain = natural_gain(AXIS, 0.2, 0.9)
    kept = design_by_clearance(dataclasses.replace(request_, gain=gain))
    assert kept.accepted
    np.testing.assert_array_equal(kept.tube.gain, gain)
    too_stiff = dataclasses.replace(request_, gain=natural_gain(AXIS, 5.0, 0.9))
    np.testing.assert_array_equal(design_by_clearance(too_stiff).tube.gain, design.tube.gain)
    # A gain that changes on the way is stretched to a plan of another length.
    varying = natural_gain(AXIS, np.linspace(0.2, 0.25, 101), 0.9)
    stretched = design_by_clearance(dataclasses.replace(request_, gain=varying)).tube.gain
    assert stretched.shape == (len(request_.plan.times), 2)
    np.testing.assert_array_equal(stretched[[0, -1]], varying[[0, -1]])
