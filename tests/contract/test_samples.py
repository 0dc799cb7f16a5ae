"""The sample world has what a plugin must cope with."""

from __future__ import annotations

import numpy as np
import pytest

from safe_inspect.dones import DoneStatus
from safe_inspect.dones.motion import CrashDoneFunction, MaxDistanceDoneFunction
from safe_inspect.dones.shared import CollisionDoneFunction, MultiagentSuccessDoneFunction, SetAllDoneFunction
from safe_inspect.dones.success import SuccessfulInspectionDoneFunction
from safe_inspect.environments import BatchedEnvironment
from safe_inspect.platforms.point_sensors import UninspectedPointsSensor
from safe_inspect.rewards.inspection import ObservedPointsReward
from safe_inspect.testing import sample_spec, sample_steps, sample_team_steps, take_rows


def test_the_sample_has_every_phase_of_an_episode() -> None:
    step = sample_steps(rows=256)
    assert step.first.any()
    assert not step.first.all()
    for done in (CrashDoneFunction(), MaxDistanceDoneFunction(), SuccessfulInspectionDoneFunction()):
        ended = done(step)
        assert ended.any(), done
        assert not ended.all(), done
    assert ObservedPointsReward()(step).max() > 0.0
    assert step.intervening.any()
    assert not step.intervening.all()
    lit = step.after.points("chief").lit
    assert lit.any(axis=-1).all()
    assert not lit.all(axis=-1).any()


def test_a_row_is_one_step_of_one_environment() -> None:
    step = sample_steps(rows=100, seed=3)
    np.testing.assert_array_equal(step.after.step, step.before.step + 1)
    np.testing.assert_array_equal(step.after.time, 10.0 * step.after.step)
    np.testing.assert_array_equal(step.after.control, step.control)
    np.testing.assert_allclose(step.after.delta_v - step.before.delta_v, step.delta_v, atol=1e-12)
    np.testing.assert_allclose(step.after.sun_angle - step.before.sun_angle, 0.01027, atol=1e-12)
    assert (step.new_points("chief") >= 0).all()


def test_the_sample_of_a_team_has_what_concerns_several_deputies() -> None:
    step = sample_team_steps(rows=256)
    assert step.after.position.shape == (256, 3, 3)
    for done, endings in (
        (CollisionDoneFunction(), {DoneStatus.RUNNING, DoneStatus.LOSE}),
        (MultiagentSuccessDoneFunction(), {DoneStatus.RUNNING, DoneStatus.WIN}),
        (SetAllDoneFunction(), {DoneStatus.RUNNING, DoneStatus.LOSE, DoneStatus.WIN}),
    ):
        assert set(done(step).tolist()) == endings, done
    ended = step.before.finished != 0
    assert (ended.any(axis=1) & ~ended.all(axis=1)).any()
    assert (step.after.distance == 0.0).any()
    assert ((step.after.distance > 0.0) & (step.after.distance < 10.0)).any()


def test_agents_and_team_see_the_same_steps() -> None:
    step, team = sample_steps(rows=20, deputies=3), sample_team_steps(rows=20)
    assert step.after.num_rows == len(step.control) == 60
    np.testing.assert_array_equal(step.after.position.reshape(20, 3, 3), team.after.position)
    for name, fired in team.fired.items():
        assert fired.shape == (20, 3), name
        assert not (fired & (team.before.finished != 0)).any()
    assert (team.status[team.before.finished != 0] == team.before.finished[team.before.finished != 0]).all()
    ended = np.logical_or.reduce(list(team.fired.values()))
    assert ((team.status != 0) == (ended | (team.before.finished != 0))).all()


def test_one_agent_of_several_by_itself() -> None:
    step = sample_steps(rows=10, deputies=3)
    rows = np.array([7, 2])
    alone = take_rows(step, rows, agent=1)
    assert alone.after.own_index.tolist() == [1, 1]
    np.testing.assert_array_equal(alone.after.position, step.after.position.reshape(10, 3, 3)[rows, 1])
    np.testing.assert_array_equal(alone.control, step.control.reshape(10, 3, 3)[rows, 1])
    centres = step.after.memory("Sensor_UninspectedPoints", "centres").reshape(10, 3, -1, 3)
    np.testing.assert_array_equal(alone.after.memory("Sensor_UninspectedPoints", "centres"), centres[rows, 1])
    together = step.after.reading("Sensor_UninspectedPoints").reshape(10, 3, 3)
    np.testing.assert_array_equal(alone.after.reading("Sensor_UninspectedPoints"), together[rows, 1])


@pytest.mark.parametrize("rows", [1, 5, 64, 3000])
def test_it_has_as_many_rows_as_asked_for(rows: int) -> None:
    step = sample_steps(rows=rows)
    assert step.after.num_rows == step.before.num_rows == len(step.action) == rows
    with pytest.raises(ValueError, match="must be at least 1"):
        sample_steps(rows=0)


def test_the_same_seed_gives_the_same_sample_and_another_seed_another() -> None:
    first, second, other = (sample_steps(UninspectedPointsSensor(), 20, seed) for seed in (5, 5, 6))
    for name, array in first.after.state.arrays.items():
        np.testing.assert_array_equal(array, second.after.state.arrays[name])
    assert not np.array_equal(first.after.position, other.after.position)


def test_taken_rows_are_copies() -> None:
    step = sample_steps(rows=10)
    kept = step.after.position.copy()
    taken = take_rows(step, np.array([4, 4, 1]))
    np.testing.assert_array_equal(taken.after.position, kept[[4, 4, 1]])
    taken.after.writable.position[:] = 0.0
    taken.writable_control[:] = 9.0
    np.testing.assert_array_equal(step.after.position, kept)
    assert not (step.control == 9.0).any()


def test_parts_are_on_the_deputy() -> None:
    further = UninspectedPointsSensor(name="Second")
    names = set(sample_spec(parts=[further]).agents[0].parts)
    assert {"Second", "RateController", "Sensor_EntityPosition", "Sensor_Position", "X Thrust"} <= names
    assert "Second" in sample_steps(rows=4, parts=[further]).after.group.sensors


def test_no_rows_are_reset_without_a_murmur() -> None:
    environment = BatchedEnvironment(sample_spec(), 2)
    environment.reset()
    kept = environment.state.position.copy()
    assert environment.reset(np.array([], dtype=np.int64)).shape == (0, 1, environment.observation_layout.size)
    np.testing.assert_array_equal(environment.state.position, kept)
