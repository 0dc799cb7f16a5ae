"""The coordinator: a state machine given by a table of (state, guard) -> (action, state)."""

from __future__ import annotations

import enum
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

C = TypeVar("C")


class Phase(enum.Enum):
    """The state of a mission."""

    CHECKOUT = "CHECKOUT"
    OBSERVE = "OBSERVE"
    CHARACTERISE = "CHARACTERISE"
    PLAN = "PLAN"
    BOUND = "BOUND"
    WAIT = "WAIT"
    TRACK = "TRACK"
    MP_HOLD = "MP_HOLD"
    RETREAT = "RETREAT"
    DONE = "DONE"
    ABORTED = "ABORTED"
    DEPART = "DEPART"


#: States that a mission does not leave.
FINAL = frozenset({Phase.DONE, Phase.ABORTED})
#: Largest number of transitions in a step; more mean that the table has a cycle.
_MOST_TRANSITIONS = 50


@dataclass(frozen=True)
class TableRow(Generic[C]):
    """A row of the table: a transition.

    Attributes:
        state: The state before the transition.
        guard: Function that returns whether the transition applies.
        action: Function that is called if the transition is taken.
        next: The state after the transition, which may be the same one.
    """

    state: Phase
    guard: Callable[[C], bool]
    action: Callable[[C], None]
    next: Phase


class Coordinator(Generic[C]):
    """A state machine that takes, of the rows of its state, the first one whose guard holds.

    A row that does not change the state ends the step, so that its action may be tried again at the next step.

    Args:
        table: The rows of the table.
        report: Called with the state before, the row's guard and the state after.
    """

    def __init__(self, table: Sequence[TableRow[C]], report: Callable[[Phase, str, Phase], None]) -> None:
        self._rows = {state: [row for row in table if row.state is state] for state in Phase}
        self._report = report
        self.state = Phase.CHECKOUT

    @property
    def finished(self) -> bool:
        """Whether the mission is over."""
        return self.state in FINAL

    def step(self, context: C) -> None:
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
