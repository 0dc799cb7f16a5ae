"""Order in which deputies plan, compiled: those that must act soon come first."""

from __future__ import annotations

import numpy as np

from safe_inspect.compiling import njit
from safe_inspect.dynamics.step_maps import StepMaps, advance_steps
from safe_inspect.types import FloatArray, IntArray

#: Number of rounds of turns within which conflicts are considered.
_ROUNDS = 3


@njit
def _first_conflict(
    position: FloatArray, velocity: FloatArray, maps: StepMaps, clearance: float, steps: int
) -> IntArray:
    """Return the steps until each pair of coasting deputies is too near, `steps` for never, shape (D, D)."""
    deputies = position.shape[0]
    found = np.full((deputies, deputies), steps, np.int64)
    now, after, coasting = np.empty((deputies, 6)), np.empty((deputies, 6)), np.zeros(3)
    now[:, :3], now[:, 3:] = position, velocity
    for j in range(min(steps, maps.phi.shape[0])):
        for d in range(deputies):
            advance_steps(maps, j, now[d], coasting, after[d])
        for a in range(deputies):
            for b in range(a):
                apart = 0.0
                for axis in range(3):
                    apart += (after[a, axis] - after[b, axis]) ** 2
                if apart < clearance * clearance and found[b, a] == steps:
                    found[b, a] = j
    return found


@njit
def take_turns(
    turn: IntArray,
    deputy: IntArray,
    group_size: int,
    position: FloatArray,
    velocity: FloatArray,
    maps: StepMaps,
    clearance: float,
) -> None:
    """Assign a turn to each row without one: 0 plans first, then 1, and so on; every deputy computes the same order.

    Of each pair that would soon come too near, one comes first, in the order of the conflicts; then the other deputies
    by index.

    Args:
        turn: Turn of each row, negative for none, shape (R,); read and written.
        deputy: Index of the deputy, shape (R,).
        group_size: Number of rows of one environment, G.
        position: Positions of all deputies at the reset [m], shape (N, D, 3).
        velocity: Their velocities [m/s], shape (N, D, 3).
        maps: The maps of 0, 1, ... steps.
        clearance: Distance below which two deputies are too near [m].
    """
    deputies = position.shape[1]
    steps = _ROUNDS * deputies
    order = np.empty(deputies, np.int64)
    for row in range(turn.shape[0]):
        if turn[row] >= 0:
            continue
        env = row // group_size
        conflict = _first_conflict(position[env], velocity[env], maps, clearance, steps)
        order[:] = -1
        settled = np.zeros(deputies, np.bool_)
        given = 0
        for j in range(steps):
            for a in range(deputies):
                for b in range(a):
                    if conflict[b, a] == j and not settled[a] and not settled[b]:
                        order[b] = given
                        given += 1
                        settled[a] = settled[b] = True
        for d in range(deputies):
            if order[d] < 0:
                order[d] = given
                given += 1
        turn[row] = order[deputy[row]]
