"""The time limit."""

from __future__ import annotations

from typing import ClassVar

from pydantic import Field

from safe_inspect.dones.base import DoneFunction, DoneStatus
from safe_inspect.simulators.view import Step
from safe_inspect.types import BoolArray


class EpisodeLengthDone(DoneFunction):
    """Draw after `horizon` steps: a truncation, not a termination; shape (R,).

    Attributes:
        horizon: Largest number of steps [-].
    """

    status: ClassVar[DoneStatus] = DoneStatus.DRAW
    truncates: ClassVar[bool] = True

    horizon: int = Field(default=1224, ge=1)

    def __call__(self, step: Step) -> BoolArray:
        """Return the rows that have run for `horizon` steps, shape (R,)."""
        return step.after.step >= self.horizon
