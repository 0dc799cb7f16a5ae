"""Rewards for inspected points."""

from __future__ import annotations

import numpy as np

from safe_inspect.plugins.plugin import PointsName
from safe_inspect.rewards.base import Reward
from safe_inspect.simulators.view import Step
from safe_inspect.types import FloatArray


class ObservedPointsReward(Reward):
    """Pay `scale` for every point that the team first inspects in this step; shape (R,).

    Points seen at the reset are paid in the episode's first step.

    Attributes:
        scale: Reward of one point [-].
        inspection_entity_name: The body that carries the points.
    """

    scale: float = 0.01
    inspection_entity_name: PointsName = "chief"

    def __call__(self, step: Step) -> FloatArray:
        """Return scale times the number of new points, shape (R,)."""
        return np.asarray(self.scale * step.new_points(self.inspection_entity_name))


class InspectionSuccessReward(Reward):
    """Pay `scale` in a step at whose end every point is inspected; shape (R,).

    Attributes:
        scale: Reward of success [-].
        inspection_entity_name: The body that carries the points.
    """

    scale: float = 1.0
    inspection_entity_name: PointsName = "chief"

    def __call__(self, step: Step) -> FloatArray:
        """Return scale where all points are inspected, else 0, shape (R,)."""
        points = step.after.points(self.inspection_entity_name)
        return np.where(points.count >= points.num_points, self.scale, 0.0)
