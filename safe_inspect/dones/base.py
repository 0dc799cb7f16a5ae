"""Base of the done functors, and the statuses of an episode."""

from __future__ import annotations

from collections.abc import Mapping
from enum import IntEnum
from typing import Any, ClassVar

import numpy as np

from safe_inspect.simulators.row_terms.plugin import RowPlugin, batch_call
from safe_inspect.simulators.state import ArraySpec
from safe_inspect.simulators.view import Step, View
from safe_inspect.simulators.world import World
from safe_inspect.types import BoolArray


class DoneStatus(IntEnum):
    """How an episode stands."""

    RUNNING = 0
    WIN = 1
    LOSE = 2
    DRAW = 3


class DoneFunction(RowPlugin):
    """Ends an episode: called with a `Step`, it returns the rows that it ends, shape (R,).

    It defines ``__call__``, or `row`, a row kernel that returns a bool.

    When several fire in one step, the status is lose before win before draw.

    Class attributes:
        status: What the end means.
        truncates: True: the task would go on (a time limit); a learner bootstraps the value of the last state.
    """

    kind: ClassVar[str] = "done"
    status: ClassVar[DoneStatus]
    truncates: ClassVar[bool] = False

    @batch_call
    def __call__(self, step: Step) -> BoolArray:
        """Return the rows that end, shape (R,)."""
        return self.call_rows(step)

    def memory(self, world: World) -> Mapping[str, ArraySpec]:
        """Declare the arrays that it remembers, each with its shape for one agent. None by default."""
        return {}

    def remember(self, step: Step, name: str) -> None:
        """Update the remembered arrays, ``step.after.memory(name, array)``, in place; called once for every step.

        Nowhere else may they be written. The arrays are filled anew at every reset.
        """

    def memory_key(self, view: View) -> str:
        """Return the name under which the arrays that it remembers stand in a view's memory."""
        return next(name for name, done in view.group.dones.items() if done is self)

    def row_result(self) -> tuple[type[Any], int]:
        """Return bool, one for each row."""
        return np.bool_, 0
