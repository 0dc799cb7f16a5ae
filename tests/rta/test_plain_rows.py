"""The compiled filters against their own source as plain Python, where an index out of range is an error."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from admissible import admissible

from safe_inspect.rta.backup.safety_filter import BackupFilter
from safe_inspect.rta.constraints import NAMES, RelativeState
from safe_inspect.rta.team.safety_filter import TeamFilter, TeamState

from .limit_flights import BOUNDS, CLOSE, FAR, LOST, NEAR, N, drawn, flown, wanted
from .plain import uncompiled
from .test_recorded_filters import team

ROWS = 8


def equal(found: Any, others: Any) -> None:
    """Hold arrays, and those of tuples, against others."""
    if isinstance(found, tuple):
        for mine, its in zip(found, others, strict=True):
            equal(mine, its)
    elif isinstance(found, np.ndarray):
        np.testing.assert_allclose(found, others, rtol=0.0, atol=1e-9)


def parts(result: Any) -> Any:
    """Return the fields of a result, and of what is returned with it, as tuples."""
    if isinstance(result, tuple):
        return tuple(parts(each) for each in result)
    return tuple(vars(result).values()) if hasattr(result, "active") else result


def same(run: Any, state: Any, *arguments: Any) -> Any:
    """Run a filter in both ways; return what the compiled one gives."""
    found = run(state, *arguments)
    with uncompiled():
        other = run(state, *arguments)
    equal(parts(found), parts(other))
    return found


@pytest.mark.parametrize("where", [CLOSE, NEAR, FAR, LOST], ids=["close", "near", "far", "lost"])
@pytest.mark.parametrize("intervention", ["nearest", "backup"])
def test_the_backup_filter(where: tuple[float, float, float], intervention: Any) -> None:
    state = drawn(1, ROWS, where)
    run = BackupFilter(intervention=intervention)
    result = same(run, state, wanted(state, 0, 1.0))
    assert (np.abs(result.control - wanted(state, 0, 1.0)).max(axis=1) > 1e-6).any()


@pytest.mark.parametrize(
    "run",
    [
        BackupFilter({"m": 60.0, "u_max": 0.6}),
        BackupFilter(names=["sun", "PSM"]),
        BackupFilter(disturbance=BOUNDS),
    ],
    ids=["weak thrusters", "two constraints", "tube"],
)
def test_plans_and_what_is_admissible(run: BackupFilter) -> None:
    state = drawn(3, ROWS, (10.5, 120.0, 0.4))
    thrust = np.random.default_rng(4).uniform(-0.1, 0.1, (ROWS, 3))
    found = run.plans(state), run.plans(state, 0.5), run.recoverable(state), admissible(run, state, thrust)
    with uncompiled():
        others = run.plans(state), run.plans(state, 0.5), run.recoverable(state), admissible(run, state, thrust)
    equal(found, others)
    same(run, state, wanted(state, 0, run.parameters.u_max))


def passes(run: BackupFilter, state: RelativeState) -> Iterator[tuple[RelativeState, Any, Any, Any]]:
    """Fly a filter towards the chief; yield each state, the memory before it, the result and the memory after it."""
    memory = run.memory(len(state))
    for _ in range(4):
        desired = -1.5 * state.position / np.linalg.norm(state.position, axis=1, keepdims=True)
        result, after = same(run.track, state, desired, memory)
        yield state, memory, result, after
        state, memory = flown(state, result.control, 12.0), after


@pytest.mark.parametrize("intervention", ["nearest", "backup"])
def test_the_tube_filter_and_the_plan_that_it_goes_on_with(intervention: Any) -> None:
    """Where the tracked plan is flown, it is remembered a hold later, coasting."""
    followed = 0
    state = drawn(6, ROWS, CLOSE)[: 3 if intervention == "nearest" else ROWS]
    for _, before, result, after in passes(BackupFilter(None, NAMES, intervention, disturbance=BOUNDS), state):
        known = before[:, 9] > 0.0
        rows = known & result.backup
        if intervention == "backup" and rows.any():
            plan = RelativeState(before[rows, :3], before[rows, 3:6], np.zeros(rows.sum()))
            later = flown(plan, before[rows, 6:9], 12.0)
            np.testing.assert_allclose(after[rows, :3], later.position, rtol=0.0, atol=1e-9)
            np.testing.assert_allclose(after[rows, 3:6], later.velocity, rtol=0.0, atol=1e-12)
            np.testing.assert_array_equal(after[rows, 6:9], 0.0)
            followed += int(rows.sum())
        assert (after[known, 9] == 1.0).all()
    assert intervention == "nearest" or followed > 3


@pytest.mark.parametrize("coasting", [False, True])
@pytest.mark.parametrize("disturbed", [False, True])
def test_the_team_filter(disturbed: bool, coasting: bool) -> None:
    run = TeamFilter(disturbance=BOUNDS if disturbed else None)
    state, plan, tracks = team(10, 4, False), None, None
    for step in range(3):
        # A deputy is finished after the first step, and flies out its plan.
        fixed = np.zeros((4, 3), np.bool_)
        fixed[:, 1] = coasting and step > 0
        state = TeamState(state.position, state.velocity, state.sun_angle, fixed)
        towards = state.position.mean(axis=1, keepdims=True) - state.position
        desired = 1.5 * towards / np.linalg.norm(towards, axis=-1, keepdims=True)
        result = same(run, state, desired, plan, tracks)
        plan, tracks = result.plan, result.tracks
        rows = RelativeState(state.position.reshape(-1, 3), state.velocity.reshape(-1, 3), np.zeros(12))
        after = flown(rows, result.control.reshape(-1, 3), 12.0)
        shape = state.position.shape
        state = TeamState(
            after.position.reshape(shape), after.velocity.reshape(shape), state.sun_angle + 10.0 * N, fixed
        )


@pytest.mark.parametrize("names", [("chief_collision", "deputy_PSM"), ("r_max", "y_vel"), ("PSM", "deputy_collision")])
def test_parts_of_the_constraints_of_a_team(names: tuple[str, ...]) -> None:
    run, state = TeamFilter(names=names), team(12, 4, True)
    desired = np.random.default_rng(5).uniform(-1.0, 1.0, state.position.shape)
    same(run, state, desired)
    found = run.plans(state), (admissible(run, state, 0.1 * desired), run.recoverable(state))
    with uncompiled():
        others = run.plans(state), (admissible(run, state, 0.1 * desired), run.recoverable(state))
    equal(found, others)
