"""What plugins read in views of a state, of a group and of the team, element by element from its arrays."""

from __future__ import annotations

import numpy as np
import pytest

from safe_inspect.dynamics import Dynamics
from safe_inspect.simulators.row_terms import OwnArray, range_inputs
from safe_inspect.simulators.state import State, base_specs
from safe_inspect.simulators.team import TeamView
from safe_inspect.simulators.view import Group, Step, View
from safe_inspect.simulators.world import World

ENVS, NAMES, MASSES = 3, ("red", "green", "blue", "white"), np.array([12.0, 3.0, 7.0, 5.0])
DEPUTIES, STEP = len(NAMES), 10.0


def drawn(seed: int) -> State:
    """Return a state in which no two numbers are equal."""
    state = State(ENVS, base_specs(DEPUTIES + 1, DEPUTIES, 3, Dynamics.arrays))
    generator = np.random.default_rng(seed)
    for name, array in state.arrays.items():
        if name != "key":
            array[...] = generator.permutation(np.arange(1, array.size + 1)).reshape(array.shape) + 0.0
    return state


@pytest.fixture
def world() -> World:
    bodies = {name: index for index, name in enumerate((*NAMES, "chief"))}
    return World(NAMES, bodies, MASSES, STEP)


@pytest.mark.parametrize(("first", "size"), [(0, 1), (2, 1), (0, 2), (1, 3), (0, 4)])
def test_a_group_sees_its_own_deputies_environment_by_environment(world, first, size):
    state = drawn(1)
    there = np.array([3.0, -4.0, 2.0])
    view = View(state, world, Group("some", first, size, {"there": lambda view: np.tile(there, (view.num_rows, 1))}))
    row = 0
    for env in range(ENVS):
        for own in range(first, first + size):
            others = [k for k in range(DEPUTIES) if k != own]
            for name in ("position", "velocity"):
                np.testing.assert_array_equal(getattr(view, name)[row], state[name][env, own])
                np.testing.assert_array_equal(getattr(view, f"others_{name}")[row], state[name][env, others])
                found = getattr(view, f"entity_{name}")("chief")
                np.testing.assert_array_equal(found[row], state[name][env, DEPUTIES])
            for name in ("control", "delta_v", "interventions", "finished"):
                np.testing.assert_array_equal(getattr(view, name)[row], state[name][env, own], err_msg=name)
            assert (view.time[row], view.step[row]) == (state["time"][env], state["step"][env])
            assert view.own_index[row] == own
            assert np.broadcast_to(view.mass, view.num_rows)[row] == MASSES[own]
            assert view.range_to(None)[row] == pytest.approx(np.linalg.norm(state["position"][env, own]))
            assert view.range_to("there")[row] == pytest.approx(np.linalg.norm(state["position"][env, own] - there))
            row += 1
    assert row == view.num_rows == len(view.position) == len(view.others_velocity)


def test_the_team_is_seen_whole(world):
    state = drawn(2)
    team = TeamView(state, world)
    assert team.num_envs == ENVS
    for name in ("position", "velocity"):
        np.testing.assert_array_equal(getattr(team, name), state[name][:, :DEPUTIES], err_msg=name)
    for name in ("control", "delta_v", "step", "finished"):
        np.testing.assert_array_equal(getattr(team, name), state[name], err_msg=name)
    places = state["position"]
    for pair, (i, j) in enumerate(zip(*team.pairs, strict=True)):
        assert i < j
        expected = np.linalg.norm(places[:, i] - places[:, j], axis=-1)
        np.testing.assert_allclose(team.distance[:, pair], expected, rtol=1e-14)
    assert team.distance.shape == (ENVS, 6)
    assert not any(getattr(team, name).flags.writeable for name in ("position", "velocity", "control", "distance"))


def test_a_step_keeps_apart_what_was_asked_for_what_was_desired_and_what_was_held(world):
    group = Group("some", 1, 2, {})
    before, after = (View(drawn(seed), world, group) for seed in (3, 4))
    generator = np.random.default_rng(5)
    action, control, desired = generator.normal(size=(3, 2 * ENVS, 3))
    intervening = np.arange(2 * ENVS) % 2 == 0
    before.writable.step[:] = (0, 1, 7)
    step = Step(before, after, action, control, desired, intervening, STEP)
    for name, expected in (
        ("action", action), ("control", control), ("desired_control", desired), ("intervening", intervening),
    ):  # fmt: skip
        found = getattr(step, name)
        np.testing.assert_array_equal(found, expected, err_msg=name)
        assert not found.flags.writeable
    assert step.first.tolist() == [True, True, False, False, False, False]
    np.testing.assert_allclose(step.total_thrust, np.abs(control).sum(axis=-1))
    masses = np.tile(MASSES[1:3], ENVS)
    np.testing.assert_allclose(step.delta_v, np.abs(control).sum(axis=-1) * STEP / masses)


def test_without_a_sensor_a_range_is_that_to_the_origin():
    own, place = range_inputs(None)
    assert own == OwnArray("position")
    np.testing.assert_array_equal(place, np.zeros(3))
