"""Margins of a tube for the compiled rows, and a check that they leave something of what the constraints allow."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from safe_inspect.dynamics.cwh import transition
from safe_inspect.rta.constraints.parameters import ConstraintParameters
from safe_inspect.rta.filters.backup.model import (
    CLOSED,
    CROSS,
    FINE_NODES,
    FIRST_CLOSED,
    FIRST_PLAN,
    HOLD,
    NO_TUBE,
    PLAN,
    RADIAL,
    FilterModel,
)
from safe_inspect.rta.filters.tube.deviations import Deviations, PlanTracker
from safe_inspect.types import FloatArray

_ONE, _EFFORT, _THRUST = range(3)


def tube_of(model: FilterModel, tracker: PlanTracker, constraints: Mapping[str, Any]) -> FloatArray:
    """Compute the margins of the parts of a motion; see `FilterModel.tube`.

    Args:
        model: The task without a tube.
        tracker: Controller that tracks the plans.
        constraints: The constraints, by name.
    """
    after, first = tracker.follow((_EFFORT, _THRUST)), tracker.follow((_THRUST,))
    parts = {HOLD: after[:1], PLAN: after[1:2], CLOSED: after[1:], FIRST_PLAN: first[:1], FIRST_CLOSED: first}
    table = np.zeros_like(NO_TUBE)
    for part, holds in parts.items():
        table[part] = _margins(model, constraints, *(np.max(found, axis=0) for found in zip(*holds, strict=True)))
    return table


def _margins(
    model: FilterModel, constraints: Mapping[str, Any], length: FloatArray, speed: FloatArray, thrust: FloatArray
) -> FloatArray:  # fmt: skip
    """Return the margins that a deviation requires, shape (4, 3)."""
    coasting = model.stretch[0] * length + model.stretch[1] * speed if "PSM" in constraints else length
    # The speed limit near the chief decreases with the range.
    falls = constraints["rel_vel"].v1 * length if "rel_vel" in constraints else 0.0
    return np.stack((length, speed + falls, coasting, thrust))


def starting_tube(
    model: FilterModel, tracker: PlanTracker, tube: FloatArray, constraints: Mapping[str, Any]
) -> FloatArray:  # fmt: skip
    """Compute the tube for real initial states: with a plan in it, every estimate of a state has that plan too.

    The margins that are added bound the differences between the plans of the same index from two states that differ by
    the estimation error: in their thrust, their hold, and the closed motion after it.
    """
    phi, gamma, n = model.hold_phi[-1], model.hold_gamma[-1], model.n
    errors = tracker.bounds.position_error, tracker.bounds.velocity_error
    size = np.linalg.norm
    away = size(phi[:3, :3], 2) * errors[0] + size(phi[:3, 3:], 2) * errors[1]
    faster = size(phi[3:, :3], 2) * errors[0] + size(phi[3:, 3:], 2) * errors[1]
    radial = max(faster, n * away * (0.5 + max(map(abs, RADIAL))))
    cross = max(faster, n * away * max(map(abs, CROSS)))
    thrust = size(model.plan, 2) * size([radial + faster, 2.0 * n * away + faster, cross + faster])
    length, speed = away + size(gamma[:3], 2) * thrust, faster + size(gamma[3:], 2) * thrust
    after = size([radial, 2.0 * n * length, cross])
    turns = np.arange(FINE_NODES) * (2.0 * np.pi / (n * FINE_NODES))
    motion = np.stack([transition(n, 1.0, turn)[0] for turn in turns])
    motion[..., 0] -= 2.0 * n * motion[..., 4]  # Without drift.
    orbit = [
        1.01
        * (max(size(m[rows, :3], 2) for m in motion) * length + max(size(m[rows, 3::2], 2) for m in motion) * after)
        for rows in (slice(3), slice(3, 6))
    ]
    found = tube.copy()
    for part, deviation in ((FIRST_PLAN, (length, speed)), (FIRST_CLOSED, orbit)):
        wider = Deviations(*(np.array([value, 0.0, 0.0]) for value in (*deviation, thrust)))
        found[part] += _margins(model, constraints, *wider) + tube[part, :, 2:] * np.array([thrust, 0.0, 0.0])
    return found


def leaves_nothing(tube: FloatArray, p: ConstraintParameters, constraints: Mapping[str, Any]) -> str | None:
    """Describe what a tube uses up entirely, even if no thrust is planned; None if there is no such quantity."""
    length, speed, coasting, _ = tube[CLOSED, :, _ONE]
    largest = np.sqrt(3.0) * p.u_max
    thrust = max(float(tube[part, 3] @ (1.0, largest, largest)) for part in (PLAN, CLOSED))
    near = max(length, coasting)
    far = constraints["r_max"].r_max if "r_max" in constraints else p.r_max
    if {"r_max", "chief_collision"} <= constraints.keys():
        gap = far - constraints["chief_collision"].collision_radius
        if near + length >= gap:
            return f"of the {gap:g} m between the `collision_radius` and `r_max`: {near + length:.3g} m are taken"
    if "rel_vel" in constraints:
        line = constraints["rel_vel"]
        limit = line.v0 + line.v1 * (far - line.v0_distance)
        if speed >= limit:
            return f"of the speed of {limit:.3g} m/s that `rel_vel` allows, from which {speed:.3g} m/s are taken"
    for name in ("x_vel", "y_vel", "z_vel"):
        if name in constraints and speed >= constraints[name].vel_limit:
            limit = constraints[name].vel_limit
            return f"of the `vel_limit` {limit:g} m/s of {name}, from which {speed:.3g} m/s are taken"
    if thrust >= p.u_max:
        return f"of the thrust `u_max` {p.u_max:g} N for plans, because tracking them takes all of it"
    return None
