"""`summarise`: the figures of many episodes as a table and as JSON."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from safe_inspect.dones.base import DoneStatus
from safe_inspect.evaluation.trajectory import Episodes
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


@dataclass(frozen=True)
class Summary:
    """The figures of a rollout.

    Attributes:
        episodes: Number of episodes.
        seed: Seed of the run.
        success_rate: Share of the episodes that were won [-].
        statuses: Number of episodes by how they ended, in lower case.
        statistics: Statistics by figure.
    """

    episodes: int
    seed: int
    success_rate: float
    statuses: Mapping[str, int]
    statistics: Mapping[str, Statistic]

    def as_dict(self) -> dict[str, Any]:
        """Return plain dictionaries and numbers for JSON; what is not known is None."""
        return {
            "episodes": self.episodes,
            "seed": self.seed,
            "success_rate": self.success_rate,
            "statuses": dict(self.statuses),
            "statistics": {
                name: {
                    "mean": item.mean,
                    "standard_deviation": None if math.isnan(item.standard_deviation) else item.standard_deviation,
                    "unit": item.unit,
                }
                for name, item in self.statistics.items()
            },
        }

    def __str__(self) -> str:
        ends = ", ".join(f"{name} {count}" for name, count in self.statuses.items())
        rows = [("", "mean", "std", "unit")]
        for name, item in self.statistics.items():
            spread = "-" if math.isnan(item.standard_deviation) else f"{item.standard_deviation:.4f}"
            rows.append((name, f"{item.mean:.4f}", spread, item.unit))
        widths = [max(len(row[column]) for row in rows) for column in range(3)]
        lines = [f"{self.episodes} episodes, seed {self.seed}: success rate {100 * self.success_rate:.1f} % ({ends})"]
        lines += [
            f"  {name:<{widths[0]}}  {mean:>{widths[1]}}  {spread:>{widths[2]}}  {unit}"
            for name, mean, spread, unit in rows
        ]
        return "\n".join(lines)


def summarise(episodes: Episodes) -> Summary:
    """Return mean and standard deviation of every figure, and the success rate."""
    statistics = {
        "return": Statistic.of(episodes.returns),
        "inspected fraction": Statistic.of(episodes.inspected_fraction),
        "delta-v": Statistic.of(episodes.delta_v, "m/s"),
        "length": Statistic.of(episodes.length, "steps"),
    }
    statistics |= {f"reward/{name}": Statistic.of(values) for name, values in episodes.terms.items()}
    counts = {status.name.lower(): int((episodes.status == status).sum()) for status in DoneStatus}
    return Summary(
        episodes=len(episodes),
        seed=episodes.seed,
        success_rate=float(np.mean(episodes.success)),
        statuses={name: count for name, count in counts.items() if count},
        statistics=statistics,
    )
