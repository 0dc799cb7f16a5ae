from dataclasses import replace

import numpy as np
import pytest
from rendezvous_slsqp import optimise_slsqp

from safe_inspect.dynamics.quaternion import conjugate, multiply, normalise, rotate
from safe_inspect.dynamics.tumble import tumble
from safe_inspect.rendezvous import libraries
from safe_inspect.rendezvous.planner.approach import SplineSCPPlanner
from safe_inspect.rendezvous.planner.checks import certify
from safe_inspect.rendezvous.planner.paths import SplinePath
from safe_inspect.rendezvous.planner.problem import approach_problem
from safe_inspect.rendezvous.planner.query import Limits, PlanStatus

pytest.importorskip("piqp")


def _clearance(query, plan):
    """Return distance less radius and margin at 3,001 times of a plan."""
    times = np.linspace(0.0, plan.duration, 3001)
    p, _, _ = plan.path.at(times)
    q, _ = tumble(query.inertia, query.orientation[None], query.angular_velocity[None], plan.t_start - query.t0 + times)
    in_target = rotate(conjugate(q[0]), p)
    return query.solid.distance(in_target @ query.R_MT.T) - query.limits.radius - query.margin(times)


@pytest.mark.parametrize("seed", range(6))
def test_a_plan_starts_and_ends_right_and_keeps_every_limit(query, seed):
    asked = query(seed)
    plan, limits = SplineSCPPlanner()(asked), asked.limits
    assert plan.status is PlanStatus.SOLVED
    assert plan.solved
    assert plan.report.message == ""
    assert plan.times[0] == plan.t_start == 100.0
    assert np.allclose(np.diff(plan.times), 0.2)
    assert np.allclose(plan.position[0], asked.state[:3])
    assert np.allclose(plan.velocity[0], 0.0, atol=1e-12)
    assert np.allclose(plan.position_target[-1], asked.mating_point, atol=1e-9)
    assert np.allclose(plan.velocity_target[-1], 0.0, atol=1e-9)
    assert np.allclose(plan.acceleration_target[-1], 0.0, atol=1e-9)
    assert np.allclose(plan.force, limits.mass * plan.acceleration)
    assert (np.abs(plan.position) <= limits.keep_in + 1e-6).all()
    assert (np.abs(plan.velocity) <= limits.speed + 1e-6).all()
    assert (np.abs(plan.force) <= limits.planned_force + 1e-5).all()
    assert plan.report.clearance >= -0.01
    assert plan.report.violation <= 1e-6
    assert plan.report.iterations >= 1
    assert plan.report.starts == 1
    assert _clearance(asked, plan).min() >= plan.report.clearance
    rate = np.linalg.norm(np.cross(plan.position, plan.velocity), axis=1) / (plan.position**2).sum(axis=1)
    assert (rate <= limits.line_of_sight_rate * 1.01).all()


def test_derivatives_in_the_targets_frame_are_those_of_its_positions(query):
    plan = SplineSCPPlanner()(query(1))
    step = plan.times[1] - plan.times[0]
    for value, slope in (
        (plan.position_target, plan.velocity_target),
        (plan.velocity_target, plan.acceleration_target),
    ):
        differences = (-value[4:] + 8.0 * value[3:-1] - 8.0 * value[1:-3] + value[:-4]) / (12.0 * step)
        assert np.allclose(differences, slope[2:-2], atol=2e-6)


def test_a_turned_world_gives_the_turned_plan(query):
    limits = Limits(keep_in=np.full(3, np.inf), speed=1.0, planned_force=1.0)
    asked, turn = query(2, limits=limits), normalise(np.array([0.3, 0.1, -0.4, 0.8]))
    turned = replace(
        asked,
        state=np.concatenate((rotate(turn, asked.state[:3]), np.zeros(3))),
        orientation=multiply(turn, asked.orientation),
    )
    plan, other = SplineSCPPlanner()(asked), SplineSCPPlanner()(turned)
    assert plan.solved
    assert other.report.cost == pytest.approx(plan.report.cost, rel=1e-3)
    assert np.allclose(other.position, rotate(np.broadcast_to(turn, (301, 4)), plan.position), atol=1e-2)


