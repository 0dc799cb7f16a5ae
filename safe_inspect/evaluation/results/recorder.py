"""`Recorder`: the states of some episodes of a batch, step by step, as `Trajectory`."""

from __future__ import annotations

from typing import Any

import numpy as np

from safe_inspect.config.spec import EnvironmentSpec
from safe_inspect.dones.base import DoneStatus
from safe_inspect.environments.team import TeamEnvironment
from safe_inspect.evaluation.episodes import Trajectory
from safe_inspect.tasks.docking.speed_limit import DockingRegion
from safe_inspect.types import AnyArray, IntArray

_KEPT = ("time", "position", "velocity", "control", "delta_v")


class Recorder:
    """Recorder of the first rows of a batch, from a reset on.

    Args:
        environment: The batch.
        rows: Number of recorded rows.
        first_slot: Global index of the environment slot of the first row.
    """

    def __init__(self, environment: TeamEnvironment, rows: int, first_slot: int) -> None:
        self._environment = environment
        self._rows = rows
        self._slot = first_slot
        components = environment.simulation.components.values()
        self._of_deputies = ("position", "velocity", *environment.simulation.attitude)
        of_components = (name for component in components for name in component.recorded)
        self._recorded = (*environment.simulation.attitude, *of_components)
        self._states: dict[str, list[AnyArray]] = {name: [] for name in (*_KEPT, *self._recorded)}
        points = environment.simulation.world.offers.world.get("points", {})
        self._body = next(iter(points), None)
        self._points = points[self._body].points if self._body is not None else np.zeros((0, 3))
        self._inspected_at = np.full((rows, len(self._points)), np.inf)
        self._inspector = np.full((rows, len(self._points)), -1, dtype=np.int64)
        self.keep()

    def keep(self) -> None:
        """Record the current state; `trajectories` cuts states after the end of an episode."""
        if not self._rows:
            return
        state = self._environment.state
        deputies = self._environment.simulation.world.num_deputies
        for name, kept in self._states.items():
            array = state[name][: self._rows]
            kept.append((array[:, :deputies] if name in self._of_deputies else array).copy())
        if self._body is not None:
            inspector = state.points[self._body].inspector[: self._rows]
            now = np.broadcast_to(state.time[: self._rows, None], inspector.shape)
            fresh = (inspector >= 0) & np.isinf(self._inspected_at)
            self._inspected_at[fresh] = now[fresh]
            self._inspector[fresh] = inspector[fresh]

    def trajectories(self, length: IntArray, status: AnyArray) -> list[Trajectory]:
        """Return the recorded episodes, each cut to its own number of steps."""
        if not self._rows:
            return []
        whole = {name: np.stack(kept, axis=1) for name, kept in self._states.items()}
        made = []
        for row in range(self._rows):
            states = {name: array[row, : length[row] + 1] for name, array in whole.items()}
            seen = self._inspected_at[row] <= states["time"][-1]  # not the points that it passed after the end
            made.append(
                Trajectory(
                    **{name: states[name] for name in ("time", "position", "velocity", "delta_v")},
                    control=states["control"][1:],  # the thrust held over the step that led there
                    arrays={name: states[name] for name in self._recorded},
                    points=self._points,
                    inspected_at=np.where(seen, self._inspected_at[row], np.inf),
                    inspector=np.where(seen, self._inspector[row], -1),
                    status=DoneStatus(int(status[row])),
                    slot=self._slot + row,
                    deputies=self._environment.simulation.world.platforms,
                    mean_motion=self._environment.simulation.world.offers.world.get("mean_motion", 0.0),
                    in_body_axes=self._environment.simulation.turns_thrust,
                    camera=self._environment.simulation.world.offers.world.get("camera"),
                    docking_radius=_docking_radius(self._environment.spec),
                )
            )
        return made


def _docking_radius(spec: EnvironmentSpec) -> float:
    """Return the radius of the region that the first agent must reach [m]; 0 in a task without docking."""
    regions: list[Any] = [done.functor for done in spec.agents[0].dones if isinstance(done.functor, DockingRegion)]
    return float(regions[0].docking_region_radius) if regions else 0.0
