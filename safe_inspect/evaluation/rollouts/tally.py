"""`Tally`: adds up the figures of the episodes that a batch flies, from a fresh reset to the end of each row."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from safe_inspect.environments.team import TeamEnvironment
from safe_inspect.environments.transition import TeamTransition
from safe_inspect.evaluation.rollouts.gauges import Gauges
from safe_inspect.metrics.base import BaseMetric
from safe_inspect.types import AnyArray, BoolArray, FloatArray

#: Begins the names of the reward terms, and of the metrics, among the figures of an agent.
TERM, METRIC = "reward/", "metric/"


class Tally:
    """The figures of one episode in every row of a batch.

    Args:
        environment: The batch, freshly reset.
        metrics: What is measured besides.

    Attributes:
        running: Rows whose episode runs, shape (N,).
        whole: Figures of the team by their names in `Episodes`, each of shape (N,).
        begins: State in which the episodes begin, by the names in `Episodes.begins`.
        agents: For every agent its figures by their names in `AgentEpisodes`, ``reward/NAME`` for a term, shape (N,).
    """

    def __init__(self, environment: TeamEnvironment, metrics: Sequence[BaseMetric] = ()) -> None:
        self._environment = environment
        self._gauges = Gauges(environment, metrics)
        rows, deputies = environment.num_envs, len(environment.agents)
        self._points = tuple(environment.simulation.world.offers.world.get("points", {}).values())
        self.running = np.ones(rows, dtype=np.bool_)
        self.whole: dict[str, AnyArray] = {
            "length": np.zeros(rows, dtype=np.int64),
            "status": np.zeros(rows, dtype=np.int8),
            "inspected_fraction": np.zeros(rows),
        }
        state = environment.state
        self.begins: dict[str, FloatArray] = {
            "position": state.position[:, :deputies].copy(),
            "velocity": state.velocity[:, :deputies].copy(),
            "sun_angle": state.arrays.get("sun_angle", np.zeros(rows)).copy(),
        }
        if deputies > 1:
            self.whole["closest"] = environment.team().distance.min(axis=1)
        self._ends: dict[str, AnyArray] = {
            "returns": np.zeros((rows, deputies)),
            "length": np.zeros((rows, deputies), dtype=np.int64),
            "status": np.zeros((rows, deputies), dtype=np.int8),
            "inspected": np.zeros((rows, deputies), dtype=np.int64),
            "delta_v": np.zeros((rows, deputies)),
        }
        self._terms: list[dict[str, FloatArray]] = [
            {named.name: np.zeros((rows, group.size)) for named in group.agent.rewards} for group in environment.groups
        ]

    @property
    def agents(self) -> dict[str, dict[str, AnyArray]]:
        """The figures of every agent."""
        told = {}
        for group, terms in zip(self._environment.groups, self._terms, strict=True):
            for place, name in enumerate(group.agents):
                told[name] = {figure: array[:, group.first + place] for figure, array in self._ends.items()}
                told[name] |= {f"{TERM}{term}": value[:, place] for term, value in terms.items()}
                own = self._gauges.of_agent(group.first + place)
                told[name] |= {f"{METRIC}{label}": value for label, value in own.items()}
        return told

    @property
    def metrics(self) -> dict[str, FloatArray]:
        """The metrics of the environments by label, those of the agents taken together, each of shape (N,)."""
        return self._gauges.of_team()

    def add(self, transition: TeamTransition) -> bool:
        """Add a step; return whether the episodes of some rows have ended with it."""
        running, column = self.running, self.running[:, None]
        returns, lengths = self._ends["returns"], self._ends["length"]
        self.whole["length"] += running
        for group, found, terms in zip(self._environment.groups, transition.groups, self._terms, strict=True):
            mine = slice(group.first, group.first + group.size)
            np.add(returns[:, mine], found.reward, out=returns[:, mine], where=column)
            lengths[:, mine] += found.active & column
            for name, value in found.terms.items():
                np.add(terms[name], value, out=terms[name], where=column)
        if "closest" in self.whole:
            apart = self._environment.team().distance.min(axis=1)
            np.minimum(self.whole["closest"], apart, out=self.whole["closest"], where=running)
        self._gauges.add(transition, running)
        ends = running & transition.over
        if not ends.any():
            return False
        self._note(ends, transition)
        self.running = running & ~ends
        return True

    def _note(self, ends: BoolArray, transition: TeamTransition) -> None:
        """Note how the episodes of some rows stand at their end."""
        state = self._environment.state
        self.whole["status"][ends] = transition.outcome[ends]
        self._ends["status"][ends] = state.finished[ends]
        self._ends["delta_v"][ends] = state.delta_v[ends]
        total = sum(model.num_points for model in self._points)
        count = np.zeros(len(ends))
        for model in self._points:
            points = state.points[model.entity]
            count += points.team_count
            self._ends["inspected"][ends] += points.own_count[ends]
        if total:
            self.whole["inspected_fraction"][ends] = count[ends] / total
