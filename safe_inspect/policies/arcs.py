"""Coasting and thrusting arcs in closed form, compiled: any number of steps ahead at once."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from safe_inspect.compiling import njit
from safe_inspect.dynamics.cwh import transition
from safe_inspect.dynamics.cwh_row import cwh_row
from safe_inspect.types import BoolArray, FloatArray


@lru_cache(maxsize=8)
def step_maps(mean_motion: float, step_size: float, steps: int) -> tuple[FloatArray, FloatArray]:
    """Return the maps of 0, 1, ..., `steps` steps of a body of 1 kg.

    Args:
        mean_motion: Mean motion of the chief's orbit [rad/s].
        step_size: Length of a step [s].
        steps: The largest number of steps.

    Returns:
        Transition matrices, shape (steps + 1, 6, 6), and input matrices of a thrust that is held all the while, shape
        (steps + 1, 6, 3), read only.
    """
    maps = [transition(mean_motion, 1.0, count * step_size) for count in range(steps + 1)]
    phi, gamma = (np.stack([pair[index] for pair in maps]) for index in (0, 1))
    phi.flags.writeable = gamma.flags.writeable = False
    return phi, gamma


@njit
def fly(
    phi: FloatArray, gamma: FloatArray, steps: int, state: FloatArray, acceleration: FloatArray, after: FloatArray
) -> None:
    """Write position and velocity after some steps under one acceleration.

    Args:
        phi: Transition matrices by the number of steps; see `step_maps`.
        gamma: Input matrices, likewise.
        steps: How many steps.
        state: Position [m] and velocity [m/s], Hill frame, shape (6,).
        acceleration: Thrust over mass, held all the while [m/s^2], shape (3,).
        after: Receives position and velocity, shape (6,).
    """
    x = (state[0], state[1], state[2], state[3], state[4], state[5])
    row = cwh_row(phi[steps], gamma[steps], x, acceleration[0], acceleration[1], acceleration[2])
    for i in range(6):
        after[i] = row[i]


@njit
def coast_of_others(
    phi: FloatArray,
    gamma: FloatArray,
    position: FloatArray,
    velocity: FloatArray,
    points: FloatArray,
    radius: float,
    sight: float,
    far: float,
    lit: BoolArray,
    needed: BoolArray,
    track: FloatArray,
) -> int:
    """Write where the other deputies go when none of them thrusts, and strike off the points that they will inspect.

    What a deputy would see after it has left the range from `radius` to `far` does not count: it will not go there.

    Args:
        phi: Transition matrices by the number of steps.
        gamma: Input matrices, likewise.
        position: Positions of the others [m], shape (D - 1, 3).
        velocity: Velocities of the others [m/s], shape (D - 1, 3).
        points: The points [m], shape (P, 3).
        radius: Radius of their sphere [m].
        sight: Range from which on every point above the horizon is seen [m].
        far: Largest range [m].
        lit: Points that are lit after 0, 1, ... steps, shape (J + 1, P).
        needed: Points that have to be inspected yet, shape (P,); those that the others will inspect are struck off.
        track: Receives positions and velocities of the others after 0, 1, ... steps, shape (D - 1, J + 1, 6).

    Returns:
        Number of steps after which the last of those points is inspected.
    """
    state, after, coasting = np.empty(6), np.empty(6), np.zeros(3)
    last = 0
    for k in range(position.shape[0]):
        state[:3], state[3:] = position[k], velocity[k]
        inside = True
        for j in range(lit.shape[0]):
            fly(phi, gamma, j, state, coasting, after)
            x, y, z = after[0], after[1], after[2]
            track[k, j] = after
            r2 = x * x + y * y + z * z
            inside = inside and radius * radius <= r2 <= far * far
            if j == 0 or not inside or r2 < sight * sight:
                continue
            for p in range(points.shape[0]):
                if not needed[p] or not lit[j, p]:
                    continue
                if points[p, 0] * x + points[p, 1] * y + points[p, 2] * z >= radius * radius:
                    needed[p] = False
                    last = max(last, j)
    return last
