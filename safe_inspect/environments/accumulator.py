"""`EpisodeAccumulator`: running totals of the current episodes of a batch."""

from __future__ import annotations

import numpy as np

from safe_inspect.environments.team import TeamEnvironment
from safe_inspect.environments.transition import TeamTransition
from safe_inspect.types import AnyArray, FloatArray, IntArray

#: Prefix of the info names that concern a single agent.
OWN = "own_"
#: Prefixes, among the figures of an agent, of the reward terms and of the infos of components.
TERM, INFO = "reward/", "info/"


class EpisodeAccumulator:
    """Running totals over the current episodes of N environments with D deputies.

    Args:
        environment: The environments; their steps are added one at a time with `add`.

    Attributes:
        returns: Sum of the rewards of each agent so far [-], shape (N, D).
        lengths: Number of steps that each agent has taken part in, shape (N, D).
        filtered: Whether a safety filter acts on any agent.
    """

    def __init__(self, environment: TeamEnvironment) -> None:
        self._environment = environment
        shape = (environment.num_envs, sum(group.size for group in environment.groups))
        safety = environment.spec.team_safety
        self.filtered = any(group.safety_filter is not None for group in environment.groups) or bool(
            safety and safety.enabled
        )
        self.returns: FloatArray = np.zeros(shape)
        self.lengths: IntArray = np.zeros(shape, dtype=np.int64)
        self._terms: list[dict[str, FloatArray]] = [{} for _ in environment.groups]

    def part(self, environment: TeamEnvironment, rows: IntArray) -> EpisodeAccumulator:
        """Return the totals of some of the environments, which are now stepped as the smaller batch `environment`.

        Args:
            environment: A batch of R environments.
            rows: Their indices in this batch, shape (R,).
        """
        part = EpisodeAccumulator(environment)
        part.returns, part.lengths = self.returns[rows], self.lengths[rows]
        part._terms = [{name: value[rows] for name, value in terms.items()} for terms in self._terms]
        return part

    def add(self, transition: TeamTransition) -> None:
        """Add one step of every environment. Ended environments may be added too, once their totals have been read."""
        for group, found, terms in zip(self._environment.groups, transition.groups, self._terms, strict=True):
            self.returns[:, group.members] += found.reward
            self.lengths[:, group.members] += found.active
            for name, value in found.terms.items():
                if name in terms:
                    terms[name] += value
                else:
                    terms[name] = value.copy()

    def restart(self, rows: IntArray) -> None:
        """Set the totals of some environments to zero, because new episodes start there."""
        self.returns[rows] = 0.0
        self.lengths[rows] = 0
        for terms in self._terms:
            for value in terms.values():
                value[rows] = 0.0

    def agents(self, rows: IntArray) -> dict[str, dict[str, AnyArray]]:
        """Return the figures of every agent in some environments. Read them before the environments are reset.

        The figures are ``return``, ``length``, ``status`` (`DoneStatus`), ``delta_v`` [m/s], ``reward/NAME`` for each
        reward term, ``interventions`` when there is a safety filter, and ``info/NAME`` for each info of a component
        that concerns a single agent.

        Args:
            rows: Indices of the environments, shape (R,).

        Returns:
            Arrays of shape (R,) by agent and figure.
        """
        state, info = self._environment.state, self._agent_info(rows)
        found: dict[str, dict[str, AnyArray]] = {}
        for group, terms in zip(self._environment.groups, self._terms, strict=True):
            for member, name in enumerate(group.agents):
                deputy = group.first + member
                found[name] = {
                    "return": self.returns[rows, deputy],
                    "length": self.lengths[rows, deputy],
                    "status": state.finished[rows, deputy],
                    "delta_v": state.delta_v[rows, deputy],
                }
                found[name] |= {f"{INFO}{label}": values[:, deputy] for label, values in info.items()}
                if self.filtered:
                    found[name]["interventions"] = state.interventions[rows, deputy]
                found[name] |= {f"{TERM}{term}": value[rows, member] for term, value in terms.items()}
        return found

    def terms(self, rows: IntArray) -> dict[str, AnyArray]:
        """Return ``reward/NAME`` for each reward term, summed over the controlled agents, each of shape (R,).

        Args:
            rows: Indices of the environments, shape (R,).
        """
        found: dict[str, AnyArray] = {}
        for group, terms in zip(self._environment.groups, self._terms, strict=True):
            for name, value in () if group.scripted else terms.items():
                own, key = value[rows].sum(axis=1), f"{TERM}{name}"
                found[key] = found[key] + own if key in found else own
        return found

    def info(self, rows: IntArray) -> dict[str, AnyArray]:
        """Return the infos of the components about whole environments, and the means over the deputies of the others.

        Args:
            rows: Indices of the environments, shape (R,).

        Returns:
            Arrays of shape (R,) by the names of the components' infos, except those that start with ``own_``.
        """
        means = {
            name: values.mean(axis=1) for name, values in self._agent_info(rows).items() if not name.startswith(OWN)
        }
        return {name: values[rows] for name, values in self._team_info().items()} | means

    def _team_info(self) -> dict[str, AnyArray]:
        team = self._environment.team()
        found: dict[str, AnyArray] = {}
        for component in self._environment.simulation.components.values():
            found |= component.team_info(team)
        return found

    def _agent_info(self, rows: IntArray) -> dict[str, AnyArray]:
        """Return the infos of single agents that are not among the team's infos, each of shape (R, D)."""
        known = self._team_info()
        found: dict[str, list[AnyArray]] = {}
        for index in range(len(self._environment.groups)):
            view = self._environment.view(index)
            for component in self._environment.simulation.components.values():
                for name, value in component.info(view).items():
                    if name not in known:
                        found.setdefault(name, []).append(value.reshape(len(self.returns), -1)[rows])
        return {name: np.concatenate(values, axis=1) for name, values in found.items()}
