"""The margins of a tube for the compiled rows, and whether they leave anything of what the constraints allow."""

from __future__ import annotations

from collections.abc import Collection

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


def tube_of(
    model: FilterModel, tracker: PlanTracker, parameters: ConstraintParameters, names: Collection[str]
) -> FloatArray:
    """Return the margins of the parts of a motion; see `FilterModel.tube`.

    Args:
        model: The task without a tube.
        tracker: What tracks the plans.
        parameters: The task's parameters.
        names: The constraints.
    """
    after, first = tracker.follow((_EFFORT, _THRUST)), tracker.follow((_THRUST,))
    parts = {HOLD: after[:1], PLAN: after[1:2], CLOSED: after[1:], FIRST_PLAN: first[:1], FIRST_CLOSED: first}
    table = np.zeros_like(NO_TUBE)
    for part, holds in parts.items():
        table[part] = _margins(model, parameters, names, *(np.max(found, axis=0) for found in zip(*holds, strict=True)))
    return table


def _margins(
    model: FilterModel, p: ConstraintParameters, names: Collection[str], length: FloatArray, speed: FloatArray,
    thrust: FloatArray,
) -> FloatArray:  # fmt: skip
    """Return the margins that a deviation asks for, shape (4, 3)."""
    coasting = model.stretch[0] * length + model.stretch[1] * speed if "PSM" in names else length
    # the speed limit near the chief falls with the range
    return np.stack((length, speed + (p.v1 * length if "rel_vel" in names else 0.0), coasting, thrust))


def starting_tube(
    model: FilterModel, tracker: PlanTracker, tube: FloatArray, p: ConstraintParameters, names: Collection[str]
) -> FloatArray:  # fmt: skip
    """Return the tube with which a real initial state must have a plan, so that every estimate of it has that plan too.

    The plans of one number from two states that differ by the estimation error differ by what is added here: their
    thrust, their hold, and the closed motion after it.
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
    motion[..., 0] -= 2.0 * n * motion[..., 4]  # without drift
    orbit = [
        1.01
        * (max(size(m[rows, :3], 2) for m in motion) * length + max(size(m[rows, 3::2], 2) for m in motion) * after)
        for rows in (slice(3), slice(3, 6))
    ]
    found = tube.copy()
    for part, deviation in ((FIRST_PLAN, (length, speed)), (FIRST_CLOSED, orbit)):
        wider = Deviations(*(np.array([value, 0.0, 0.0]) for value in (*deviation, thrust)))
        found[part] += _margins(model, p, names, *wider) + tube[part, :, 2:] * np.array([thrust, 0.0, 0.0])
    return found


def leaves_nothing(tube: FloatArray, p: ConstraintParameters, names: Collection[str]) -> str | None:
    """Return what a tube leaves nothing of, though no thrust is planned; None where it leaves something."""
    length, speed, coasting, _ = tube[CLOSED, :, _ONE]
    largest = np.sqrt(3.0) * p.u_max
    thrust = max(float(tube[part, 3] @ (1.0, largest, largest)) for part in (PLAN, CLOSED))
    near = max(length, coasting)
    gap = p.r_max - p.collision_radius
    if {"r_max", "chief_collision"} <= set(names) and near + length >= gap:
        return f"of the {gap:g} m between `collision_radius` and `r_max`, from which {near + length:.3g} m are taken"
    limit = p.v0 + p.v1 * (p.r_max - p.speed_distance)
    if "rel_vel" in names and speed >= limit:
        return f"of the speed of {limit:.3g} m/s that `rel_vel` allows, from which {speed:.3g} m/s are taken"
    if not set(names).isdisjoint(("x_vel", "y_vel", "z_vel")) and speed >= p.vel_limit:
        return f"of `vel_limit` {p.vel_limit:g} m/s, from which {speed:.3g} m/s are taken"
    if thrust >= p.u_max:
        return f"of the thrust `u_max` {p.u_max:g} N for plans, beside what tracking them takes"
    return None