def test_half_as_fast_is_the_same_way_in_twice_the_time(query):
    fast = query(9)
    slow = replace(
        fast,
        angular_velocity=0.5 * fast.angular_velocity,
        durations=(120.0,),
        limits=Limits(speed=0.0575, planned_force=0.042, line_of_sight_rate=0.085),
    )
    plan, other = SplineSCPPlanner()(fast), SplineSCPPlanner()(slow)
    assert np.allclose(other.path.points, plan.path.points, atol=5e-3)
    assert other.report.cost == pytest.approx(plan.report.cost / 8.0, rel=1e-3)


def test_the_query_is_not_changed_and_the_plan_is_the_same_again(query):
    asked = query(4)
    before = asked.state.copy(), asked.orientation.copy()
    first, second = SplineSCPPlanner()(asked), SplineSCPPlanner()(asked)
    assert (first.path.points == second.path.points).all()
    assert (asked.state == before[0]).all()
    assert (asked.orientation == before[1]).all()


def test_what_is_wrong_with_the_mating_point_is_said(query):
    for changes, message in (
        ({"mating_point": np.array([0.0, 0.0, 0.2])}, "closer to the target than radius and margin allow"),
        ({"limits": Limits(speed=0.02)}, "the mating point moves at"),
        ({"limits": Limits(planned_force=0.01)}, "following the mating point takes"),
        ({"limits": Limits(line_of_sight_rate=0.03)}, "line of sight turns"),
        ({"limits": Limits(keep_in=np.array([0.1, 3.0, 0.1]))}, "outside the keep-in box"),
        ({"limits": Limits(keep_in=np.array([0.4, 3.0, 0.4])), "hold": 40.0}, "leaves the keep-in box"),
    ):
        plan = SplineSCPPlanner()(query(0, **changes))
        assert plan.status is PlanStatus.TERMINAL_INFEASIBLE
        assert message in plan.report.message
        assert not plan.solved
        assert plan.path is None


def test_what_is_wrong_with_the_start_is_said(query):
    for state, message in (
        ([0.9, -1.5, 0.0, 0.0, 0.0, 0.0], "outside the keep-in box"),
        ([0.0, -1.5, 0.0, 0.2, 0.0, 0.0], "the speed at the start is"),
        ([0.0, -0.4, 0.0, 0.0, 0.0, 0.0], "closer to the target"),
        ([0.0, 0.0, 0.0, 0.0, 0.0, 0.0], "closer to the target"),
        ([0.0, -0.6, 0.0, 0.11, 0.0, 0.0], "line of sight turns"),
    ):
        plan = SplineSCPPlanner()(query(0, state=np.array(state)))
        assert plan.status is PlanStatus.START_INFEASIBLE
        assert message in plan.report.message


def test_a_start_that_drifts_out_of_the_box_is_refused(query):
    plan = SplineSCPPlanner()(query(0, state=np.array([0.79, -1.5, 0.0, 0.1, 0.0, 0.0])))
    assert plan.status is PlanStatus.TERMINAL_INFEASIBLE
    assert "leads out of the keep-in box" in plan.report.message


def test_a_duration_that_is_too_short_is_not_solved(query):
    plan = SplineSCPPlanner()(query(0, durations=(8.0,)))
    assert plan.status is PlanStatus.NOT_CONVERGED
    assert "no spline of this duration" in plan.report.message


