"""Penalty for interventions of the safety filter."""

from __future__ import annotations

from safe_inspect.compiling import njit
from safe_inspect.rewards.base import Reward
from safe_inspect.simulators.row_terms.inputs import Intervening
from safe_inspect.simulators.row_terms.loops import RowTerm
from safe_inspect.simulators.view import Group
from safe_inspect.simulators.world import World


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
