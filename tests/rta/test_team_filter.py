"""The filter that decides for a team: nothing is broken under adversaries, alone or between deputies."""

from __future__ import annotations

import numpy as np
import pytest
from admissible import admissible
from pydantic import ValidationError
from team_safety import draw_teams, team_report, team_thrust

from safe_inspect.dynamics import Dynamics
from safe_inspect.dynamics.cwh import propagate, transition
from safe_inspect.rta import RTACWHInspectionTeam, RTAGlueCWHInspection1v1
from safe_inspect.rta.backup.safety_filter import BackupFilter
from safe_inspect.rta.team.safety_filter import TeamFilter, TeamState
from safe_inspect.simulators.state import State, base_specs
from safe_inspect.simulators.team import TEAM, TEAM_FILTER, TeamView
from safe_inspect.simulators.world import World
from safe_inspect.tasks.inspection.sun import Sun

N, MASS, DT = 0.001027, 12.0, 10.0
PERIOD = 2.0 * np.pi / N


@pytest.fixture(scope="module")
def run():
    return TeamFilter()


@pytest.fixture(scope="module")
def start(run):
    return draw_teams(run, 42, 3, seed=5)


def flown(state, control, time=DT):
    """Return the states after holding the thrusts for a while."""
    p, v = state.position.reshape(-1, 3).copy(), state.velocity.reshape(-1, 3).copy()
    propagate(p, v, np.ascontiguousarray(control).reshape(-1, 3), *transition(N, MASS, time), p, v)
    shape = state.position.shape
    return TeamState(p.reshape(shape), v.reshape(shape), state.sun_angle + N * time, state.fixed)


def closest(state):
    first, second = np.triu_indices(state.position.shape[1], 1)
    return np.linalg.norm(state.position[:, first] - state.position[:, second], axis=-1).min(axis=1)


def least(run, state):
    return min(value.min() for value in run.phi(state).values())


def test_nothing_is_broken_under_adversaries(run, start):
    report = team_report("centralised", run, start, 42 * 70, seed=1)
    assert report.violations == 0
    assert report.infeasible == 0
    assert report.least_at_steps.min() > 0.0
    assert report.least_between.min() > 0.0
    assert report.closest.min() < 10.1  # the adversaries do reach the distance that is kept
    assert (report.interventions > 0.5 * report.flown).all()


def test_five_deputies_and_passive_safety_between_them():
    run = TeamFilter(names=("chief_collision", "rel_vel", "PSM", "y_vel", "deputy_collision", "deputy_PSM"))
    report = team_report("centralised", run, draw_teams(run, 7, 5, seed=2), 7 * 25, seed=2)
    assert report.violations == 0
    assert report.infeasible == 0


def test_a_joint_plan_is_safe_for_an_orbit(run, start):
    found, thrust, numbers = run.plans(start)
    assert found.all()
    assert (numbers > 0).all()
    assert np.abs(thrust).max() <= 1.0
    for second in range(1, 11):
        assert least(run, flown(start, thrust, float(second))) >= 0.0
    state = flown(start, thrust)
    rest = np.zeros_like(thrust)
    for time in np.arange(0.0, PERIOD, 20.0):
        assert least(run, flown(state, rest, time)) >= 0.0, time
    np.testing.assert_allclose(flown(state, rest, PERIOD).position, state.position, atol=1e-6)


def test_the_plan_in_memory_is_enough_to_stay_safe(run, start):
    """Fly the adversaries until pairs touch, then only plans: the memory is never without one."""
    state, plan = start, None
    for step in range(40):
        result = run(state, team_thrust(state, step, np.arange(42), 3), plan)
        assert not result.infeasible.any()
        assert (result.plan > 0).all()
        state, plan = flown(state, result.control), result.plan
    forgetful = run(state, team_thrust(state, 40, np.arange(42), 3))
    assert (admissible(run, state, forgetful.control) | forgetful.backup).all()
    assert not forgetful.infeasible.any()


def test_admissible_thrusts_are_flown_bit_for_bit(run, start):
    desired = np.random.default_rng(7).uniform(-0.03, 0.03, start.position.shape)
    safe = admissible(run, start, desired)
    assert 0.2 < safe.mean() < 1.0
    result = run(start, desired)
    np.testing.assert_array_equal(result.control[safe], desired[safe])
    assert (result.active[safe] == 0).all()
    assert (result.active[~safe] != 0).any(axis=1).all()


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_thrust_beyond_the_thrusters_is_not_admissible(sign):
    run = TeamFilter({"u_max": 0.3})
    state = draw_teams(run, 40, 3, seed=5)
    thrust = np.zeros_like(state.position)
    thrust[:, 1, 2] = sign * 0.3
    assert admissible(run, state, thrust).any()
    thrust[:, 1, 2] *= 1.0 + 1e-9
    assert not admissible(run, state, thrust).any()


