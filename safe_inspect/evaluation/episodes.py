"""`Episodes`: the figures of each episode of a rollout, for the team and its agents."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass, replace
from typing import Any, TypeAlias, TypeVar

import numpy as np

from safe_inspect.dones.base import DoneStatus
from safe_inspect.evaluation.recorder import Trajectory
from safe_inspect.types import AnyArray, FloatArray, IntArray

#: The figure that is added when a reference is given: delta-v minus that of the open-loop optimum.
GAP = "gap to the open-loop optimum"
#: The standard figures and their units.
FIGURES = {
    "return": "-",
    "delta-v": "m/s",
    "delta-v per deputy": "m/s",
    "length": "steps",
    "closest deputies": "m",
    GAP: "m/s",
}

#: Called with the number of finished episodes, or other items, and the total number.
Progress: TypeAlias = Callable[[int, int], None]

#: Label and unit of each quantity that components report, by the quantity's name.
_Labels = Mapping[str, tuple[str, str]]

_T = TypeVar("_T")


@dataclass(frozen=True, eq=False)
class _Informed:
    """Base class that makes the entries of `info` readable as attributes, such as ``episodes.inspected_fraction``.

    `info` contains the quantities that components report.
    """

    returns: FloatArray
    terms: Mapping[str, FloatArray]
    length: IntArray
    status: AnyArray
    delta_v: FloatArray
    info: Mapping[str, AnyArray] = field(default_factory=dict)
    metrics: Mapping[str, FloatArray] = field(default_factory=dict)

    @property
    def success(self) -> AnyArray:
        """Episodes that were won, shape (E,)."""
        return np.asarray(self.status == DoneStatus.WIN)

    def __getattr__(self, name: str) -> AnyArray:
        info: Mapping[str, AnyArray] = self.__dict__.get("info", {})
        if name not in info:
            known = f"; its components report {', '.join(info)}" if info else ""
            raise AttributeError(f"the episodes of this task have no {name!r}{known}")
        return info[name]

    def labelled(self, labels: _Labels) -> dict[str, FloatArray]:
        """Return the quantities that components report, by label."""
        return {labels.get(name, (name, "-"))[0]: values.astype(np.float64) for name, values in self.info.items()}

    def _figures(self, labels: _Labels, usual: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
        """Return all figures by label, with the usual ones behind the quantities that components report."""
        terms = {f"reward/{name}": values for name, values in self.terms.items()}
        return {"return": self.returns, **self.labelled(labels), **usual, **terms, **self.metrics}


@dataclass(frozen=True, eq=False)
class AgentEpisodes(_Informed):
    """Figures of one agent in E episodes.

    Attributes:
        returns: Sum of the rewards [-], shape (E,).
        terms: Sum of each reward term [-] by its name, each of shape (E,).
        length: Number of steps until the agent ended, shape (E,).
        status: `DoneStatus` with which it ended, 0 if it did not, int8, shape (E,).
        delta_v: Velocity change spent [m/s], shape (E,).
        info: Quantities that components report for this agent at the end, such as ``own_inspected_count``, each of
            shape (E,).
        metrics: Metrics of the agent by label, NaN where there was nothing to measure, each of shape (E,).
    """

    def figures(self, labels: _Labels) -> dict[str, FloatArray]:
        """Return all figures by label, each of shape (E,)."""
        return self._figures(labels, {"delta-v": self.delta_v, "length": self.length.astype(np.float64)})


@dataclass(frozen=True, eq=False)
class Episodes(_Informed):
    """Figures of E episodes; row k is the first episode of environment slot k.

    With one agent the figures of the team are those of the agent. The return of a team is the sum of the rewards of all
    its agents, scripted agents included, as in RLlib.

    Attributes:
        seed: Seed of the run.
        returns: Sum of the rewards of all agents [-], shape (E,).
        terms: Sum of each reward term [-] by its name, over all agents that have it, each of shape (E,).
        length: Number of steps until the episode ended for all controlled agents, shape (E,).
        status: `DoneStatus` at the end, int8, shape (E,); for a team: lost when any agent lost, else won when any won.
        delta_v: Velocity change spent, mean over the deputies [m/s], shape (E,).
        info: Quantities that components report at the end, such as ``inspected_fraction``; the mean over the agents of
            those reported for each agent. Each of shape (E,).
        trajectories: The recorded episodes, which are the first ones, in order.
        closest: Least distance between two deputies at the reset and at any step [m], shape (E,); None with one deputy.
        agents: Figures of every agent by its name.
        metrics: Metrics of the environment by label; those of the agents are combined as `BaseMetric.team_reduce` says.
            NaN where there was nothing to measure, each of shape (E,).
        units: Unit of every metric by label.
        labels: Label and unit of each quantity that components report, by the quantity's name.
        initial_states: ``position`` [m] and ``velocity`` [m/s] of each deputy at the reset, Hill frame, shape (E, D,
            3), and the arrays that components record, such as ``sun_angle`` [rad], shape (E,).
        causes: Why each episode was lost, empty for one that was not, shape (E,); None if no causes are reported.
    """

    seed: int = field(kw_only=True)
    trajectories: tuple[Trajectory, ...] = ()
    closest: FloatArray | None = None
    agents: Mapping[str, AgentEpisodes] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    labels: _Labels = field(default_factory=dict)
    initial_states: Mapping[str, FloatArray] = field(default_factory=dict)
    causes: AnyArray | None = None

    @classmethod
    def of(cls, agents: Mapping[str, AgentEpisodes], **others: Any) -> Episodes:
        """Return the episodes of a team: sums and means over its agents, and the other fields as given."""
        terms: dict[str, FloatArray] = {}
        for agent in agents.values():
            for name, values in agent.terms.items():
                terms[name] = terms[name] + values if name in terms else values
        returns = [agent.returns for agent in agents.values()]
        spent = np.stack([agent.delta_v for agent in agents.values()])
        return cls(
            returns=sum(returns[1:], returns[0]),
            terms=terms,
            delta_v=np.asarray(spent.mean(axis=0)),
            agents=agents,
            **others,
        )

    def __len__(self) -> int:
        return len(self.returns)

    def figures(self, reference: FloatArray | None = None) -> dict[str, FloatArray]:
        """Return all figures by label, each of shape (E,).

        Args:
            reference: Delta-v of the open-loop optimum of every episode [m/s], NaN where there is none, shape (E,).
        """
        spent = "delta-v per deputy" if len(self.agents) > 1 else "delta-v"
        usual = {spent: self.delta_v, "length": self.length.astype(np.float64)}
        if self.closest is not None:
            usual["closest deputies"] = self.closest
        if reference is not None:
            usual[GAP] = self.delta_v - reference
        return self._figures(self.labels, usual)


def join(parts: Sequence[_T]) -> _T:
    """Return the episodes of several batches, concatenated: arrays and tuples are joined, also within mappings."""
    first: Any = parts[0]
    if isinstance(first, np.ndarray):
        return np.concatenate(parts)  # type: ignore[arg-type,return-value]
    if isinstance(first, Mapping):
        return {key: join([part[key] for part in parts]) for key in first}  # type: ignore[index,return-value]
    if isinstance(first, tuple) and all(isinstance(item, Trajectory) for item in first):
        return tuple(item for part in parts for item in part)  # type: ignore[attr-defined,return-value]
    if is_dataclass(first):
        joined = {item.name: join([getattr(part, item.name) for part in parts]) for item in fields(first)}
        return replace(first, **joined)  # type: ignore[return-value,type-var]
    return first  # type: ignore[no-any-return]
