"""The coordinator: a table of (state, guard) -> (action, state)."""

from __future__ import annotations

import enum
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

C = TypeVar("C")


class Phase(enum.Enum):
    """What a mission does."""

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
#: Most transitions at one time: more would be a circle in the table.
_MOST_TRANSITIONS = 50


@dataclass(frozen=True)
class TableRow(Generic[C]):
    """One row of the table.

    Attributes:
        state: The state that it leaves, or stays in.
        guard: Whether it applies.
        action: What is done then.
        next: The state after it.
    """

    state: Phase
    guard: Callable[[C], bool]
    action: Callable[[C], None]
    next: Phase


class Coordinator(Generic[C]):
    """Goes through a table; of a state's rows the first whose guard holds is taken.

    A row that stays in its state ends the step, so that an action may be tried again at the next.

    Args:
        table: The rows.
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
        """Take transitions until no guard holds, or a row stays in its state."""
        for _ in range(_MOST_TRANSITIONS):
            row = next((row for row in self._rows[self.state] if row.guard(context)), None)
            if row is None:
                return
            before, self.state = self.state, row.next
            row.action(context)
            self._report(before, row.guard.__name__, row.next)
            if row.next is before:
                return
        raise RuntimeError(f"the coordinator's table goes in a circle at state {self.state.value}")
