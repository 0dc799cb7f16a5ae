"""The deputy left, or hit the chief."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from safe_inspect.dones.base import DoneFunction, DoneStatus
from safe_inspect.plugins.plugin import SensorName
from safe_inspect.simulators.view import Step
from safe_inspect.types import BoolArray
from safe_inspect.units import PositiveLength


class MaxDistanceDoneFunction(DoneFunction):
    """Lose when the range to the reference exceeds `max_distance`; shape (R,).

    Attributes:
        max_distance: Largest range [m].
        reference_position_sensor_name: Sensor of the reference's position; the origin of Hill's frame unless given.
    """

    status: ClassVar[DoneStatus] = DoneStatus.LOSE

    max_distance: PositiveLength = 800.0
    reference_position_sensor_name: SensorName | None = None

    def __call__(self, step: Step) -> BoolArray:
        """Return the rows that are out of range, shape (R,)."""
        return np.asarray(step.after.range_to(self.reference_position_sensor_name) > self.max_distance)


class CrashDoneFunction(DoneFunction):
    """Lose when the range to the reference falls below `crash_region_radius`; shape (R,).

    Attributes:
        crash_region_radius: Smallest range [m].
        reference_position_sensor_name: Sensor of the reference's position; the origin of Hill's frame unless given.
        reference_velocity_sensor_name: Sensor of the reference's velocity; the peer's key, without effect on the rule.
    """

    status: ClassVar[DoneStatus] = DoneStatus.LOSE

    crash_region_radius: PositiveLength = 10.0
    reference_position_sensor_name: SensorName | None = None
    reference_velocity_sensor_name: SensorName | None = None

    def __call__(self, step: Step) -> BoolArray:
        """Return the rows that have crashed, shape (R,)."""
        return np.asarray(step.after.range_to(self.reference_position_sensor_name) < self.crash_region_radius)
