"""Base class of the done functors, and the statuses of an episode."""

from __future__ import annotations

from collections.abc import Mapping
from enum import IntEnum
from typing import Any, ClassVar

import numpy as np

from safe_inspect.simulators import Step, View, World
from safe_inspect.simulators.row_plugin import RowPlugin, batch_call
from safe_inspect.types import ArraySpec, BoolArray


class DoneStatus(IntEnum):
    """Status of an episode."""

    RUNNING = 0
    WIN = 1
    LOSE = 2
    DRAW = 3


class DoneFunction(RowPlugin):
    """Base class of done functors. Called with a `Step`, one returns which rows end, a bool array of shape (R,).

    A subclass defines either ``__call__`` or `row`, a row kernel that returns a bool.

    If several functors fire in one step, lose takes precedence over win, and win over draw.

    Class attributes:
        status: Status of the episodes that it ends.
        truncates: If True, the end is a truncation, such as a time limit: a learner bootstraps from the value of the
            last state.
    """

    kind: ClassVar[str] = "done"
    status: ClassVar[DoneStatus]
    truncates: ClassVar[bool] = False

    @batch_call
    def __call__(self, step: Step) -> BoolArray:
        """Return the rows that end, shape (R,)."""
        return self.call_rows(step)

    def memory(self, world: World) -> Mapping[str, ArraySpec]:
        """Return the arrays that the functor stores between steps, with their shapes for one agent; none by default."""
        return {}

    def remember(self, step: Step, name: str) -> None:
        """Update the stored arrays, ``step.after.memory(name, array)``, in place; called once in every step.

        They must not be written anywhere else. They are initialised again at every reset.
        """

    def memory_key(self, view: View) -> str:
        """Return the name of the functor's stored arrays in a view's memory."""
        return next(name for name, done in view.group.dones.items() if done is self)

    def row_result(self) -> tuple[type[Any], int]:
        """Return the element type (bool) and the number of elements (0, a scalar per row)."""
        return np.bool_, 0
