"""Done functor for successful docking."""

from __future__ import annotations

from typing import ClassVar

from safe_inspect.compiling import njit
from safe_inspect.dones.base import DoneFunction, DoneStatus
from safe_inspect.simulators.row_terms.loops import RowTerm
from safe_inspect.simulators.view import Group
from safe_inspect.simulators.world import World
from safe_inspect.tasks.docking.region import DOCKED, docking_outcome
from safe_inspect.tasks.docking.speed_limit import DockingRegion
from safe_inspect.types import FloatArray


@njit
def _has_docked(
    rule: FloatArray,
    position_before: FloatArray,
    velocity_before: FloatArray,
    position: FloatArray,
    velocity: FloatArray,
    reference: FloatArray,
    reference_velocity: FloatArray,
) -> bool:
    outcome = docking_outcome(rule, position_before, velocity_before, position, velocity, reference, reference_velocity)
    return bool(outcome == DOCKED)


class SuccessfulDockingDoneFunction(DockingRegion, DoneFunction):
    """Win when the deputy reaches the docking region within the speed limit; shape (R,)."""

    status: ClassVar[DoneStatus] = DoneStatus.WIN

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the row kernel that decides whether the deputy docks in this step."""
        return RowTerm(_has_docked, (self.rule(world), *self.inputs()))
