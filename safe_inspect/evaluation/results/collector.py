"""`EpisodeCollector`: the figures of one episode in every row of a batch."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from safe_inspect.environments.episodes import INFO, TERM, EpisodeAccumulator
from safe_inspect.environments.team import TeamEnvironment
from safe_inspect.environments.transition import TeamTransition
from safe_inspect.errors import SafeInspectError
from safe_inspect.evaluation.episodes import FIGURES, AgentEpisodes, Episodes
from safe_inspect.evaluation.recorder import Trajectory
from safe_inspect.evaluation.results.measuring import MetricAccumulator
from safe_inspect.metrics.base import BaseMetric
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

    Raises:
        SafeInspectError: A metric has the label of a standard figure, or of one that a component of the task reports.
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
        figures = {*FIGURES, *(label for label, _ in self._labels.values())}
        for metric in metrics:
            if metric.label in figures:
                raise SafeInspectError(f"the label {metric.label!r} is that of a standard figure; choose another label")
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

    def add(self, transition: TeamTransition) -> bool:
        """Add a step and return whether it ends the episodes of some rows."""
        rows, running = self._rows, self.running[self._rows]
        self._sums.add(transition)
        self.length[rows] += running
        if self._closest is not None:
            apart = self._environment.team().distance.min(axis=1)
            self._closest[rows[running]] = np.minimum(self._closest[rows], apart)[running]
        self._measured.add(self._environment, rows, transition, running)
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
            name: AgentEpisodes(
                returns=figures["return"],
                terms=_starting(TERM, figures),
                info=_starting(INFO, figures),
                metrics=self._measured.of_agent(deputy),
                **{key: figures[key] for key in ("length", "status", "delta_v")},
            )
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


def _starting(prefix: str, figures: Mapping[str, AnyArray]) -> dict[str, AnyArray]:
    """Return the figures whose names have a prefix, by the rest of their names."""
    return {name.removeprefix(prefix): values for name, values in figures.items() if name.startswith(prefix)}
