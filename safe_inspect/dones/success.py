"""Done functors for a completed inspection."""

from __future__ import annotations

from typing import ClassVar

from safe_inspect.dones.base import DoneFunction, DoneStatus
from safe_inspect.simulators import Group, World
from safe_inspect.simulators.row_terms import RowTerm
from safe_inspect.tasks.inspection.completion import Completion, PassiveSafety, has_reached


class SuccessfulInspectionDoneFunction(Completion, DoneFunction):
    """Win when all points are inspected, or points of a sufficient total weight; shape (R,)."""

    status: ClassVar[DoneStatus] = DoneStatus.WIN

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the row kernel that decides whether the inspection is complete."""
        return RowTerm(has_reached, self.completion(world))


class SafeSuccessfulInspectionDoneFunction(PassiveSafety, DoneFunction):
    """Win when the inspection is complete and the deputy would not crash if it coasted for an orbit; shape (R,)."""

    status: ClassVar[DoneStatus] = DoneStatus.WIN

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the row kernel that decides whether the inspection is complete and coasting is safe."""
        return self.verdict(world, 1.0, 0.0)


class CrashAfterSuccessfulInspectionDoneFunction(PassiveSafety, DoneFunction):
    """Lose when the inspection is complete and the deputy would crash if it coasted for an orbit; shape (R,)."""

    status: ClassVar[DoneStatus] = DoneStatus.LOSE

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the row kernel that decides whether the inspection is complete and coasting is unsafe."""
        return self.verdict(world, 0.0, 1.0)