def test_answers_are_admissible(run, start):
    desired = np.random.default_rng(8).uniform(-1.0, 1.0, start.position.shape)
    result = run(start, desired)
    assert (admissible(run, start, result.control) | result.backup).all()
    assert np.abs(result.control).max() <= 1.0


def test_one_deputy_is_the_single_filter():
    alone, team = BackupFilter(), TeamFilter()
    start = draw_teams(team, 60, 1, seed=9)
    generator = np.random.default_rng(9)
    for size in (0.02, 0.1, 1.0):
        desired = generator.uniform(-size, size, (60, 1, 3))
        same = admissible(alone, start.alone(0), desired[:, 0])
        np.testing.assert_array_equal(admissible(team, start, desired), same)
        one, joint = alone(start.alone(0), desired[:, 0]), team(start, desired)
        np.testing.assert_array_equal(joint.control[same, 0], one.control[same])
        assert admissible(alone, start.alone(0), joint.control[:, 0])[~joint.backup].all()
        gap = np.linalg.norm(joint.control[:, 0] - one.control, axis=-1)
        assert np.median(gap) < 1e-6


def test_without_constraints_of_pairs_the_deputies_do_not_see_each_other(start):
    run, alone = TeamFilter(names=BackupFilter().names), BackupFilter()
    desired = np.random.default_rng(10).uniform(-0.05, 0.05, start.position.shape)
    each = np.stack([admissible(alone, start.alone(i), desired[:, i]) for i in range(3)], axis=1)
    np.testing.assert_array_equal(admissible(run, start, desired), each.all(axis=1))


def test_an_environment_does_not_depend_on_its_batch(run, start):
    desired = team_thrust(start, 0, np.arange(42), 0)
    first = run(start, desired)
    state, want = flown(start, first.control), team_thrust(flown(start, first.control), 1, np.arange(42), 0)
    whole = run(state, want, first.plan)
    for i in range(0, 42, 3):
        part = run(state[i : i + 1], want[i : i + 1], first.plan[i : i + 1])
        np.testing.assert_array_equal(part.control[0], whole.control[i])
        np.testing.assert_array_equal(part.plan[0], whole.plan[i])


def test_permuted_deputies_permute_the_result(run, start):
    desired = team_thrust(start, 0, np.arange(42), 0)
    whole = run(start, desired)
    for order in ([2, 0, 1], [1, 0, 2]):
        state = TeamState(start.position[:, order], start.velocity[:, order], start.sun_angle)
        other = run(state, desired[:, order])
        np.testing.assert_array_equal(other.control, whole.control[:, order])
        np.testing.assert_array_equal(other.plan, whole.plan[:, order])
        np.testing.assert_array_equal(other.active, whole.active[:, order])


def test_finished_deputies_coast_and_are_kept_clear_of(run):
    """The third deputy rests 40 m along the track, where coasting is to stay; the first is driven at it."""
    position = np.array([[[0.0, 80.0, 0.0], [0.0, -60.0, 20.0], [0.0, 40.0, 0.0]]])
    state = TeamState(position, np.zeros((1, 3, 3)), np.zeros(1), np.array([[False, False, True]]))
    plan, near = None, np.inf
    for _ in range(40):
        desired = np.zeros((1, 3, 3))
        desired[0, 0] = np.sign(state.position[0, 2] - state.position[0, 0]) * 0.5
        desired[0, 2] = 1.0
        result = run(state, desired, plan)
        assert not result.infeasible.any()
        np.testing.assert_array_equal(result.control[0, 2], 0.0)
        for second in range(1, 11):
            near = min(near, closest(flown(state, result.control, float(second))).min())
        state, plan = flown(state, result.control), result.plan
    assert 10.0 <= near < 12.0
    np.testing.assert_allclose(state.position[0, 2], [0.0, 40.0, 0.0], atol=1e-9)


