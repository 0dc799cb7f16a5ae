"""`summarise`: the figures of many episodes as a table and as JSON."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from safe_inspect.dones.base import DoneStatus
from safe_inspect.evaluation.results.episodes import AgentEpisodes, Episodes, Labels
from safe_inspect.evaluation.results.results import FIGURES
from safe_inspect.types import AnyArray


@dataclass(frozen=True)
class Statistic:
    """Mean and spread of one figure.

    Attributes:
        mean: Arithmetic mean.
        standard_deviation: Of the sample, with E - 1; NaN for one episode.
        unit: Unit of both; ``-`` for a pure number.
    """

    mean: float
    standard_deviation: float
    unit: str = "-"

    @classmethod
    def of(cls, values: AnyArray, unit: str = "-") -> Statistic:
        """Return the statistic of some values, shape (E,)."""
        spread = float(np.std(values, ddof=1)) if len(values) > 1 else math.nan
        return cls(float(np.mean(values)), spread, unit)

    def as_dict(self) -> dict[str, Any]:
        """Return plain numbers for JSON; what is not known is None."""
        spread = None if math.isnan(self.standard_deviation) else self.standard_deviation
        return {"mean": self.mean, "standard_deviation": spread, "unit": self.unit}


@dataclass(frozen=True)
class AgentSummary:
    """The figures of one agent of a team.

    Attributes:
        success_rate: Share of the episodes that the agent won [-].
        statuses: Number of episodes by how they ended for the agent, in lower case.
        statistics: Statistics by figure.
    """

    success_rate: float
    statuses: Mapping[str, int]
    statistics: Mapping[str, Statistic]

    def as_dict(self) -> dict[str, Any]:
        """Return plain dictionaries and numbers for JSON."""
        return {
            "success_rate": self.success_rate,
            "statuses": dict(self.statuses),
            "statistics": {name: item.as_dict() for name, item in self.statistics.items()},
        }


@dataclass(frozen=True)
class Summary:
    """The figures of a rollout.

    Attributes:
        episodes: Number of episodes.
        seed: Seed of the run.
        success_rate: Share of the episodes that were won [-].
        statuses: Number of episodes by how they ended, in lower case.
        statistics: Statistics by figure.
        agents: Figures of every agent by its name, where there are several.
    """

    episodes: int
    seed: int
    success_rate: float
    statuses: Mapping[str, int]
    statistics: Mapping[str, Statistic]
    agents: Mapping[str, AgentSummary] = field(default_factory=dict)

    def as_dict(self) -> dict[str, Any]:
        """Return plain dictionaries and numbers for JSON; ``agents`` where there are several."""
        found = {
            "episodes": self.episodes,
            "seed": self.seed,
            "success_rate": self.success_rate,
            "statuses": dict(self.statuses),
            "statistics": {name: item.as_dict() for name, item in self.statistics.items()},
        }
        if self.agents:
            found["agents"] = {name: agent.as_dict() for name, agent in self.agents.items()}
        return found

    def __str__(self) -> str:
        blocks = [self.statistics, *(agent.statistics for agent in self.agents.values())]
        tables = _tables([_rows(block) for block in blocks])
        head = f"{self.episodes} episodes, seed {self.seed}: {_ends(self.success_rate, self.statuses)}"
        lines = [head, *tables[0]]
        for (name, agent), table in zip(self.agents.items(), tables[1:], strict=True):
            lines += [f"{name}: {_ends(agent.success_rate, agent.statuses)}", *table[1:]]
        return "\n".join(lines)


def summarise(episodes: Episodes) -> Summary:
    """Return mean and standard deviation of every figure, and the success rate; for each agent where there are several.

    The figures of a team are those of `Episodes`: its return is the sum over the agents, its delta-v the mean.
    """
    units = {**FIGURES, **dict(episodes.labels.values())}
    several = len(episodes.agents) > 1
    return Summary(
        episodes=len(episodes),
        seed=episodes.seed,
        success_rate=float(np.mean(episodes.success)),
        statuses=_count(episodes.status),
        statistics=_statistics(episodes.figures(), units) | _terms(episodes.terms),
        agents={name: _agent(agent, episodes.labels, units) for name, agent in episodes.agents.items()}
        if several
        else {},
    )


def _agent(agent: AgentEpisodes, labels: Labels, units: Mapping[str, str]) -> AgentSummary:
    statistics = _statistics(agent.figures(labels), units) | _terms(agent.terms)
    return AgentSummary(float(np.mean(agent.success)), _count(agent.status), statistics)


def _statistics(figures: Mapping[str, AnyArray], units: Mapping[str, str]) -> dict[str, Statistic]:
    return {name: Statistic.of(values, units.get(name, "-")) for name, values in figures.items()}


def _terms(terms: Mapping[str, AnyArray]) -> dict[str, Statistic]:
    return {f"reward/{name}": Statistic.of(values) for name, values in terms.items()}


def _count(status: AnyArray) -> dict[str, int]:
    counts = {item.name.lower(): int((status == item).sum()) for item in DoneStatus}
    return {name: count for name, count in counts.items() if count}


def _ends(success_rate: float, statuses: Mapping[str, int]) -> str:
    ends = ", ".join(f"{name} {count}" for name, count in statuses.items())
    return f"success rate {100 * success_rate:.1f} % ({ends})"


def _rows(statistics: Mapping[str, Statistic]) -> list[tuple[str, str, str, str]]:
    rows = [("", "mean", "std", "unit")]
    for name, item in statistics.items():
        spread = "-" if math.isnan(item.standard_deviation) else f"{item.standard_deviation:z.4f}"
        rows.append((name, f"{item.mean:z.4f}", spread, item.unit))
    return rows


def _tables(blocks: Iterable[list[tuple[str, str, str, str]]]) -> list[list[str]]:
    """Return the lines of every block; all have the same columns."""
    blocks = list(blocks)
    widths = [max(len(row[column]) for rows in blocks for row in rows) for column in range(3)]
    return [
        [
            f"  {name:<{widths[0]}}  {mean:>{widths[1]}}  {spread:>{widths[2]}}  {unit}"
            for name, mean, spread, unit in rows
        ]
        for rows in blocks
    ]