def test_waits_and_durations_make_a_plan_no_more_expensive(query):
    asked = query(5)
    alone = SplineSCPPlanner()(asked)
    offered = SplineSCPPlanner()(replace(asked, waits=tuple(np.arange(0.0, 61.0)), durations=(50.0, 60.0)))
    assert offered.solved
    assert offered.report.cost <= alone.report.cost
    assert 100.0 <= offered.t_start <= 160.0
    assert _clearance(asked, offered).min() >= -0.01
    assert np.allclose(offered.position_target[-1], asked.mating_point, atol=1e-9)


def test_a_moving_chaser_does_not_wait(query):
    moving = query(5, state=np.array([0.0, -1.5, 0.0, 0.02, 0.0, 0.0]), waits=(0.0, 10.0))
    assert SplineSCPPlanner()(moving).t_start == 100.0
    assert SplineSCPPlanner()(replace(moving, waits=(10.0,))).status is PlanStatus.TERMINAL_INFEASIBLE


def test_the_cone_is_kept_near_the_mating_point(query):
    limits = Limits(cone=np.deg2rad(30.0))
    plan = SplineSCPPlanner()(query(7, limits=limits))
    assert plan.solved
    distance = np.linalg.norm(plan.position_target, axis=1)
    along = plan.position_target @ np.array([0.25, 0.0, 0.42]) / np.linalg.norm([0.25, 0.0, 0.42])
    near = distance < limits.cone_range - 0.01
    assert near.any()
    assert (along[near] >= np.cos(np.deg2rad(31.0)) * distance[near]).all()


def test_the_certificate_refuses_a_plan_that_touches_between_samples(query):
    asked = query(0)
    problem = approach_problem(asked, 0.0, 60.0, 20, 121)
    through = problem.cold()
    through[8:12] = 0.0  # through the bus
    proof = certify(asked, SplinePath(problem.basis, through))
    assert not proof.certified
    assert proof.clearance < -0.01
    assert 0.0 < proof.time < 60.0
    plan = SplineSCPPlanner()(asked)
    good = certify(asked, plan.path)
    assert good.certified
    assert good.clearance == plan.report.clearance
    assert np.isnan(good.time)
    assert not certify(replace(asked, margin=lambda t: 0.08 + 0.0015 * t), plan.path).certified


def test_least_squares_programming_finds_no_cheaper_plan(query):
    asked = query(8)
    ours = SplineSCPPlanner()(asked)
    problem = approach_problem(asked, 0.0, 60.0, 20, 61)
    theirs = optimise_slsqp(problem, problem.cold())
    assert ours.solved
    assert theirs.feasible
    assert ours.report.cost <= 1.02 * theirs.cost


def test_the_cost_is_the_integral_of_the_squared_force(query):
    asked = query(8)
    plan = SplineSCPPlanner()(asked)
    problem = approach_problem(asked, plan.t_start - asked.t0, plan.duration, 20, 121)
    times = np.linspace(0.0, plan.duration, 200_001)
    force = asked.limits.mass * SplinePath(problem.basis, plan.path.points).at(times)[2]
    assert plan.report.cost == pytest.approx(0.5 * np.trapezoid((force**2).sum(axis=1), times), rel=1e-6)
    change = np.random.default_rng(2).normal(size=plan.path.points.shape) * 1e-5
    slope = (problem.cost(plan.path.points + change) - problem.cost(plan.path.points - change)) / 2.0
    assert slope == pytest.approx(((problem.hessian @ plan.path.points) * change).sum(), rel=1e-6)


def test_a_missing_library_is_named(monkeypatch):
    with pytest.raises(ImportError, match=r"install the extra: pip install .\[rendezvous\]"):
        libraries.require("no_such_library")


@pytest.mark.slow
def test_eighty_random_queries_are_solved_and_clear(query):
    generator = np.random.default_rng(0)
    for seed in range(80):
        w = generator.normal(size=3)
        asked = query(seed, angular_velocity=np.deg2rad(5.0) * w / np.linalg.norm(w))
        plan = SplineSCPPlanner()(asked)
        assert plan.solved, plan.report.message
        assert _clearance(asked, plan).min() >= -0.01