def test_a_deputy_that_is_finished_leaves_the_others_their_plans(run):
    """It is finished at a random step, in the middle of a chase: it flies out its plan, and coasts from then on."""
    rows, steps = 48, 40
    generator = np.random.default_rng(21)
    state = draw_teams(run, rows, 2, seed=21)
    end = generator.integers(2, steps - 10, rows)
    plan, near, left = None, np.inf, np.zeros(rows, bool)
    for step in range(steps):
        coasting = np.zeros((rows, 2), bool)
        coasting[:, 1] = step >= end
        state = TeamState(state.position, state.velocity, state.sun_angle, coasting)
        towards = state.position[:, ::-1] - state.position
        towards /= np.linalg.norm(towards, axis=-1, keepdims=True)
        result = run(state, towards, plan)
        assert not result.infeasible.any()
        gone = step > end
        np.testing.assert_allclose(result.control[gone, 1], 0.0, atol=1e-12)
        left |= (step == end) & (np.abs(result.control[:, 1]).max(axis=-1) > 1e-3)
        for second in range(1, 11):
            near = min(near, closest(flown(state, result.control, float(second))).min())
        state, plan = flown(state, result.control), result.plan
    assert 10.0 <= near < 10.5
    assert left.mean() > 0.5


def test_a_drifting_obstacle_is_certified_as_samples_say():
    from safe_inspect.rta.team.plans import ORBITS, apart

    generator = np.random.default_rng(12)
    position = generator.normal(size=(300, 1, 3)) * generator.uniform(5.0, 25.0, (300, 1, 1))
    velocity = generator.normal(size=(300, 1, 3)) * 0.01
    state = TeamState(position, velocity, np.zeros(300))
    least = np.full(300, np.inf)
    for time in np.arange(0.0, ORBITS * PERIOD, 10.0):
        least = np.minimum(least, np.linalg.norm(flown(state, np.zeros_like(position), time).position[:, 0], axis=-1))
    safe = np.array([apart(N, (*position[i, 0], *velocity[i, 0]), 10.0) for i in range(300)])
    assert 30 < safe.sum() < 270
    assert (least[safe] >= 10.0).all()
    assert safe[least > 10.05].all()


def test_without_a_plan_it_says_so_and_flies_apart(run):
    position = np.array([[[0.0, 60.0, 0.0], [0.0, 64.0, 0.0], [60.0, 0.0, 0.0]]])
    velocity = np.array([[[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, -2.0 * N * 60.0, 0.0]]])
    state, plan, promised = TeamState(position, velocity, np.full(1, 1.0)), None, []
    assert not run.recoverable(state).any()
    for _ in range(60):
        result = run(state, np.zeros((1, 3, 3)), plan)
        promised.append(not result.infeasible[0])
        state, plan = flown(state, result.control), result.plan
    assert not promised[0]
    assert closest(state)[0] > 10.0
    assert promised[-1]
    assert promised == sorted(promised), "once there is a plan there always is one"


def team_view(state, plan=None, finished=None):
    count, deputies = state.position.shape[:2]
    specs = (
        base_specs(deputies, deputies, 3, Dynamics.arrays)
        | Sun()(world(deputies), count).arrays
        | {
            f"memory/{TEAM}/{TEAM_FILTER}/{name}": type(spec)((1, *spec.shape), spec.dtype)
            for name, spec in RTACWHInspectionTeam().memory(world(deputies)).items()
        }
    )
    inner = State(count, specs)
    inner.position[...], inner.velocity[...] = state.position, state.velocity
    inner.sun_angle[...] = state.sun_angle
    if finished is not None:
        inner.finished[...] = finished
    view = TeamView(inner, world(deputies))
    if plan is not None:
        inner.memory[TEAM, TEAM_FILTER, "plan"][...] = plan
    return view


def world(deputies):
    names = tuple(f"blue{i}" for i in range(deputies))
    found = World(names, {name: i for i, name in enumerate(names)}, np.full(deputies, MASS), DT)
    found.offers.world["mean_motion"] = N
    found.offers.add(Sun()(found, 1))
    return found


def test_the_plugin_flies_the_filter_and_remembers_its_plan(run, start):
    plugin = RTACWHInspectionTeam()
    desired = team_thrust(start, 0, np.arange(42), 0)
    result, given = run(start, desired), plugin(desired, team_view(start))
    np.testing.assert_array_equal(given.control, result.control)
    np.testing.assert_array_equal(given.memory["plan"], result.plan)
    changed = np.linalg.norm(given.control - desired, axis=-1) > 0.01
    np.testing.assert_array_equal(given.intervening, changed)
    after = flown(start, result.control)
    want = team_thrust(after, 1, np.arange(42), 0)
    again = plugin(want, team_view(after, given.memory["plan"]))
    np.testing.assert_array_equal(again.control, run(after, want, result.plan).control)


