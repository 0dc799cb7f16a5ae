"""Base of the done functors, and the statuses of an episode."""

from __future__ import annotations

from abc import abstractmethod
from enum import IntEnum
from typing import ClassVar

from safe_inspect.plugins.plugin import Plugin
from safe_inspect.simulators.view import Step
from safe_inspect.types import BoolArray


class DoneStatus(IntEnum):
    """How an episode stands."""

    RUNNING = 0
    WIN = 1
    LOSE = 2
    DRAW = 3


class DoneFunction(Plugin):
    """Ends an episode: called with a `Step`, it returns the rows that it ends, shape (R,).

    When several fire in one step, the status is lose before win before draw.

    Class attributes:
        status: What the end means.
        truncates: True: the task would go on (a time limit); a learner bootstraps the value of the last state.
    """

    kind: ClassVar[str] = "done"
    status: ClassVar[DoneStatus]
    truncates: ClassVar[bool] = False

    @abstractmethod
    def __call__(self, step: Step) -> BoolArray:
        """Return the rows that end, shape (R,)."""
