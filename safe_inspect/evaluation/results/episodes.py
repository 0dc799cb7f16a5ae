"""`Episodes`: a row of figures for each episode of a rollout, for the team and for every agent."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from safe_inspect.dones.base import DoneStatus
from safe_inspect.evaluation.rollouts.trajectory import Trajectory
from safe_inspect.types import AnyArray, FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class AgentEpisodes:
    """The figures of one agent in E episodes.

    Attributes:
        returns: Sum of the rewards [-], shape (E,).
        terms: Sum of each reward term [-] by its name, each of shape (E,).
        length: Number of steps until the agent ended, shape (E,).
        status: `DoneStatus` with which it ended, 0 if it did not, int8, shape (E,).
        inspected: Points that its deputy was the first to inspect, shape (E,).
        delta_v: Velocity change spent [m/s], shape (E,).
        metrics: Metrics of the agent by label, NaN where there was nothing to measure, each of shape (E,).
    """

    returns: FloatArray
    terms: Mapping[str, FloatArray]
    length: IntArray
    status: AnyArray
    inspected: IntArray
    delta_v: FloatArray
    metrics: Mapping[str, FloatArray] = field(default_factory=dict)

    @property
    def success(self) -> AnyArray:
        """Episodes that the agent won, shape (E,)."""
        return np.asarray(self.status == DoneStatus.WIN)


@dataclass(frozen=True, eq=False)
class Episodes:
    """E episodes; row k is the first episode of environment slot k. With one agent the figures are its own.

    The return of a team is the sum over its agents, as RLlib's is: what they earn together. Scripted agents count.

    Attributes:
        seed: Seed of the run.
        returns: Sum of the rewards of all agents [-], shape (E,).
        terms: Sum of each reward term [-] by its name, over all agents that have it, each of shape (E,).
        length: Number of steps until the episode ended for all agents that act from outside, shape (E,).
        status: `DoneStatus` at the end, int8, shape (E,); for a team: lost when any agent lost, else won when any won.
        inspected_fraction: Fraction of the points inspected at the end [-], shape (E,).
        delta_v: Velocity change spent, mean over the deputies [m/s], shape (E,).
        trajectories: The recorded episodes, the first ones, in order.
        closest: Least distance between two deputies at the beginning and at any step [m], shape (E,); None with one.
        agents: Figures of every agent by its name.
        metrics: Metrics of the environment by label; those of the agents taken together, see `BaseMetric.team_reduce`.
            NaN where there was nothing to measure, each of shape (E,).
        units: Unit of every metric by label.
        begins: State in which each episode began: ``position`` [m] and ``velocity`` [m/s] of each deputy, Hill frame,
            shape (E, D, 3), and ``sun_angle`` [rad], shape (E,).
    """

    seed: int
    returns: FloatArray
    terms: Mapping[str, FloatArray]
    length: IntArray
    status: AnyArray
    inspected_fraction: FloatArray
    delta_v: FloatArray
    trajectories: tuple[Trajectory, ...] = ()
    closest: FloatArray | None = None
    agents: Mapping[str, AgentEpisodes] = field(default_factory=dict)
    metrics: Mapping[str, FloatArray] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    begins: Mapping[str, FloatArray] = field(default_factory=dict)

    @classmethod
    def of(
        cls,
        seed: int,
        agents: Mapping[str, AgentEpisodes],
        *,
        trajectories: tuple[Trajectory, ...] = (),
        metrics: Mapping[str, FloatArray] | None = None,
        units: Mapping[str, str] | None = None,
        begins: Mapping[str, FloatArray] | None = None,
        **whole: AnyArray,
    ) -> Episodes:
        """Return the episodes of a team: the figures of its agents, and those of the `whole` by their names."""
        terms: dict[str, FloatArray] = {}
        for agent in agents.values():
            for name, values in agent.terms.items():
                terms[name] = terms[name] + values if name in terms else values
        returns = [agent.returns for agent in agents.values()]
        spent = np.stack([agent.delta_v for agent in agents.values()])
        return cls(
            seed=seed,
            returns=sum(returns[1:], returns[0]),
            terms=terms,
            delta_v=np.asarray(spent.mean(axis=0)),
            trajectories=trajectories,
            agents=agents,
            metrics=metrics or {},
            units=units or {},
            begins=begins or {},
            **whole,
        )

    def __len__(self) -> int:
        return len(self.returns)

    @property
    def success(self) -> AnyArray:
        """Episodes that were won, shape (E,)."""
        return np.asarray(self.status == DoneStatus.WIN)


def join(parts: Sequence[Mapping[str, AnyArray]]) -> dict[str, AnyArray]:
    """Return figures by name, those of several batches one behind the other."""
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
