"""What an episode comes to: sums while it runs, and a report at its end."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from safe_inspect.dones.base import DoneStatus
from safe_inspect.environments.team import TeamEnvironment
from safe_inspect.environments.transition import TeamTransition
from safe_inspect.types import FloatArray, IntArray

#: Values of an episode by name; a path such as ``agents/blue0/delta_v`` stands for nested names.
Report = dict[str, float]


class EpisodeSums:
    """Sums over the running episodes of N environments.

    Args:
        environment: The environments, whose steps are added one by one.
    """

    def __init__(self, environment: TeamEnvironment) -> None:
        self._environment = environment
        deputies = sum(group.size for group in environment.groups)
        shape = (environment.num_envs, deputies)
        self._agents = [name for group in environment.groups for name in group.agents]
        self._slices = [slice(group.first, group.first + group.size) for group in environment.groups]
        self._acting = np.concatenate(
            [np.full(group.size, not group.scripted, dtype=np.bool_) for group in environment.groups]
        )
        safety = environment.spec.team_safety
        self._guarded = any(group.guard is not None for group in environment.groups) or bool(safety and safety.enabled)
        points = environment.simulation.world.points
        self._points = tuple(points)
        self._total = sum(model.num_points for model in points.values())
        self._returns: FloatArray = np.zeros(shape)
        self._lengths: IntArray = np.zeros(shape, dtype=np.int64)
        self._terms: list[dict[str, FloatArray]] = [{} for _ in environment.groups]

    def add(self, transition: TeamTransition) -> None:
        """Add a step of every environment."""
        for part, found, terms in zip(self._slices, transition.groups, self._terms, strict=True):
            self._returns[:, part] += found.reward
            self._lengths[:, part] += found.active
            for name, value in found.terms.items():
                if name in terms:
                    terms[name] += value
                else:
                    terms[name] = value.copy()

    def restart(self, rows: IntArray) -> None:
        """Begin new episodes in some rows."""
        self._returns[rows] = 0.0
        self._lengths[rows] = 0
        for terms in self._terms:
            for value in terms.values():
                value[rows] = 0.0

    def reports(self, rows: Iterable[int], transition: TeamTransition) -> list[Report]:
        """Return what the episodes of some rows have come to; call it before these rows are reset.

        ``return`` and ``reward/NAME`` are sums over the agents that act from outside, ``delta_v`` and
        ``interventions`` means over the deputies; with several agents ``agents/NAME/...`` holds the same for each.
        """
        return [self._report(row, transition) for row in rows]

    def _report(self, row: int, transition: TeamTransition) -> Report:
        state = self._environment.state
        outcome = int(transition.outcome[row])
        report: Report = {
            "return": float(self._returns[row, self._acting].sum()),
            "length": float(self._lengths[row].max()),
            "success_rate": float(outcome == DoneStatus.WIN),
            "lost_rate": float(outcome == DoneStatus.LOSE),
            "delta_v": float(state.delta_v[row].mean()),
        }
        if self._points:
            report["inspected_count"] = float(sum(state.points[name].team_count[row] for name in self._points))
            report["inspected_fraction"] = report["inspected_count"] / max(self._total, 1)
        if self._guarded:
            report["interventions"] = float(state.interventions[row].mean())
        for group, terms in zip(self._environment.groups, self._terms, strict=True):
            for name, value in () if group.scripted else terms.items():
                report[f"reward/{name}"] = report.get(f"reward/{name}", 0.0) + float(value[row].sum())
        if len(self._agents) > 1:
            for index, agent in enumerate(self._agents):
                report |= {f"agents/{agent}/{name}": value for name, value in self._of_agent(row, index).items()}
        return report

    def _of_agent(self, row: int, index: int) -> Report:
        state = self._environment.state
        status = int(state.finished[row, index])
        report: Report = {
            "return": float(self._returns[row, index]),
            "length": float(self._lengths[row, index]),
            "success": float(status == DoneStatus.WIN),
            "lost": float(status == DoneStatus.LOSE),
            "delta_v": float(state.delta_v[row, index]),
        }
        if self._points:
            report["inspected_count"] = float(sum(state.points[name].own_count[row, index] for name in self._points))
        if self._guarded:
            report["interventions"] = float(state.interventions[row, index])
        for part, terms in zip(self._slices, self._terms, strict=True):
            if part.start <= index < part.stop:
                report |= {f"reward/{name}": float(value[row, index - part.start]) for name, value in terms.items()}
        return report
