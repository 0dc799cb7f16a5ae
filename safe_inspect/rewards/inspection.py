"""Rewards for inspected points, and penalties for crashes and for interventions of the safety filter."""

from __future__ import annotations

from safe_inspect.compiling import njit
from safe_inspect.geometry.distance import is_nearer
from safe_inspect.plugins.plugin import PointsName, SensorName
from safe_inspect.rewards.base import Reward, paid_if
from safe_inspect.simulators import Group, World
from safe_inspect.simulators.row_terms import EnvironmentArray, Intervening, RowTerm, range_inputs
from safe_inspect.tasks.inspection.completion import Completion, PassiveSafety, has_reached
from safe_inspect.units import PositiveLength


@njit
def _gained(scale: float, step_before: int, before: float, after: float) -> float:
    return scale * float(after - (0 if step_before == 0 else before))


class ObservedPointsReward(Reward):
    """Pay `scale` for every point that the team first inspects in this step, or for its weight; shape (R,).

    Points that are seen at the reset are paid in the episode's first step.

    Attributes:
        scale: Reward for one point, or for the weight of all points [-].
        inspection_entity_name: Name of the body with the points.
        weighted_priority: Pay the total weight of the new points instead of their number.
    """

    scale: float = 0.01
    inspection_entity_name: PointsName = "chief"
    weighted_priority: bool = False

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the row kernel: scale times the number or the weight of new points."""
        name = f"points/{self.inspection_entity_name}/{'team_score' if self.weighted_priority else 'team_count'}"
        before = EnvironmentArray("step", before=True), EnvironmentArray(name, before=True)
        return RowTerm(_gained, (self.scale, *before, EnvironmentArray(name)))


class InspectionSuccessReward(Completion, Reward):
    """Pay `scale` in a step at the end of which all points, or points of enough weight, are inspected; shape (R,).

    Attributes:
        scale: Reward for success [-].
    """

    scale: float = 1.0

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the row kernel: scale if the inspection is complete, otherwise 0."""
        return paid_if(has_reached, self.scale, self.completion(world))


class SafeInspectionSuccessReward(PassiveSafety, Reward):
    """Pay in a step at the end of which the inspection is complete, depending on the safety of coasting; shape (R,).

    Attributes:
        scale: Reward if the deputy would stay outside the crash region while coasting for an orbit [-].
        crash_scale: Reward if it would not [-].
    """

    scale: float = 1.0
    crash_scale: float = -1.0

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the row kernel: scale or crash_scale if the inspection is complete, otherwise 0."""
        return self.verdict(world, self.scale, self.crash_scale)


class InspectionCrashReward(Reward):
    """Pay `scale` when the range to the reference is below `crash_region_radius`; shape (R,).

    Attributes:
        scale: Reward of a crash, a negative number [-].
        crash_region_radius: Smallest range [m].
        reference_position_sensor_name: Sensor of the reference's position. Default: the origin of Hill's frame.
        reference_velocity_sensor_name: Sensor of the reference's velocity; a key of safe-autonomy-sims, without effect.
    """

    scale: float = -1.0
    crash_region_radius: PositiveLength = 10.0
    reference_position_sensor_name: SensorName | None = None
    reference_velocity_sensor_name: SensorName | None = None

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the row kernel: scale if the range is too small, otherwise 0."""
        reach = self.crash_region_radius, *range_inputs(self.reference_position_sensor_name)
        return paid_if(is_nearer, self.scale, reach)


@njit
def _intervention(scale: float, intervening: bool) -> float:
    return scale if intervening else 0.0


class InspectionRTAReward(Reward):
    """Pay `scale` in a step in which a safety filter changed the thrust; shape (R,).

    Attributes:
        scale: Reward for an intervention, a negative number [-].
    """

    scale: float = -0.01

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the row kernel: scale in a step with an intervention, otherwise 0."""
        return RowTerm(_intervention, (self.scale, Intervening()))
