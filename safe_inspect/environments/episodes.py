"""Infos that the façades return for every environment in addition to observation and reward."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from safe_inspect.dones.base import DoneStatus
from safe_inspect.environments.team import TeamEnvironment
from safe_inspect.environments.transition import Transition
from safe_inspect.rta.base import TeamFiltered
from safe_inspect.simulators.view import View
from safe_inspect.types import AnyArray

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
    safety = environment.spec.team_safety
    filtered = safety is not None and safety.enabled
    return [state_info(environment.view(index), has_filter=filtered) for index in environment.acting_indices]


def transition_info(transition: Transition, team: TeamFiltered | None = None) -> dict[str, AnyArray]:
    """Return the info of a step: the info of its final state, and ``reward/NAME`` for every reward term.

    If invalid actions are replaced by a backup, ``rta/invalid_action`` is true in the rows whose action was NaN or
    infinite. With a safety filter, ``rta/intervening`` and ``rta/infeasible`` refer to this step. With an agent's own
    filter there are also ``rta/active`` (bit j: constraint j rejected the desired thrust) and ``rta/phi_min``, the
    smallest plain safety quantity at the start of the step; with a filter of the whole team there is also
    ``rta/backup``. A filter never intervenes for an agent that had ended before the step.

    Args:
        transition: The step of a group of agents.
        team: Result of the team's safety filter, if there is one.
    """
    step = transition.step
    info = state_info(step.after, has_filter=team is not None)
    info |= {f"reward/{name}": value.reshape(-1) for name, value in transition.terms.items()}
    filtered = step.filtered
    if step.invalid is not None:
        info["rta/invalid_action"] = step.invalid & transition.active.reshape(-1)
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
    team = environment.team()
    info: dict[str, AnyArray] = {}
    for component in team.world.offers.components:
        info |= component.team_info(team)
    info["delta_v"] = team.delta_v.sum(axis=1)
    info["delta_v_mean"] = info["delta_v"] / team.delta_v.shape[1]
    info["closest"] = team.distance.min(axis=1, initial=np.inf)
    info["outcome"] = environment.outcome()
    return info


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
