"""`EpisodeCollector` collects the figures of the episodes of a batch; `Recorder` records the states of some."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from safe_inspect.config.spec import EnvironmentSpec
from safe_inspect.dones.base import DoneStatus
from safe_inspect.environments.episodes import INFO, TERM, EpisodeAccumulator
from safe_inspect.environments.team import TeamEnvironment
from safe_inspect.environments.transition import TeamTransition
from safe_inspect.evaluation.episodes import AgentEpisodes, Episodes, Trajectory
from safe_inspect.evaluation.measuring import MetricAccumulator
from safe_inspect.metrics.base import BaseMetric
from safe_inspect.tasks.docking.speed_limit import DockingRegion
from safe_inspect.types import AnyArray, FloatArray, IntArray


class EpisodeCollector:
    """Collector of the figures of one episode in every row of a batch.

    Args:
        environment: The batch, after a reset.
        metrics: Metrics that are measured in addition.

    Attributes:
        running: Mask of the rows whose episode is running, shape (N,).
        length: Number of steps of each episode, shape (N,).
        status: How each episode has ended, `DoneStatus`, int8, shape (N,).
    """

    def __init__(self, environment: TeamEnvironment, metrics: Sequence[BaseMetric] = ()) -> None:
        self._environment = environment
        self._sums = EpisodeAccumulator(environment)
        self._metrics, self._measured = metrics, MetricAccumulator(environment, metrics)
        rows, deputies = environment.num_envs, len(environment.agents)
        self.running = np.ones(rows, dtype=np.bool_)
        self.length: IntArray = np.zeros(rows, dtype=np.int64)
        self.status: AnyArray = np.zeros(rows, dtype=np.int8)
        components = environment.simulation.components.values()
        self._labels = {name: label for component in components for name, label in component.figures.items()}
        state = environment.state
        self._initial_states: dict[str, FloatArray] = {
            "position": state.position[:, :deputies].copy(),
            "velocity": state.velocity[:, :deputies].copy(),
        }
        self._initial_states |= environment.simulation.initial_figures()
        self._initial_states |= {name: state[name].copy() for component in components for name in component.recorded}
        self._rows: IntArray = np.arange(rows)
        self._closest = environment.team().distance.min(axis=1) if deputies > 1 else None
        self._info: dict[str, AnyArray] = {}
        self._agents: dict[str, dict[str, AnyArray]] = {name: {} for name in environment.agents}

    def go_on(self, environment: TeamEnvironment, chosen: IntArray) -> None:
        """Continue with some of the current environments, which are stepped as a smaller batch from now on.

        Args:
            environment: The smaller batch, R environments.
            chosen: Their indices among the current environments, shape (R,); they include all whose episode is running.
        """
        self._environment, self._rows = environment, self._rows[chosen]
        self._sums = self._sums.part(environment, chosen)
        self._measured.go_on(environment, chosen)

    def add(self, transition: TeamTransition) -> bool:
        """Add a step and return whether it ends the episodes of some rows."""
        rows, running = self._rows, self.running[self._rows]
        self._sums.add(transition)
        self.length[rows] += running
        if self._closest is not None:
            apart = self._environment.team().distance.min(axis=1)
            self._closest[rows[running]] = np.minimum(self._closest[rows], apart)[running]
        self._measured.add(transition, running)
        ends = running & transition.over
        if not ends.any():
            return False
        ended, whole = np.flatnonzero(ends), rows[ends]
        self.status[whole] = transition.outcome[ended]
        self._keep(self._info, self._sums.info(ended), whole)
        for name, figures in self._sums.agents(ended).items():
            self._keep(self._agents[name], figures, whole)
        self.running = self.running.copy()
        self.running[whole] = False
        return True

    def episodes(self, seed: int, trajectories: Sequence[Trajectory] = ()) -> Episodes:
        """Return the episodes; call this when all rows have ended."""
        agents = {
            name: _agent(figures, self._measured.of_agent(deputy))
            for deputy, (name, figures) in enumerate(self._agents.items())
        }
        return Episodes.of(
            agents,
            seed=seed,
            length=self.length,
            status=self.status,
            info=self._info,
            trajectories=tuple(trajectories),
            closest=self._closest,
            metrics=self._measured.of_team(),
            units={metric.label: metric.unit for metric in self._metrics},
            labels=self._labels,
            initial_states=self._initial_states,
        )

    def _keep(self, kept: dict[str, AnyArray], found: dict[str, AnyArray], rows: IntArray) -> None:
        """Store the figures of some rows that have just ended."""
        for name, values in found.items():
            kept.setdefault(name, np.zeros(len(self.running), values.dtype))[rows] = values


def _agent(figures: dict[str, AnyArray], metrics: dict[str, FloatArray]) -> AgentEpisodes:
    def starting(start: str) -> dict[str, AnyArray]:
        return {name.removeprefix(start): values for name, values in figures.items() if name.startswith(start)}

    return AgentEpisodes(
        returns=figures["return"],
        terms=starting(TERM),
        length=figures["length"],
        status=figures["status"],
        delta_v=figures["delta_v"],
        info=starting(INFO),
        metrics=metrics,
    )


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
    for done in spec.agents[0].dones:
        functor: Any = done.functor
        if isinstance(functor, DockingRegion):
            return float(functor.docking_region_radius)
    return 0.0
