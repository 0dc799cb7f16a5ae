"""Flights near the limits of safety filters, and the numbers of them that a record holds."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from safe_inspect.dynamics.base import DisturbanceBounds
from safe_inspect.dynamics.cwh import propagate, transition
from safe_inspect.rta.constraints import RelativeState
from safe_inspect.types import FloatArray

N, DT, ROWS, STEPS, TEAMS = 0.001027, 10.0, 250, 40, 60
#: Of how many rows and steps each value is recorded; of the others the sums of each step are.
SHOWN_ROWS, SHOWN_STEPS = 40, 8
SUMS = ("sum of thrusts", "sum of refusing", "sum of backup", "sum of memory", "sum of tracks")
BOUNDS = DisturbanceBounds(
    velocity=1e-4, position_error=0.01, velocity_error=1e-4, thrust_gain=0.01, thrust_direction=0.01
)
#: Where flights begin: nearest and farthest range [m], and largest speed [m/s].
CLOSE, NEAR, FAR, LOST = (10.2, 25.0, 0.1), (20.0, 100.0, 0.3), (740.0, 799.0, 0.4), (5.0, 850.0, 1.2)


def drawn(seed: int, rows: int, where: tuple[float, float, float]) -> RelativeState:
    generator = np.random.default_rng(seed)
    directions = generator.normal(size=(2, rows, 3))
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    return RelativeState(
        directions[0] * generator.uniform(*where[:2], (rows, 1)),
        directions[1] * generator.uniform(0.0, where[2], (rows, 1)), generator.uniform(0.0, 2.0 * np.pi, rows),
    )  # fmt: skip


def flown(state: RelativeState, control: FloatArray, mass: float) -> RelativeState:
    p, v = state.position.copy(), state.velocity.copy()
    propagate(p, v, np.ascontiguousarray(control), *transition(N, mass, DT), p, v)
    return RelativeState(p, v, state.sun_angle + N * DT)


def wanted(state: RelativeState, step: int, size: float) -> FloatArray:
    """Return thrusts to the chief, to the sun cone, outward, along the velocity, at random, and none."""
    r = np.linalg.norm(state.position, axis=1, keepdims=True)
    axis = np.stack((-np.cos(state.sun_angle), np.sin(state.sun_angle), np.zeros(len(state))), axis=1)
    random = np.random.default_rng(step).uniform(-1.0, 1.0, state.position.shape)
    ways = (-state.position / r, axis - state.position / r, state.position / r, 3.0 * state.velocity, random, 0.0 * r)
    chosen = np.stack([np.broadcast_to(way, random.shape) for way in ways])
    rows = np.arange(len(state))
    return 1.5 * size * chosen[(rows + step // 3) % 6, rows]


def flight(
    step: Callable[[RelativeState, FloatArray], Any], where: tuple[float, float, float], seed: int, mass: float = 12.0,
    size: float = 1.0,
) -> Iterator[Any]:  # fmt: skip
    """Fly, and yield what the filter gives in each step."""
    state = drawn(seed, ROWS, where)
    for k in range(STEPS):
        found = step(state, wanted(state, k, size))
        yield found
        state = flown(state, found.control, mass)


def one_number(vectors: FloatArray) -> FloatArray:
    """Return one number for the last axis of an array, on which every element has its own weight."""
    return np.asarray(vectors @ np.sqrt(np.arange(2.0, 2.0 + vectors.shape[-1])))


def noted(results: Iterator[Any]) -> dict[str, Any]:
    """Return the thrusts of the first rows, and sums of each step: of thrusts, of what refused, of what was flown."""
    found = list(results)
    rows = np.arange(1, 1 + found[0].active.size)
    thrusts = [one_number(result.control) for result in found]
    shown = [(result, len(result.backup[:SHOWN_ROWS])) for result in found[:SHOWN_STEPS]]
    return {
        "thrust": [thrust[:SHOWN_ROWS] for thrust in thrusts[:SHOWN_STEPS]],
        "refusing": [result.active[:count].ravel() @ rows[: result.active[:count].size] for result, count in shown],
        "backup": [result.backup[:count] @ rows[:count] for result, count in shown],
        "infeasible": [result.infeasible @ rows[: len(result.backup)] for result in found],
        "sum of thrusts": [one_number(thrust.ravel()) for thrust in thrusts],
        "sum of refusing": [result.active.ravel() @ rows for result in found],
        "sum of backup": [result.backup @ rows[: len(result.backup)] for result in found],
    }
