from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from safe_inspect.rendezvous.coordination import guards
from safe_inspect.rendezvous.coordination.context import Phase
from safe_inspect.rendezvous.coordination.pilot import FINAL, TABLE, Coordinator, TableRow

#: States of a chaser that leaves the target.
_LEAVING = {Phase.RETREAT, Phase.DEPART}


def test_every_state_has_a_way_out_and_the_final_ones_none() -> None:
    for state in Phase:
        leaves = [row for row in TABLE if row.state is state and row.next is not state]
        assert bool(leaves) == (state not in FINAL)


def test_every_state_is_reached_and_every_state_leads_to_an_end() -> None:
    reached, ends = {Phase.CHECKOUT}, set(FINAL)
    for _ in Phase:
        reached |= {row.next for row in TABLE if row.state in reached}
        ends |= {row.state for row in TABLE if row.next in ends}
    assert reached == set(Phase) == ends


def test_a_mission_out_of_time_ends_in_every_state() -> None:
    far = {Phase.CHECKOUT, Phase.OBSERVE, Phase.CHARACTERISE}
    for state in set(Phase) - FINAL - _LEAVING:
        first = next(row for row in TABLE if row.state is state)
        assert first.guard is guards.out_of_time
        assert first.next is (Phase.DEPART if state in far else Phase.RETREAT)
    assert guards.retreat_too_long in [row.guard for row in TABLE if row.state is Phase.RETREAT]


def test_a_fault_leads_to_a_retreat_from_every_state():
    for state in set(Phase) - FINAL - _LEAVING:
        assert {row.guard: row.next for row in TABLE if row.state is state}[guards.fault] is Phase.RETREAT


def test_a_mission_that_is_given_up_has_departed():
    assert {row.state for row in TABLE if row.next is Phase.ABORTED} == {Phase.DEPART}


def _row(state: Phase, guard: str, following: Phase, action: str = "") -> TableRow[dict[str, int]]:
    def holds(context: dict[str, int]) -> bool:
        return bool(context.get(guard))

    def act(context: dict[str, int]) -> None:
        context[action] = context.get(action, 0) + 1

    holds.__name__ = guard
    return TableRow(state, holds, act, following)


def test_the_first_row_that_holds_is_taken_and_a_row_that_stays_ends_the_step() -> None:
    seen: list[tuple[Phase, str, Phase]] = []
    table = [
        _row(Phase.CHECKOUT, "a", Phase.OBSERVE, "went"),
        _row(Phase.CHECKOUT, "b", Phase.ABORTED),
        _row(Phase.OBSERVE, "c", Phase.OBSERVE, "tried"),
        _row(Phase.OBSERVE, "d", Phase.DONE),
    ]
    coordinator = Coordinator(table, lambda *step: seen.append(step))
    coordinator.step({})
    assert coordinator.state is Phase.CHECKOUT
    context = {"a": 1, "b": 1, "c": 1, "d": 1}
    coordinator.step(context)
    assert seen == [
        (Phase.CHECKOUT, "a", Phase.OBSERVE),
        (Phase.OBSERVE, "c", Phase.OBSERVE),
    ]
    assert context["went"] == context["tried"] == 1
    coordinator.step({"d": 1})
    assert coordinator.finished


def test_a_circle_in_the_table_is_an_error() -> None:
    table = [
        _row(Phase.CHECKOUT, "a", Phase.OBSERVE),
        _row(Phase.OBSERVE, "a", Phase.CHECKOUT),
    ]
    with pytest.raises(RuntimeError, match="cycle"):
        Coordinator(table, lambda *step: None).step({"a": 1})


@pytest.mark.parametrize("phase", list(Phase))
def test_a_changed_motion_ends_what_was_decided_on_it(phase):
    mission = SimpleNamespace(imu_silence=0.2, camera_silence=5.0, update_period=1.0)
    estimate = SimpleNamespace(
        translation=np.zeros(6), relative=np.array([0.0, -2.9, 0.0, 0.0, 0.0, 0.0]),
        target=SimpleNamespace(orientation=np.array([0.0, 0.0, 0.0, 1.0])), alarm="changed",
        updated=94.0,
    )  # fmt: skip
    context = SimpleNamespace(
        config=SimpleNamespace(mission=mission), estimate=estimate, time=100.0, imu_time=100.0, camera_time=100.0,
        phase=phase, clearance=lambda: 1.0, limits=SimpleNamespace(keep_in=np.array([0.8, 3.0, 0.8])),
    )  # fmt: skip
    decided = phase in (Phase.PLAN, Phase.WAIT, Phase.TRACK, Phase.MP_HOLD)
    assert guards.fault_name(context) == ("changed" if decided else "")
    context.estimate.alarm = ""
    assert guards.fault_name(context) == ""
    context.estimate.updated = 93.0
    assert guards.fault_name(context) == "target not seen"
    context.estimate.updated, context.camera_time = 94.0, 94.9
    assert guards.fault_name(context) == "camera silent"
    context.camera_time, context.estimate.relative = 100.0, np.array([0.81, -1.5, 0.0, 0.0, 0.0, 0.0])
    assert guards.fault_name(context) == "outside of the keep-in box"
