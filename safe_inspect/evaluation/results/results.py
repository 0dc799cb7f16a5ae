"""`Evaluation`: the figures of a rollout, for the team and every agent."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType
from typing import Any

import numpy as np

from safe_inspect.dones.base import DoneStatus
from safe_inspect.errors import SafeInspectError
from safe_inspect.evaluation.episodes import FIGURES, Episodes
from safe_inspect.evaluation.recorder import Trajectory
from safe_inspect.metrics.statistics import Estimate, Interval, estimate, for_json, wilson
from safe_inspect.types import AnyArray, FloatArray


class EvaluationError(SafeInspectError):
    """Error for an evaluation that is missing, damaged, or not comparable with another one."""


@dataclass(frozen=True, eq=False)
class Block:
    """Figures of the team, or of one agent, in E episodes.

    Attributes:
        status: How each episode ended, in lower case, shape (E,).
        figures: Figures by name, NaN where an episode has none, each of shape (E,).
    """

    status: AnyArray
    figures: Mapping[str, FloatArray]

    @property
    def statuses(self) -> dict[str, int]:
        """Number of episodes by how they ended."""
        names = [item.name.lower() for item in DoneStatus]
        return {name: int((self.status == name).sum()) for name in names if (self.status == name).any()}

    @property
    def wins(self) -> int:
        """Number of episodes that were won."""
        return int((self.status == DoneStatus.WIN.name.lower()).sum())

    @property
    def success_rate(self) -> float:
        """Share of the episodes that were won [-]."""
        return self.wins / len(self.status)

    @property
    def success_interval(self) -> Interval:
        """Wilson's 95 % interval of the success rate."""
        return wilson(self.wins, len(self.status))


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Figures of an evaluation, with its record.

    Attributes:
        label: Name in tables.
        team: Figures of the whole episodes.
        agents: Figures of every agent by its name.
        units: Unit of every figure by its name.
        initial_states: Initial state of each episode, see `Episodes`, each of shape (E, ...).
        record: Description of the evaluation, see `safe_inspect.evaluation.results.files`.
        trajectories: The recorded episodes.
        causes: Why each episode was lost, empty for one that was not, shape (E,); None if no causes are reported.
    """

    label: str
    team: Block
    agents: Mapping[str, Block]
    units: Mapping[str, str]
    initial_states: Mapping[str, FloatArray]
    record: Mapping[str, Any] = field(default_factory=dict)
    trajectories: Sequence[Trajectory] = ()
    causes: AnyArray | None = None

    def __len__(self) -> int:
        return len(self.team.status)

    @classmethod
    def of(
        cls,
        label: str,
        episodes: Episodes,
        record: Mapping[str, Any] = MappingProxyType({}),
        *,
        reference: FloatArray | None = None,
    ) -> Evaluation:
        """Return the figures of a rollout.

        Args:
            label: Name in tables.
            episodes: The rollout.
            record: Description of the evaluation.
            reference: Delta-v of the open-loop optimum of every episode [m/s], NaN where there is none, shape (E,).
        """
        agents = episodes.agents.items()
        return cls(
            label,
            Block(_names(episodes.status), episodes.figures(reference)),
            {name: Block(_names(agent.status), agent.figures(episodes.labels)) for name, agent in agents},
            {**FIGURES, **dict(episodes.labels.values()), **episodes.units},
            episodes.initial_states,
            record,
            episodes.trajectories,
            episodes.causes,
        )

    @cached_property
    def blocks(self) -> dict[str, Block]:
        """The figures of the team under the name ``""`` and, with several agents, those of each agent by its name."""
        return {"": self.team} | (dict(self.agents) if len(self.agents) > 1 else {})

    @property
    def losses(self) -> list[tuple[str, int]]:
        """Each cause of a loss with its number of episodes, the most frequent first."""
        causes = [] if self.causes is None else self.causes.tolist()
        return Counter(cause for cause in causes if cause).most_common()

    @cached_property
    def estimates(self) -> dict[str, dict[str, Estimate]]:
        """The estimate of every figure of each of `blocks`; the bootstrap takes seconds for thousands of episodes."""
        return {
            name: {figure: estimate(values, self.units.get(figure, "-")) for figure, values in block.figures.items()}
            for name, block in self.blocks.items()
        }

    def as_dict(self) -> dict[str, Any]:
        """Return the estimates as plain dictionaries and numbers for JSON; several agents are under ``agents``."""
        agents: dict[str, Any] = {}
        for name, block in self.blocks.items():
            interval = for_json(block.success_interval)
            success = {"rate": block.success_rate, "interval": interval, "statuses": block.statuses}
            figures = {figure: item.as_dict() for figure, item in self.estimates[name].items()}
            agents[name] = {"success": success, "figures": figures}
        found: dict[str, Any] = agents.pop("")
        return found | ({"agents": agents} if agents else {})


def _names(status: AnyArray) -> AnyArray:
    return np.array([item.name.lower() for item in DoneStatus])[status]
