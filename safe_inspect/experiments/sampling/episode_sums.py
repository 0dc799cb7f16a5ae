"""What an episode comes to: sums while it runs, and a report at its end."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from safe_inspect.dones.base import DoneStatus
from safe_inspect.environments.team import TeamEnvironment
from safe_inspect.environments.transition import TeamTransition
from safe_inspect.types import AnyArray, FloatArray, IntArray

#: Values of an episode by name; a path such as ``agents/blue0/delta_v`` stands for nested names.
Report = dict[str, float]

#: Begins the names of what an info tells of the agent by itself.
_OWN = "own_"


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
        self._components = tuple(environment.simulation.components.values())
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

    def reports(self, rows: Sequence[int] | IntArray, transition: TeamTransition) -> list[Report]:
        """Return what the episodes of some rows have come to; call it before these rows are reset.

        ``return`` and ``reward/NAME`` are sums over the agents that act from outside, ``delta_v`` and
        ``interventions`` means over the deputies; with several agents ``agents/NAME/...`` holds the same for each.
        """
        rows = np.asarray(rows, dtype=np.int64)
        state, team = self._environment.state, self._environment.team()
        outcome = transition.outcome[rows]
        columns: dict[str, AnyArray] = {
            "return": self._returns[rows][:, self._acting].sum(axis=1),
            "length": self._lengths[rows].max(axis=1),
            "success_rate": outcome == DoneStatus.WIN,
            "lost_rate": outcome == DoneStatus.LOSE,
            "delta_v": state.delta_v[rows].mean(axis=1),
        }
        for component in self._components:
            columns |= {name: value[rows] for name, value in component.team_info(team).items()}
        if self._guarded:
            columns["interventions"] = state.interventions[rows].mean(axis=1)
        for group, terms in zip(self._environment.groups, self._terms, strict=True):
            for name, value in () if group.scripted else terms.items():
                found = value[rows].sum(axis=1)
                columns[f"reward/{name}"] = columns[f"reward/{name}"] + found if f"reward/{name}" in columns else found
        if len(self._agents) > 1:
            own = self._own()
            for index, agent in enumerate(self._agents):
                columns |= {f"agents/{agent}/{name}": value for name, value in self._of_agent(rows, index, own).items()}
        values = zip(*(column.astype(np.float64).tolist() for column in columns.values()), strict=True)
        return [dict(zip(columns, row, strict=True)) for row in values]

    def _own(self) -> dict[str, AnyArray]:
        """Return what components tell of each agent by itself, ``own_NAME`` of their infos as NAME, shape (N, D)."""
        found: dict[str, list[AnyArray]] = {}
        for index in range(len(self._slices)):
            view = self._environment.view(index)
            for component in self._components:
                for name, value in component.info(view).items():
                    if name.startswith(_OWN):
                        found.setdefault(name.removeprefix(_OWN), []).append(value.reshape(len(self._returns), -1))
        return {name: np.concatenate(values, axis=1) for name, values in found.items()}

    def _of_agent(self, rows: IntArray, index: int, own: Mapping[str, AnyArray]) -> dict[str, AnyArray]:
        state = self._environment.state
        status = state.finished[rows, index]
        columns: dict[str, AnyArray] = {
            "return": self._returns[rows, index],
            "length": self._lengths[rows, index],
            "success": status == DoneStatus.WIN,
            "lost": status == DoneStatus.LOSE,
            "delta_v": state.delta_v[rows, index],
        }
        columns |= {name: value[rows, index] for name, value in own.items()}
        if self._guarded:
            columns["interventions"] = state.interventions[rows, index]
        for part, terms in zip(self._slices, self._terms, strict=True):
            if part.start <= index < part.stop:
                columns |= {f"reward/{name}": value[rows, index - part.start] for name, value in terms.items()}
        return columns
