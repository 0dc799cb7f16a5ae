"""Done functors for the place and the motion of a deputy: too far away, a crash, docking, contact with a target."""

from __future__ import annotations

from typing import ClassVar

from safe_inspect.compiling import njit
from safe_inspect.dones.base import DoneFunction, DoneStatus
from safe_inspect.geometry.distance import is_farther, is_nearer
from safe_inspect.plugins.plugin import SensorName
from safe_inspect.simulators import Group, World
from safe_inspect.simulators.row_terms import OwnArray, RowTerm, range_inputs
from safe_inspect.tasks.docking.mating import docking_inputs, is_docked, is_in_contact
from safe_inspect.tasks.docking.shape import ASTROBEE_RADIUS
from safe_inspect.tasks.docking.speed_limit import (
    DOCKED,
    DockingRegion,
    ReferenceSensors,
    SpeedLimit,
    docking_outcome,
    is_too_fast,
    own_motion,
)
from safe_inspect.types import FloatArray
from safe_inspect.units import PositiveLength, PositiveSpeed


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


class CrashDoneFunction(ReferenceSensors, DoneFunction):
    """Lose when the range to the reference falls below `crash_region_radius`; shape (R,).

    With a `velocity_constraint`, the deputy loses only if it enters the region above the speed limit.

    Attributes:
        crash_region_radius: Smallest range [m].
        velocity_constraint: The speed limit; see `SpeedLimit`. The velocity of the reference is used only with it.
        along_step: Used only with a `velocity_constraint`; see `DockingRegion`.
    """

    status: ClassVar[DoneStatus] = DoneStatus.LOSE

    crash_region_radius: PositiveLength = 10.0
    velocity_constraint: SpeedLimit | None = None
    along_step: bool = True

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the row kernel that decides whether the range is too small, or was reached too fast."""
        limit = self.velocity_constraint
        if limit is not None:
            rule = limit.region_rule(world, self.crash_region_radius, self.along_step)
            return RowTerm(is_too_fast, (rule, *own_motion(before=True), *own_motion(), *self.reference_inputs()))
        return RowTerm(is_nearer, (self.crash_region_radius, *range_inputs(self.reference_position_sensor_name)))


@njit
def _has_docked(rule: FloatArray, *motion: FloatArray) -> bool:
    return bool(docking_outcome(rule, *motion) == DOCKED)


class SuccessfulDockingDoneFunction(DockingRegion, DoneFunction):
    """Win when the deputy reaches the docking region within the speed limit; shape (R,)."""

    status: ClassVar[DoneStatus] = DoneStatus.WIN

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the row kernel that decides whether the deputy docks in this step."""
        return RowTerm(_has_docked, (self.rule(world), *self.inputs()))


class DockedDoneFunction(DoneFunction):
    """Win when the chaser is at the mating point of a tumbling target, with its velocity; shape (R,).

    Attributes:
        reach: Largest distance from the mating point [m].
        speed: Largest speed relative to the mating point [m/s].
    """

    status: ClassVar[DoneStatus] = DoneStatus.WIN

    reach: PositiveLength = 0.03
    speed: PositiveSpeed = 0.01

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the row kernel that decides whether the chaser is docked."""
        return RowTerm(is_docked, (self.reach, self.speed, *docking_inputs()))


class ContactDoneFunction(DoneFunction):
    """Lose when the chaser touches the target: the clearance of its centre is below its radius; shape (R,).

    Attributes:
        radius: Radius of the chaser [m].
    """

    status: ClassVar[DoneStatus] = DoneStatus.LOSE

    radius: PositiveLength = ASTROBEE_RADIUS

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the row kernel that decides whether the clearance is below the radius."""
        return RowTerm(is_in_contact, (self.radius, OwnArray("clearance")))
