"""Rendezvous at full scale on an orbit: the plan's force, the change of units, holding against the tide, a mission."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from safe_inspect.config.data import configs_root
from safe_inspect.dynamics.cwh import transition
from safe_inspect.dynamics.quaternion import conjugate, normalise, rotate
from safe_inspect.dynamics.tide import to_hill
from safe_inspect.geometry.oriented_boxes import OrientedBoxes
from safe_inspect.missions.mission import Mission
from safe_inspect.missions.truth import ChaserFlight
from safe_inspect.rendezvous.control.tracker import LinearFeedback
from safe_inspect.rendezvous.control.tube import Axis, TrackedReference
from safe_inspect.rendezvous.coordination.actions import tide_of
from safe_inspect.rendezvous.coordination.pilot import limits_of
from safe_inspect.rendezvous.estimate import BodyState
from safe_inspect.rendezvous.experiment import load_rendezvous
from safe_inspect.rendezvous.planner.approach import SplineSCPPlanner
from safe_inspect.rendezvous.planner.query import Plan, PlanQuery

from ..reference.hill import system_matrices

FILE: Path = configs_root() / "tumbling-rendezvous" / "experiment-orbit.yml"
CONFIG = load_rendezvous(FILE).config
N = CONFIG.mission.mean_motion


def _query(seed: int, **changes: object) -> PlanQuery:
    target = CONFIG.target()
    rate = np.array([0.2, 0.4, 0.9])
    base = PlanQuery(
        t0=700.0,
        state=np.array([0.0, -30.0, 0.0, 0.0, 0.0, 0.0]),
        orientation=normalise(np.random.default_rng(seed).normal(size=4)),
        angular_velocity=np.deg2rad(1.6) * rate / np.linalg.norm(rate),
        inertia=target.principal,
        mating_point=target.mating_point,
        solid=target.solid,
        R_MT=target.R_MT,
        limits=limits_of(CONFIG.chaser, CONFIG.mission.length),
        margin=lambda times: np.full(times.shape, 1.6),
        durations=(200.0,),
        waits=(0.0, 40.0, 80.0),
        mean_motion=N,
        length=CONFIG.mission.length,
    )
    return replace(base, **changes)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def plan() -> Plan:
    found = SplineSCPPlanner()(_query(0))
    assert found.solved, found.report.message
    return found


def _fly(plan: Plan, with_tide: bool) -> np.ndarray:
    """Return where the plan's force leads in Hill's frame, by its equations of motion, as a state of W."""
    a, b = system_matrices(N, CONFIG.chaser.mass)
    force = plan.force if with_tide else CONFIG.chaser.mass * plan.acceleration

    def rates(t: float, x: np.ndarray) -> np.ndarray:
        now = np.array([np.interp(t, plan.times, column) for column in force.T])
        turned = to_hill(N, t, np.concatenate([now, np.zeros(3)]))[:3]
        return a @ x + b @ turned

    start = to_hill(N, plan.t_start, np.concatenate([plan.position[0], plan.velocity[0]]))
    span = (plan.times[0], plan.times[-1])
    end = solve_ivp(rates, span, start, rtol=1e-9, atol=1e-9, max_step=0.5).y[:, -1]
    wanted = to_hill(N, plan.times[-1], np.concatenate([plan.position[-1], plan.velocity[-1]]))
    return np.asarray(end - wanted)


def test_the_plans_force_leads_to_the_mating_point_in_hills_frame(plan: Plan) -> None:
    assert np.abs(_fly(plan, with_tide=True)[:3]).max() < 5e-3
    assert np.abs(_fly(plan, with_tide=False)[:3]).max() > 0.3


def test_a_plan_keeps_limits_and_clearance_at_full_scale(plan: Plan) -> None:
    query = _query(0)
    limits = query.limits
    np.testing.assert_allclose(plan.position_target[-1], query.mating_point, atol=1e-8)
    np.testing.assert_allclose(plan.velocity_target[-1], 0.0, atol=1e-8)
    assert np.allclose(np.diff(plan.times), 0.2)
    assert (np.abs(plan.force) <= limits.planned_force + 1e-6).all()
    assert (np.abs(plan.velocity) <= limits.speed + 1e-6).all()
    in_target = rotate(conjugate(plan.orientation), plan.position)
    spare = query.solid.distance(in_target @ query.R_MT.T) - limits.radius - 1.6
    assert spare.min() >= -0.2
    np.testing.assert_allclose(CONFIG.chaser.mass * (plan.acceleration - plan.tide), plan.force, rtol=1e-12)


def test_a_scenario_of_any_size_is_planned_as_in_a_room() -> None:
    length, time, mass = 20.0, 3.0, 150.0
    room = _query(
        1,
        mean_motion=0.0,
        length=1.0,
        state=np.array([0.0, -1.5, 0.0, 0.0, 0.0, 0.0]),
        solid=OrientedBoxes(*(part / 20.0 for part in (_query(0).solid.centre, _query(0).solid.half_size)),
                            _query(0).solid.rotation),
        angular_velocity=np.deg2rad(5.0) * np.array([0.2, 0.4, 0.9]),
        mating_point=np.array([0.25, 0.0, 0.42]),
        margin=lambda times: np.full(times.shape, 0.08),
        limits=replace(_query(0).limits, speed=0.115, planned_force=0.168, force=0.3, radius=0.25, mass=9.583788668,
                       keep_in=np.array([0.8, 3.0, 0.8]), line_of_sight_rate=0.17, cone_range=0.7, least_range=0.2),
        durations=(60.0,),
        waits=(0.0,),
    )  # fmt: skip
    force = mass * length / time**2
    large = replace(
        room,
        state=length * room.state,
        solid=OrientedBoxes(length * room.solid.centre, length * room.solid.half_size, room.solid.rotation),
        angular_velocity=room.angular_velocity / time,
        mating_point=length * room.mating_point,
        margin=lambda times: np.full(times.shape, 0.08 * length),
        limits=replace(
            room.limits, speed=0.115 * length / time, planned_force=0.168 * force, force=0.3 * force,
            radius=0.25 * length, mass=mass * room.limits.mass, keep_in=length * np.array([0.8, 3.0, 0.8]),
            line_of_sight_rate=0.17 / time, cone_range=0.7 * length, least_range=0.2 * length,
        ),
        durations=(60.0 * time,),
        length=length,
    )  # fmt: skip
    small, big = SplineSCPPlanner()(room), SplineSCPPlanner()(large)
    assert small.solved, small.report.message
    assert big.solved, big.report.message
    np.testing.assert_allclose(big.path.points, length * small.path.points, atol=1e-4)
    assert big.report.cost == pytest.approx(small.report.cost * force**2 * time, rel=1e-5)
    assert big.report.clearance == pytest.approx(small.report.clearance * length, abs=1e-4)


def test_the_chaser_holds_its_place_against_the_tide() -> None:
    step, still = CONFIG.mission.step, np.zeros(3)
    place = np.array([20.0, -30.0, 5.0])
    tracker = LinearFeedback.of_lqr(Axis(CONFIG.chaser.mass, step), CONFIG.chaser.limits.force)
    away = {}
    for known in (True, False):
        flight = ChaserFlight(CONFIG, BodyState(place, still, np.array([0.0, 0.0, 0.0, 1.0]), still))
        for k in range(1500):
            times = step * (k + np.arange(2.0))
            tide = tide_of(N, times, place[None].repeat(2, axis=0)) if known else None
            reference = TrackedReference(place[None].repeat(2, axis=0), np.zeros((2, 3)), tide)
            now = flight.state
            force = tracker.step(np.concatenate([now.position, now.velocity]), reference, 0).force
            flight.step(force, still)  # B is along W
        away[known] = float(np.linalg.norm(flight.state.position - place))
    assert away[True] < 1e-6
    assert away[False] > 1e-5


def test_an_orbit_without_a_box_is_refused() -> None:
    from safe_inspect.errors import ConfigError

    with pytest.raises(ConfigError, match=r"on an orbit .* chaser\.limits\.keep_in must be given"):
        load_rendezvous(FILE, ["chaser.limits.keep_in=null"])


@pytest.mark.slow
@pytest.mark.parametrize("number", [0, pytest.param(1, marks=pytest.mark.long)])
def test_the_mission_reaches_the_mating_point_of_envisat_at_full_scale(number: int) -> None:
    result = Mission(load_rendezvous(FILE, ["mission.observe=2 s"]).config, number).run()
    assert result.summary["success"], result.summary
    assert result.summary["least_clearance"] > 2.0
    assert result.summary["mating_position_error"] < 0.4
    assert result.summary["largest_gauge"] < 1.0


@pytest.mark.slow
def test_the_chaser_leaves_where_the_camera_fails_on_the_approach() -> None:
    fault = "mission.faults=[{kind: camera, start: 150 s, duration: 5000 s}]"
    result = Mission(load_rendezvous(FILE, ["mission.observe=2 s", fault]).config, 0).run()
    phases = [event["data"]["to"] for event in result.log.events if event["event"] == "transition"]
    assert phases[-3:] == ["RETREAT", "DEPART", "ABORTED"]
    assert result.summary["least_clearance"] > 0.5
    final = result.log.arrays()["x"][-1]
    assert np.linalg.norm(final[:3]) > 28.0
    # Free flight does not come back in a revolution.
    hill = to_hill(N, result.summary["time"], final)
    revolution = np.linspace(0.0, 2.0 * np.pi / N, 500)
    ahead = np.array([transition(N, 1.0, time)[0] @ hill for time in revolution])
    assert np.linalg.norm(ahead[:, :3], axis=1).min() > 27.0