def test_the_plugin_lets_finished_deputies_coast(start):
    finished = np.zeros((42, 3), np.int8)
    finished[:, 1] = 1
    given = RTACWHInspectionTeam()(np.full((42, 3, 3), 0.3), team_view(start, finished=finished))
    np.testing.assert_array_equal(given.control[:, 1], 0.0)
    assert not given.intervening[:, 1].any()
    assert (given.memory["plan"][:, 1] == 0).all()


def test_refusals_of_teams_of_any_size(start):
    plugin = RTACWHInspectionTeam()
    for deputies in (1, 2, 3):
        states = {
            "position": start.position[:, :deputies], "velocity": start.velocity[:, :deputies],
            "sun_angle": start.sun_angle,
        }  # fmt: skip
        refused = plugin.refusals(states)
        assert not refused["recoverable"].any()
        assert not refused["rel_vel"].any() or refused["rel_vel"].mean() < 0.2  # h asks for a little more than phi
    near = {name: array.copy() for name, array in states.items()}
    near["position"][0, 1] = near["position"][0, 0] + [0.0, 6.0, 0.0]
    near["position"][1, 2, 0] = np.nan
    refused = plugin.refusals(near)
    assert refused["deputy_collision"][:2].all()
    assert refused["recoverable"][:2].all()
    assert not refused["deputy_collision"][2:].any()
    touching = {name: array[:3, :1].copy() if array.ndim > 1 else array[:3].copy() for name, array in states.items()}
    touching["velocity"][:] = 0.0
    for row, reach in enumerate((10.0, 10.0 - 1e-9, 800.0)):
        touching["position"][row] = [0.0, -reach, 0.0]
    refused = plugin.refusals(touching)
    assert refused["chief_collision"].tolist() == [False, True, False], "phi = 0 and h = 0 are allowed"
    assert not refused["r_max"].any()
    np.testing.assert_allclose(plugin.safety(near)["deputy_collision"][0], -4.0)
    assert "deputy_collision" not in plugin.safety({**near, "position": near["position"][:, :1],
                                                    "velocity": near["velocity"][:, :1]})  # fmt: skip


def test_the_share_of_states_that_weak_thrusters_keep():
    assert RTACWHInspectionTeam().recoverable_share() is None
    count, share = RTACWHInspectionTeam(u_max=0.05).recoverable_share()
    alone = RTAGlueCWHInspection1v1(u_max=0.05).recoverable_share()
    assert (count, alone[0]) == (3530, 3530)
    assert 0.01 < share < alone[1] < 0.6  # the joint plans of a team have one hold


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"constraints": ("chief_colision",)}, "unknown constraint 'chief_colision'; did you mean `chief_collision`"),
        ({"constraints": ("sun", "sun")}, "is given twice"),
        ({"step_size": 600.0}, "too long a part of the orbit"),
        ({"r_max": 9.0}, "does not exceed collision_radius"),
        ({"deputy_radius": 900.0}, "must be less than r_max"),
        ({"deputy_radius": -1.0}, "greater than 0"),
        ({"constraints": (), "enabled": True}, "is empty, so the filter enforces nothing"),
    ],
)
def test_bad_parameters_are_named(values, message):
    with pytest.raises(ValidationError, match=message):
        RTACWHInspectionTeam(**values)


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (("chief_collision", "RTATest"), "unknown constraint 'RTATest'"),
        (("deputy_colision",), "did you mean `deputy_collision`"),
    ],
)
def test_what_a_filter_of_a_team_cannot_enforce_is_refused(names, message):
    with pytest.raises(ValueError, match=message):
        TeamFilter(names=names)


def test_bad_input_is_named(run, start):
    with pytest.raises(ValueError, match="desired controls must have the shape"):
        run(start, np.zeros((42, 2, 3)))
    desired = np.zeros(start.position.shape)
    desired[3, 1, 0] = np.inf
    with pytest.raises(ValueError, match="desired control of environment 3"):
        run(start, desired)
    with pytest.raises(ValueError, match="expected a team state with position"):
        TeamState(start.position, start.velocity[:, :2], start.sun_angle)
    with pytest.raises(ValueError, match="the plans of 42 environments"):
        run(start, np.zeros(start.position.shape), np.zeros((42, 2)))
