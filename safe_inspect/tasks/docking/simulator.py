"""`CWHSimulator`: deputies about a chief in Clohessy-Wiltshire dynamics, without points or a sun."""

from __future__ import annotations

from collections.abc import Sequence

from safe_inspect.dynamics.base import Dynamics
from safe_inspect.dynamics.clohessy_wiltshire import ClohessyWiltshire
from safe_inspect.simulators.component import Component
from safe_inspect.simulators.simulator import Simulator
from safe_inspect.tasks.docking.monitor import SpeedLimitMonitor
from safe_inspect.units import PositiveAngularRate


class CWHSimulator(Simulator):
    """Simulator of deputies about a chief in Clohessy-Wiltshire dynamics.

    It composes `ClohessyWiltshire` and `SpeedLimitMonitor`.

    Attributes:
        mean_motion: Mean motion of the chief's circular orbit [rad/s].
        speed_limit: The speed limit of infos and tables.
    """

    mean_motion: PositiveAngularRate = 0.001027
    speed_limit: SpeedLimitMonitor = SpeedLimitMonitor()

    def compose(self) -> tuple[Dynamics, Sequence[Component]]:
        """Return the dynamics and the monitor."""
        return ClohessyWiltshire(mean_motion=self.mean_motion), (self.speed_limit,)
