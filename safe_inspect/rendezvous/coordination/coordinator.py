"""The coordinator: a state machine given by a table of (state, guard) -> (action, state)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from safe_inspect.rendezvous.coordination import actions, guards
from safe_inspect.rendezvous.coordination.context import MissionContext, Phase

#: States that a mission does not leave.
FINAL = frozenset({Phase.DONE, Phase.ABORTED})
#: Largest number of transitions in a step; more mean that the table has a cycle.
_MOST_TRANSITIONS = 50
#: States in which the chaser may be near the target, so that a mission that is out of time retreats.
_NEAR = (Phase.PLAN, Phase.BOUND, Phase.WAIT, Phase.TRACK, Phase.MP_HOLD)
#: States in which a fault leads to a retreat. The rows of the faults come before the other rows of these states.
_ACTIVE = (Phase.CHECKOUT, Phase.OBSERVE, Phase.CHARACTERISE, *_NEAR)


@dataclass(frozen=True)
class TableRow:
    """A row of the table: a transition.

    Attributes:
        state: The state before the transition.
        guard: Function that returns whether the transition applies.
        action: Function that is called if the transition is taken.
        next: The state after the transition, which may be the same one.
    """

    state: Phase
    guard: Callable[[MissionContext], bool]
    action: Callable[[MissionContext], None]
    next: Phase


class Coordinator:
    """A state machine that takes, of the rows of its state, the first one whose guard holds.

    A row that does not change the state ends the step, so that its action may be tried again at the next step.

    Args:
        table: The rows of the table.
        report: Called with the state before, the row's guard and the state after.
    """

    def __init__(self, table: Sequence[TableRow], report: Callable[[Phase, str, Phase], None]) -> None:
        self._rows = {state: [row for row in table if row.state is state] for state in Phase}
        self._report = report
        self.state = Phase.CHECKOUT

    @property
    def finished(self) -> bool:
        """Whether the mission is over."""
        return self.state in FINAL

    def step(self, context: MissionContext) -> None:
        """Take transitions until no guard holds or a row does not change the state."""
        for _ in range(_MOST_TRANSITIONS):
            row = next((row for row in self._rows[self.state] if row.guard(context)), None)
            if row is None:
                return
            before, self.state = self.state, row.next
            row.action(context)
            self._report(before, row.guard.__name__, row.next)
            if row.next is before:
                return
        raise RuntimeError(f"the coordinator's table has a cycle at state {self.state.value}")


TABLE: tuple[TableRow, ...] = (
    *(
        TableRow(state, guards.out_of_time, actions.give_up, Phase.DEPART)
        for state in (Phase.CHECKOUT, Phase.OBSERVE, Phase.CHARACTERISE)
    ),
    *(TableRow(state, guards.out_of_time, actions.retreat, Phase.RETREAT) for state in _NEAR),
    *(TableRow(state, guards.fault, actions.retreat, Phase.RETREAT) for state in _ACTIVE),
    TableRow(Phase.CHECKOUT, guards.checked_out, actions.start_observing, Phase.OBSERVE),
    TableRow(Phase.CHECKOUT, guards.checkout_too_long, actions.give_up, Phase.DEPART),
    TableRow(Phase.OBSERVE, guards.observed, actions.nothing, Phase.CHARACTERISE),
    TableRow(Phase.OBSERVE, guards.observed_at_most, actions.end_observation_coarse, Phase.CHARACTERISE),
    TableRow(Phase.CHARACTERISE, guards.characterised, actions.make_plan, Phase.PLAN),
    TableRow(Phase.CHARACTERISE, guards.may_observe_again, actions.observe_again, Phase.OBSERVE),
    TableRow(Phase.CHARACTERISE, guards.always, actions.retreat, Phase.RETREAT),
    TableRow(Phase.PLAN, guards.plan_found, actions.make_tube, Phase.BOUND),
    TableRow(Phase.PLAN, guards.plans_exhausted, actions.retreat, Phase.RETREAT),
    TableRow(Phase.PLAN, guards.estimate_is_new, actions.make_plan, Phase.PLAN),
    TableRow(Phase.BOUND, guards.tube_fits, actions.nothing, Phase.WAIT),
    TableRow(Phase.BOUND, guards.may_bound_again, actions.make_plan_again, Phase.PLAN),
    TableRow(Phase.BOUND, guards.may_observe_again, actions.observe_again, Phase.OBSERVE),
    TableRow(Phase.BOUND, guards.always, actions.retreat, Phase.RETREAT),
    TableRow(Phase.WAIT, guards.start_is_planned, actions.start_approach, Phase.TRACK),
    TableRow(Phase.WAIT, guards.start_reached, actions.make_plan_now, Phase.PLAN),
    TableRow(Phase.TRACK, guards.arrived, actions.nothing, Phase.MP_HOLD),
    TableRow(Phase.TRACK, guards.may_replan, actions.replan_on_the_way, Phase.PLAN),
    TableRow(Phase.TRACK, guards.off_plan, actions.retreat, Phase.RETREAT),
    TableRow(Phase.MP_HOLD, guards.settled, actions.finish, Phase.DONE),
    TableRow(Phase.MP_HOLD, guards.hold_too_long, actions.retreat, Phase.RETREAT),
    TableRow(Phase.RETREAT, guards.may_return, actions.return_to_observe, Phase.OBSERVE),
    TableRow(Phase.RETREAT, guards.escaped, actions.depart, Phase.DEPART),
    TableRow(Phase.RETREAT, guards.unseen_outside, actions.depart, Phase.DEPART),
    TableRow(Phase.RETREAT, guards.retreat_too_long, actions.depart, Phase.DEPART),
    TableRow(Phase.DEPART, guards.may_resume, actions.resume_observing, Phase.OBSERVE),
    TableRow(Phase.DEPART, guards.departed, actions.nothing, Phase.ABORTED),
)
