"""Done functors for time limits."""

from __future__ import annotations

from typing import ClassVar

from pydantic import Field

from safe_inspect.compiling import njit
from safe_inspect.dones.base import DoneFunction, DoneStatus
from safe_inspect.dones.success import has_reached
from safe_inspect.simulators.row_terms.inputs import EnvironmentArray
from safe_inspect.simulators.row_terms.loops import RowTerm
from safe_inspect.simulators.view import Group
from safe_inspect.simulators.world import World
from safe_inspect.units import PositiveDuration

#: Largest number of steps of an episode, because step counters may be 32-bit integers.
MAX_HORIZON = 2**31 - 1


@njit
def _is_over(time: float, limit: float) -> bool:
    return time >= limit


class EpisodeLengthDone(DoneFunction):
    """Draw after `horizon` steps: a truncation, not a termination; shape (R,).

    Attributes:
        horizon: Largest number of steps [-].
    """

    status: ClassVar[DoneStatus] = DoneStatus.DRAW
    truncates: ClassVar[bool] = True

    horizon: int = Field(default=1224, ge=1, le=MAX_HORIZON)

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the row kernel that decides whether the episode has `horizon` steps."""
        return RowTerm(has_reached, (EnvironmentArray("step"), self.horizon))


class TimeoutDoneFunction(DoneFunction):
    """Lose when the time since the reset reaches `max_sim_time`: a termination, not a truncation; shape (R,).

    The end is part of the task, which penalises time.

    Attributes:
        max_sim_time: Largest time [s].
    """

    status: ClassVar[DoneStatus] = DoneStatus.LOSE

    max_sim_time: PositiveDuration = 2000.0

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the row kernel that decides whether the time has elapsed."""
        return RowTerm(_is_over, (EnvironmentArray("time"), self.max_sim_time))
