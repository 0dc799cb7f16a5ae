"""Penalties for crashes and for interventions of the safety filter."""

from __future__ import annotations

from safe_inspect.compiling import njit
from safe_inspect.geometry.distance import is_nearer
from safe_inspect.plugins.plugin import SensorName
from safe_inspect.rewards.base import Reward
from safe_inspect.simulators.row_terms.inputs import Intervening, range_inputs
from safe_inspect.simulators.row_terms.loops import RowTerm
from safe_inspect.simulators.view import Group
from safe_inspect.simulators.world import World
from safe_inspect.types import FloatArray
from safe_inspect.units import PositiveLength


@njit
def _crash(scale: float, radius: float, position: FloatArray, reference: FloatArray) -> float:
    return scale if is_nearer(radius, position, reference) else 0.0


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
        return RowTerm(
            _crash, (self.scale, self.crash_region_radius, *range_inputs(self.reference_position_sensor_name))
        )


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
