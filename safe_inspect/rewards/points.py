"""Rewards for inspected points."""

from __future__ import annotations

import numpy as np

from safe_inspect.compiling import njit
from safe_inspect.dynamics.coasting import least_coasting_range
from safe_inspect.plugins.plugin import PointsName
from safe_inspect.rewards.base import Reward
from safe_inspect.simulators.row_terms.inputs import EnvironmentArray
from safe_inspect.simulators.row_terms.loops import RowTerm
from safe_inspect.simulators.view import Group
from safe_inspect.simulators.world import World
from safe_inspect.tasks.inspection.completion import PassiveSafety, WeightThreshold, completion
from safe_inspect.types import FloatArray


@njit
def _new_points(scale: float, step_before: int, before: int, after: int) -> float:
    return scale * float(after - (0 if step_before == 0 else before))


@njit
def _new_weight(scale: float, step_before: int, before: float, after: float) -> float:
    return scale * (after - (0.0 if step_before == 0 else before))


@njit
def _complete(scale: float, limit: float, inspected: float) -> float:
    return scale if inspected >= limit else 0.0


@njit
def _safely_complete(
    pays: FloatArray,
    orbit: FloatArray,
    limit: float,
    inspected: float,
    position: FloatArray,
    velocity: FloatArray,
    table: FloatArray,
) -> float:
    if inspected < limit:
        return 0.0
    clear = least_coasting_range(position, velocity, table, orbit[0]) >= orbit[1]
    reward: float = pays[0] if clear else pays[1]
    return reward


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
        kernel = _new_weight if self.weighted_priority else _new_points
        return RowTerm(kernel, (self.scale, *before, EnvironmentArray(name)))


class InspectionSuccessReward(Reward):
    """Pay `scale` in a step at the end of which all points, or points of enough weight, are inspected; shape (R,).

    Attributes:
        scale: Reward for success [-].
        inspection_entity_name: Name of the body with the points.
        weight_threshold: Total weight of inspected points that is sufficient, in (0, 1]; None requires all points.
    """

    scale: float = 1.0
    inspection_entity_name: PointsName = "chief"
    weight_threshold: WeightThreshold = None

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the row kernel: scale if the inspection is complete, otherwise 0."""
        return RowTerm(_complete, (self.scale, *completion(world, self.inspection_entity_name, self.weight_threshold)))


class SafeInspectionSuccessReward(PassiveSafety, Reward):
    """Pay in a step at the end of which the inspection is complete, depending on the safety of coasting; shape (R,).

    Attributes:
        scale: Reward if the deputy would stay outside the crash region while coasting for an orbit [-].
        crash_scale: Reward if it would not [-].
        inspection_entity_name: Name of the body with the points.
        weight_threshold: Total weight of inspected points that is sufficient, in (0, 1]; None requires all points.
    """

    scale: float = 1.0
    crash_scale: float = -1.0
    inspection_entity_name: PointsName = "chief"
    weight_threshold: WeightThreshold = None

    def row(self, world: World, group: Group) -> RowTerm:
        """Return the row kernel: scale or crash_scale if the inspection is complete, otherwise 0."""
        n, radius, *motion = self.coasting_inputs(world)
        complete = completion(world, self.inspection_entity_name, self.weight_threshold)
        pays = np.array([self.scale, self.crash_scale])
        return RowTerm(_safely_complete, (pays, np.array([n, radius]), *complete, *motion))
