"""Done functors for a completed inspection."""

from __future__ import annotations

from typing import ClassVar

from safe_inspect.compiling import njit
from safe_inspect.dones.base import DoneFunction, DoneStatus
from safe_inspect.dynamics.coasting import least_coasting_range
from safe_inspect.simulators import Group, World
from safe_inspect.simulators.row_inputs import RowTerm
from safe_inspect.tasks.inspection.completion import Completion, PassiveSafety, has_reached
from safe_inspect.types import FloatArray


class SuccessfulInspectionDoneFunction(Completion, DoneFunction):
    """Win when all points are inspected, or points of a sufficient total weight; shape (R,)."""

    status: ClassVar[DoneStatus] = DoneStatus.WIN

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the row kernel that decides whether the inspection is complete."""
        return RowTerm(has_reached, self.completion(world))


@njit
def _coasts_on(
    rule: FloatArray, inspected: float, limit: float, position: FloatArray, velocity: FloatArray, table: FloatArray
) -> bool:
    """Return whether the inspection is complete and coasting is safe, or unsafe if rule[2] is 0."""
    if inspected < limit:
        return False
    clear = least_coasting_range(position, velocity, table, rule[0]) >= rule[1]
    return bool(clear == (rule[2] != 0.0))


class SafeSuccessfulInspectionDoneFunction(PassiveSafety, DoneFunction):
    """Win when the inspection is complete and the deputy would not crash if it coasted for an orbit; shape (R,)."""

    status: ClassVar[DoneStatus] = DoneStatus.WIN

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the row kernel that decides whether the inspection is complete and coasting is safe."""
        return RowTerm(_coasts_on, self.inputs(world, 1.0))


class CrashAfterSuccessfulInspectionDoneFunction(PassiveSafety, DoneFunction):
    """Lose when the inspection is complete and the deputy would crash if it coasted for an orbit; shape (R,)."""

    status: ClassVar[DoneStatus] = DoneStatus.LOSE

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the row kernel that decides whether the inspection is complete and coasting is unsafe."""
        return RowTerm(_coasts_on, self.inputs(world, 0.0))
