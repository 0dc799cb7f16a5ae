"""What the façades tell about every environment beside observation and reward."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from safe_inspect.dones.base import DoneStatus
from safe_inspect.environments.team import TeamEnvironment
from safe_inspect.environments.transition import Transition
from safe_inspect.rta.team import TeamFiltered
from safe_inspect.simulators.view import View
from safe_inspect.types import AnyArray


def facts(view: View, *, guarded: bool = False) -> dict[str, AnyArray]:
    """Return the facts of a state, one array of R rows for each.

    ``inspected_count`` and ``inspected_fraction`` (by the team), ``own_inspected_count`` (points that the own deputy
    was the first to inspect), ``delta_v`` spent in the episode [m/s] and the `DoneStatus` as ``status``; with a safety
    filter also ``interventions`` in the episode.

    Args:
        view: The state.
        guarded: Whether a safety filter acts on the whole team.
    """
    told: dict[str, AnyArray] = {"delta_v": view.delta_v.copy()}
    if guarded or view.group.guard is not None:
        told["interventions"] = view.interventions.copy()
    for component in view.world.offers.components:
        told |= component.info(view)
    told["status"] = view.finished.copy()
    return told


def step_facts(transition: Transition, team: TeamFiltered | None = None) -> dict[str, AnyArray]:
    """Return the facts of a step: those of its last state, and ``reward/NAME`` for every term.

    With a safety filter also, of this step, ``rta/intervening`` and ``rta/infeasible``; with one of the agent's own
    ``rta/active`` (bit j: the j-th constraint refused the desired thrust) and ``rta/phi_min``, the smallest plain
    safety quantity at its beginning; with one of the whole team ``rta/backup``. No filter intervenes for an agent that
    had ended before.

    Args:
        transition: The step of a group of agents.
        team: What the team's safety filter told, where there is one.
    """
    step = transition.step
    told = facts(step.after, guarded=team is not None)
    told |= {f"reward/{name}": value.reshape(-1) for name, value in transition.terms.items()}
    filtered = step.filtered
    if filtered is not None:
        active = transition.active.reshape(-1)
        told["rta/intervening"] = step.intervening & active
        told["rta/infeasible"] = filtered.infeasible & active
        told["rta/active"] = np.where(active, filtered.active, 0)
        told["rta/phi_min"] = filtered.phi.min(axis=1, initial=np.inf)
    if team is not None:
        told["rta/intervening"] = step.intervening.copy()
        told["rta/infeasible"] = step.after.per_environment(team.infeasible).copy()
        told["rta/backup"] = step.after.per_environment(team.backup).copy()
    return told


def team_facts(environment: TeamEnvironment) -> dict[str, AnyArray]:
    """Return the facts of the current state that concern all deputies, scripted ones included, each of shape (N,).

    ``inspected_count`` and ``inspected_fraction``, ``delta_v`` spent by all deputies in the episode and
    ``delta_v_mean`` by each [m/s], ``closest``, the least distance between two deputies (infinite with one) [m], and
    ``outcome``, how the episode stands for the team (`DoneStatus`).
    """
    team = environment.team()
    told: dict[str, AnyArray] = {}
    for component in team.world.offers.components:
        told |= component.team_info(team)
    told["delta_v"] = team.delta_v.sum(axis=1)
    told["delta_v_mean"] = told["delta_v"] / team.delta_v.shape[1]
    told["closest"] = team.distance.min(axis=1, initial=np.inf)
    told["outcome"] = environment.outcome()
    return told


def row(told: Mapping[str, AnyArray], index: int) -> dict[str, Any]:
    """Return the facts of one row as plain numbers, and the status by its name in lower case."""
    found: dict[str, Any] = {name: array[index].item() for name, array in told.items()}
    found["status"] = DoneStatus(found["status"]).name.lower()
    return found


def step_info(transition: Transition, told: Mapping[str, AnyArray], index: int) -> dict[str, Any]:
    """Return the facts of one row of a step; with a safety filter also the constraints by name and the thrusts [N].

    Args:
        transition: The step of a group of agents.
        told: Its facts, see `step_facts`.
        index: The row.
    """
    step, info = transition.step, row(told, index)
    if step.filtered is not None:
        info["rta/active"] = step.filtered.active_names(index)
    if "rta/intervening" in told:
        info["desired_control"], info["control"] = step.desired_control[index].copy(), step.control[index].copy()
    return info
