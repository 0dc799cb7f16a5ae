"""Infos that the façades return for every environment, and `EpisodeAccumulator`, running totals of the episodes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from safe_inspect.dones.base import DoneStatus
from safe_inspect.environments.team import TeamEnvironment
from safe_inspect.environments.transition import TeamTransition, Transition
from safe_inspect.rta.base import TeamFiltered
from safe_inspect.simulators.view import View
from safe_inspect.types import AnyArray, FloatArray, IntArray

_STATUS_NAMES = {int(status): status.name.lower() for status in DoneStatus}


def state_info(view: View, *, has_filter: bool = False) -> dict[str, AnyArray]:
    """Return the info of a state as one array of R rows per name.

    The names are ``inspected_count`` and ``inspected_fraction`` (of the team), ``own_inspected_count`` (points that
    this deputy was the first to inspect), ``delta_v`` spent in the episode [m/s], ``status`` (`DoneStatus`) and, with a
    safety filter, ``interventions`` in the episode.

    Args:
        view: The state.
        has_filter: Whether a safety filter acts on the whole team.
    """
    info: dict[str, AnyArray] = {"delta_v": view.delta_v.copy()}
    if has_filter or view.group.safety_filter is not None:
        info["interventions"] = view.interventions.copy()
    for component in view.world.offers.components:
        info |= component.info(view)
    info["status"] = view.finished.copy()
    return info


def current_infos(environment: TeamEnvironment) -> list[dict[str, AnyArray]]:
    """Return the info of the current state for each acting group, see `state_info`."""
    filtered = environment.safety_filter is not None
    return [state_info(environment.view(index), has_filter=filtered) for index in environment.acting_indices]


def transition_info(transition: Transition, team: TeamFiltered | None = None) -> dict[str, AnyArray]:
    """Return the info of a step: the info of its final state, and ``reward/NAME`` for every reward term.

    With a safety filter, ``rta/intervening`` and ``rta/infeasible`` refer to this step. With an agent's own filter,
    there are also ``rta/active`` (bit j: constraint j rejected the desired thrust) and ``rta/phi_min``, the smallest
    plain safety quantity at the start of the step; with a filter of the whole team there is also ``rta/backup``. A
    filter never intervenes for an agent that had ended before the step.

    Args:
        transition: The step of a group of agents.
        team: Result of the team's safety filter, if there is one.
    """
    step = transition.step
    info = state_info(step.after, has_filter=team is not None)
    info |= {f"reward/{name}": value.reshape(-1) for name, value in transition.terms.items()}
    filtered = step.filtered
    if filtered is not None:
        active = transition.active.reshape(-1)
        info["rta/intervening"] = step.intervening & active
        info["rta/infeasible"] = filtered.infeasible & active
        info["rta/active"] = np.where(active, filtered.active, 0)
        info["rta/phi_min"] = filtered.phi.min(axis=1, initial=np.inf)
    if team is not None:
        info["rta/intervening"] = step.intervening.copy()
        info["rta/infeasible"] = step.after.per_environment(team.infeasible).copy()
        info["rta/backup"] = step.after.per_environment(team.backup).copy()
    return info


def team_info(environment: TeamEnvironment) -> dict[str, AnyArray]:
    """Return the info of the current state about all deputies, including scripted ones, each of shape (N,).

    The names are ``inspected_count`` and ``inspected_fraction``; ``delta_v`` spent in the episode by all deputies
    together and ``delta_v_mean`` per deputy [m/s]; ``closest``, the smallest distance between two deputies [m]
    (infinite with a single deputy); and ``outcome``, the state of the episode for the team (`DoneStatus`).
    """
    team, info = environment.team(), _of_components(environment)
    info["delta_v"] = team.delta_v.sum(axis=1)
    info["delta_v_mean"] = info["delta_v"] / team.delta_v.shape[1]
    info["closest"] = team.distance.min(axis=1, initial=np.inf)
    info["outcome"] = environment.outcome()
    return info


def _of_components(environment: TeamEnvironment) -> dict[str, AnyArray]:
    """Return the infos of the components about whole environments, each of shape (N,)."""
    team = environment.team()
    infos = [component.team_info(team) for component in environment.simulation.components.values()]
    return {name: array for info in infos for name, array in info.items()}


def info_row(info: Mapping[str, AnyArray], index: int) -> dict[str, Any]:
    """Return one row of the info as plain numbers; the status is its name in lower case."""
    found: dict[str, Any] = {name: array.item(index) for name, array in info.items()}
    found["status"] = _STATUS_NAMES[found["status"]]
    return found


def step_info(transition: Transition, infos: Mapping[str, AnyArray], index: int) -> dict[str, Any]:
    """Return the info of one row of a step; with a safety filter also the active constraints by name and the thrusts.

    Args:
        transition: The step of a group of agents.
        infos: The infos of all rows, see `transition_info`.
        index: The row.

    Returns:
        The info of the row; ``desired_control`` and ``control`` are in [N].
    """
    step, info = transition.step, info_row(infos, index)
    if step.filtered is not None:
        info["rta/active"] = step.filtered.active_names(index)
    if "rta/intervening" in infos:
        info["desired_control"], info["control"] = step.desired_control[index].copy(), step.control[index].copy()
    return info


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
        filters = [environment.safety_filter, *(group.safety_filter for group in environment.groups)]
        self.filtered = any(each is not None for each in filters)
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
        return {name: values[rows] for name, values in _of_components(self._environment).items()} | means

    def _agent_info(self, rows: IntArray) -> dict[str, AnyArray]:
        """Return the infos of single agents that are not among the team's infos, each of shape (R, D)."""
        known = _of_components(self._environment)
        found: dict[str, list[AnyArray]] = {}
        for index in range(len(self._environment.groups)):
            view = self._environment.view(index)
            for component in self._environment.simulation.components.values():
                for name, value in component.info(view).items():
                    if name not in known:
                        found.setdefault(name, []).append(value.reshape(len(self.returns), -1)[rows])
        return {name: np.concatenate(values, axis=1) for name, values in found.items()}
