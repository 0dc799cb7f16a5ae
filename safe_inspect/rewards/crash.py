"""The price of a crash."""

from __future__ import annotations

import numpy as np

from safe_inspect.plugins.plugin import SensorName
from safe_inspect.rewards.base import Reward
from safe_inspect.simulators.view import Step
from safe_inspect.types import FloatArray
from safe_inspect.units import PositiveLength


class InspectionCrashReward(Reward):
    """Pay `scale` when the range to the reference is below `crash_region_radius`; shape (R,).

    Attributes:
        scale: Reward of a crash, a negative number [-].
        crash_region_radius: Smallest range [m].
        reference_position_sensor_name: Sensor of the reference's position; the origin of Hill's frame unless given.
        reference_velocity_sensor_name: Sensor of the reference's velocity; the peer's key, without effect on the rule.
    """

    scale: float = -1.0
    crash_region_radius: PositiveLength = 10.0
    reference_position_sensor_name: SensorName | None = None
    reference_velocity_sensor_name: SensorName | None = None

    def __call__(self, step: Step) -> FloatArray:
        """Return scale in the rows that have crashed, else 0, shape (R,)."""
        distance = step.after.range_to(self.reference_position_sensor_name)
        return np.where(distance < self.crash_region_radius, self.scale, 0.0)
