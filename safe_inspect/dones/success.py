"""Done functors for a completed inspection."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from safe_inspect.compiling import njit
from safe_inspect.dones.base import DoneFunction, DoneStatus
from safe_inspect.dynamics.coasting import least_coasting_range
from safe_inspect.plugins.plugin import PointsName
from safe_inspect.simulators.row_terms.loops import RowTerm
from safe_inspect.simulators.view import Group
from safe_inspect.simulators.world import World
from safe_inspect.tasks.inspection.completion import PassiveSafety, WeightThreshold, completion
from safe_inspect.types import FloatArray


@njit
def has_reached(count: int, limit: int) -> bool:
    """Return whether a count is at least a limit."""
    return count >= limit


@njit
def _is_complete(limit: float, inspected: float) -> bool:
    return inspected >= limit


class SuccessfulInspectionDoneFunction(DoneFunction):
    """Win when all points are inspected, or points of a sufficient total weight; shape (R,).

    Attributes:
        inspection_entity_name: Name of the body with the points.
        weight_threshold: Total weight of inspected points that is sufficient, in (0, 1]; None requires all points.
    """

    status: ClassVar[DoneStatus] = DoneStatus.WIN

    inspection_entity_name: PointsName = "chief"
    weight_threshold: WeightThreshold = None

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the row kernel that decides whether the inspection is complete."""
        return RowTerm(_is_complete, completion(world, self.inspection_entity_name, self.weight_threshold))


@njit
def _coasts_on(
    orbit: FloatArray,
    limit: float,
    inspected: float,
    position: FloatArray,
    velocity: FloatArray,
    table: FloatArray,
) -> bool:
    """Return whether the inspection is complete and coasting is safe, or unsafe if orbit[2] is 0."""
    if inspected < limit:
        return False
    clear = least_coasting_range(position, velocity, table, orbit[0]) >= orbit[1]
    return bool(clear == (orbit[2] != 0.0))


class SafeSuccessfulInspectionDoneFunction(PassiveSafety, DoneFunction):
    """Win when the inspection is complete and the deputy would not crash if it coasted for an orbit; shape (R,).

    Attributes:
        inspection_entity_name: Name of the body with the points.
        weight_threshold: Total weight of inspected points that is sufficient, in (0, 1]; None requires all points.
    """

    status: ClassVar[DoneStatus] = DoneStatus.WIN

    inspection_entity_name: PointsName = "chief"
    weight_threshold: WeightThreshold = None

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the row kernel that decides whether the inspection is complete and coasting is safe."""
        return _coasting_term(self, world, safe=True)


class CrashAfterSuccessfulInspectionDoneFunction(PassiveSafety, DoneFunction):
    """Lose when the inspection is complete and the deputy would crash if it coasted for an orbit; shape (R,).

    Attributes:
        inspection_entity_name: Name of the body with the points.
        weight_threshold: Total weight of inspected points that is sufficient, in (0, 1]; None requires all points.
    """

    status: ClassVar[DoneStatus] = DoneStatus.LOSE

    inspection_entity_name: PointsName = "chief"
    weight_threshold: WeightThreshold = None

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the row kernel that decides whether the inspection is complete and coasting is unsafe."""
        return _coasting_term(self, world, safe=False)


def _coasting_term(
    done: SafeSuccessfulInspectionDoneFunction | CrashAfterSuccessfulInspectionDoneFunction, world: World, safe: bool
) -> RowTerm:
    n, radius, *motion = done.coasting_inputs(world)
    complete = completion(world, done.inspection_entity_name, done.weight_threshold)
    return RowTerm(_coasts_on, (np.array([n, radius, float(safe)]), *complete, *motion))
