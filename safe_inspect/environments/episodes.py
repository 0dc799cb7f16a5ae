"""What the façades tell about every environment beside observation and reward."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from safe_inspect.environments.transition import Transition
from safe_inspect.simulators.view import View
from safe_inspect.types import AnyArray


def facts(view: View, status: AnyArray | None = None) -> dict[str, AnyArray]:
    """Return the facts of a state, one array of R rows for each.

    ``inspected_count`` and ``inspected_fraction`` (by the team), ``delta_v`` spent in the episode [m/s] and the
    `DoneStatus` as ``status``; with a safety filter also ``interventions`` in the episode.
    """
    told: dict[str, AnyArray] = {"delta_v": view.delta_v.copy()}
    if view.group.guard is not None:
        told["interventions"] = view.interventions.copy()
    for name in view.world.points:
        points = view.points(name)
        told["inspected_count"] = told.get("inspected_count", 0) + points.count
    total = sum(model.num_points for model in view.world.points.values())
    if total:
        told["inspected_fraction"] = told["inspected_count"] / total
    told["status"] = np.zeros(view.num_rows, dtype=np.int8) if status is None else status.reshape(-1)
    return told


def step_facts(transition: Transition) -> dict[str, AnyArray]:
    """Return the facts of a step: those of its last state, and ``reward/NAME`` for every term.

    With a safety filter also, of this step, ``rta/intervening``, ``rta/infeasible``, ``rta/active`` (bit j: the j-th
    constraint refused the desired thrust) and ``rta/phi_min``, the smallest plain safety quantity at its beginning.
    """
    told = facts(transition.step.after, transition.status)
    told |= {f"reward/{name}": value.reshape(-1) for name, value in transition.terms.items()}
    filtered = transition.step.filtered
    if filtered is not None:
        told["rta/intervening"] = filtered.intervening.copy()
        told["rta/infeasible"] = filtered.infeasible.copy()
        told["rta/active"] = filtered.active.copy()
        told["rta/phi_min"] = filtered.phi.min(axis=1, initial=np.inf)
    return told


def row(told: Mapping[str, AnyArray], index: int) -> dict[str, float | int]:
    """Return the facts of one row as plain numbers."""
    return {name: array[index].item() for name, array in told.items()}
