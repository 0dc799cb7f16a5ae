"""Done functors for the distance from the chief: too far away, or a crash."""

from __future__ import annotations

from typing import ClassVar

from safe_inspect.dones.base import DoneFunction, DoneStatus
from safe_inspect.geometry.distance import is_farther, is_nearer
from safe_inspect.plugins.plugin import SensorName
from safe_inspect.simulators.row_terms.inputs import range_inputs
from safe_inspect.simulators.row_terms.loops import RowTerm
from safe_inspect.simulators.view import Group
from safe_inspect.simulators.world import World
from safe_inspect.tasks.docking.region import is_too_fast
from safe_inspect.tasks.docking.speed_limit import SpeedLimit, own_motion, reference_inputs, region_rule
from safe_inspect.units import PositiveLength


class MaxDistanceDoneFunction(DoneFunction):
    """Lose when the range to the reference exceeds `max_distance`; shape (R,).

    Attributes:
        max_distance: Largest range [m].
        reference_position_sensor_name: Sensor of the reference's position. Default: the origin of Hill's frame.
    """

    status: ClassVar[DoneStatus] = DoneStatus.LOSE

    max_distance: PositiveLength = 800.0
    reference_position_sensor_name: SensorName | None = None

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the row kernel that decides whether the range is too large."""
        return RowTerm(is_farther, (self.max_distance, *range_inputs(self.reference_position_sensor_name)))


class CrashDoneFunction(DoneFunction):
    """Lose when the range to the reference falls below `crash_region_radius`; shape (R,).

    With a `velocity_constraint`, the deputy loses only if it enters the region above the speed limit.

    Attributes:
        crash_region_radius: Smallest range [m].
        reference_position_sensor_name: Sensor of the reference's position. Default: the origin of Hill's frame.
        reference_velocity_sensor_name: Sensor of the reference's velocity; used only with a `velocity_constraint`.
        velocity_constraint: The speed limit; see `SpeedLimit`.
        along_step: Used only with a `velocity_constraint`; see `DockingRegion`.
    """

    status: ClassVar[DoneStatus] = DoneStatus.LOSE

    crash_region_radius: PositiveLength = 10.0
    reference_position_sensor_name: SensorName | None = None
    reference_velocity_sensor_name: SensorName | None = None
    velocity_constraint: SpeedLimit | None = None
    along_step: bool = True

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the row kernel that decides whether the range is too small, or was reached too fast."""
        limit = self.velocity_constraint
        if limit is not None:
            references = self.reference_position_sensor_name, self.reference_velocity_sensor_name
            rule = region_rule(limit, world, self.crash_region_radius, self.along_step)
            return RowTerm(is_too_fast, (rule, *own_motion(before=True), *own_motion(), *reference_inputs(*references)))
        return RowTerm(is_nearer, (self.crash_region_radius, *range_inputs(self.reference_position_sensor_name)))
