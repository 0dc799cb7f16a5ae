"""Environments that wait while others fly on, in the whole batch or in a smaller one, miss nothing."""

from __future__ import annotations

import numpy as np
import pytest

from safe_inspect.environments import TeamEnvironment, load_spec
from safe_inspect.simulators.resets.initializers import repeated_unit
from safe_inspect.simulators.simulator import ComposedSimulator
from safe_inspect.simulators.state import base_specs
from safe_inspect.simulators.view import FilterResult
from safe_inspect.types import ArraySpec

SPEC = load_spec("safe_inspect/TranslationalInspection-v1", ["horizon=30"])
ROWS, FLYING = 6, np.array([4, 1, 5])


def begun():
    simulation = TeamEnvironment(SPEC, ROWS, seed=3).simulation
    simulation.reset(np.arange(ROWS))
    simulation.running[:] = True
    for _ in range(3):
        simulation.step(controls(ROWS))
    return simulation


def controls(rows):
    return np.random.default_rng(0).uniform(-1.0, 1.0, (ROWS, 1, 3))[:rows]


def test_environments_that_wait_stay_as_they_are():
    one, other = begun(), begun()
    paused = one.pause(np.array([0, 2, 3]))
    assert one.running.tolist() == [False, True, False, False, True, True]
    assert paused.running.all()
    for simulation in (one, other):
        for _ in range(4):
            simulation.step(controls(ROWS))
    one.unpause(paused)
    before = begun().state
    assert one.running.all()
    np.testing.assert_array_equal(one.views[0].position, one.state.position[:, 0])
    for name, array in one.state.arrays.items():
        np.testing.assert_array_equal(array[FLYING], other.state.arrays[name][FLYING], err_msg=name)
        np.testing.assert_array_equal(array[[0, 2, 3]], before.arrays[name][[0, 2, 3]], err_msg=name)


def test_a_part_flies_as_the_whole_does():
    whole, reference = begun(), begun()
    assert whole.divisible
    paused = whole.pause(FLYING)
    part = whole.part(3)
    assert (part.num_envs, part.running.tolist(), len(part.state.step)) == (3, [False] * 3, 3)
    part.enter(whole, paused, FLYING)
    assert part.running.all()
    assert whole.num_envs == ROWS
    for _ in range(5):
        part.step(controls(ROWS)[FLYING])
        reference.step(controls(ROWS))
    for name, array in part.state.arrays.items():
        np.testing.assert_array_equal(array, reference.state.arrays[name][FLYING], err_msg=name)
    part.end(np.array([True, False, True]))
    reference.end(np.isin(np.arange(ROWS), FLYING[[0, 2]]))
    part.leave(whole, FLYING)
    for component, kept in reference.state_dict().items():
        for name, array in kept.items():
            np.testing.assert_array_equal(whole.state_dict()[component][name][FLYING], array[FLYING], err_msg=name)


def test_every_array_of_a_state_is_saved(tmp_path):
    state = begun().state
    state.save(str(tmp_path / "state.npz"))
    with np.load(tmp_path / "state.npz") as saved:
        assert {name.replace("/", ".") for name in state.arrays} == set(saved.files)
        for name, array in state.arrays.items():
            np.testing.assert_array_equal(saved[name.replace("/", ".")], array)


def test_the_constraints_that_refuse_are_named():
    names = ("speed", "sun", "range")
    nothing = np.zeros(3, dtype=np.bool_)
    result = FilterResult(np.zeros((3, 3)), nothing, nothing, nothing, np.array([0, 5, 2]), np.zeros((3, 3)), names)
    assert [result.active_names(row) for row in range(3)] == [(), ("speed", "range"), ("sun",)]


def test_a_vector_is_repeated_with_length_one():
    np.testing.assert_allclose(repeated_unit((0.0, 3.0, -4.0), 2), [[0.0, 0.6, -0.8]] * 2)


def test_a_simulator_of_points_turns_nothing():
    with pytest.raises(ValueError, match="simulates point masses; platforms that turn need another simulator"):
        super(ComposedSimulator, ComposedSimulator()).with_attitude()


def test_arrays_of_a_body_keep_their_type_value_and_constancy() -> None:
    specs = base_specs(3, 2, 4, {"heat": ArraySpec((5,), np.float32, 7.0, constant=True), "x": ArraySpec(())})
    assert specs["heat"] == ArraySpec((3, 5), np.float32, 7.0, constant=True)
    assert specs["x"] == ArraySpec((3,))
    assert specs["control"].shape == (2, 4)
