"""Distances and directions from a deputy to the deputies near it: compiled, row by row.

Positions are those of the bodies of one environment, (B, 3), the D deputies first, except in `pair_distances`.
"""

from __future__ import annotations

import math

from safe_inspect.compiling import njit
from safe_inspect.geometry.distance import distance
from safe_inspect.types import FloatArray

# A position closer to the origin than this [m] differs from it only by rounding and has no direction.
_AT_ORIGIN = 1e-9


@njit
def _squared_distance(position: FloatArray, one: int, other: int) -> float:
    x = position[other, 0] - position[one, 0]
    y = position[other, 1] - position[one, 1]
    z = position[other, 2] - position[one, 2]
    return float(x * x + y * y + z * z)


@njit
def _next_nearest(
    position: FloatArray, deputies: int, own: int, max_range: float, last: int, beyond: float
) -> tuple[int, float]:
    """Return the nearest other deputy after the last one within a range; in a tie the lower index comes first.

    Args:
        position: Positions of the bodies [m], shape (B, 3).
        deputies: Number of deputies, D.
        own: Index of the own deputy.
        max_range: Largest distance at which a deputy counts [m].
        last: Index of the last one; -1 for the first call.
        beyond: Its squared distance [m^2]; -1 for the first call.

    Returns:
        The index of the deputy, -1 if there is none, and its squared distance [m^2].
    """
    found, least, limit = -1, math.inf, max_range * max_range
    for other in range(deputies):
        if other == own:
            continue
        squared = _squared_distance(position, own, other)
        later = squared > beyond or (squared == beyond and other > last)
        if squared <= limit and later and (found < 0 or squared < least):
            found, least = other, squared
    return found, least


@njit
def nearest_positions(deputies: int, max_range: float, own: int, position: FloatArray, relative: FloatArray) -> None:
    """Write the positions of the nearest other deputies relative to the own deputy, nearest first.

    A place without a deputy is `max_range` away, straight outward from the origin; in the direction +x at the origin
    itself.

    Args:
        deputies: Number of deputies, D.
        max_range: Largest distance at which a deputy counts [m].
        own: Index of the own deputy.
        position: Positions of the bodies [m], shape (B, 3).
        relative: Output: the relative positions [m], shape (3 k,).
    """
    last, squared = -1, -1.0
    for place in range(0, len(relative), 3):
        if last >= 0 or place == 0:
            last, squared = _next_nearest(position, deputies, own, max_range, last, squared)
        if last >= 0:
            for axis in range(3):
                relative[place + axis] = position[last, axis] - position[own, axis]
        else:
            x, y, z = position[own, 0], position[own, 1], position[own, 2]
            length = math.sqrt(x * x + y * y + z * z)
            if length > _AT_ORIGIN:
                x, y, z = max_range * (x / length), max_range * (y / length), max_range * (z / length)
            else:
                x, y, z = max_range, 0.0, 0.0
            relative[place], relative[place + 1], relative[place + 2] = x, y, z


@njit
def nearest_velocities(
    deputies: int, max_range: float, own: int, position: FloatArray, velocity: FloatArray, relative: FloatArray
) -> None:
    """Write the velocities of the nearest other deputies relative to the own one [m/s], shape (3 k,); 0 without one."""
    last, squared = -1, -1.0
    for place in range(0, len(relative), 3):
        if last >= 0 or place == 0:
            last, squared = _next_nearest(position, deputies, own, max_range, last, squared)
        for axis in range(3):
            relative[place + axis] = velocity[last, axis] - velocity[own, axis] if last >= 0 else 0.0


@njit
def pair_distances(position: FloatArray, deputies: int, distances: FloatArray) -> None:
    """Write the distance of every pair of deputies: 0-1, 0-2, ..., 1-2, ... [m].

    Args:
        position: Positions of the bodies, the deputies first [m], shape (N, B, 3).
        deputies: Number of deputies, D.
        distances: Output: the distances [m], shape (N, D (D - 1) / 2).
    """
    for n in range(position.shape[0]):
        pair = 0
        for i in range(deputies):
            for j in range(i + 1, deputies):
                distances[n, pair] = distance(position[n, i], position[n, j])
                pair += 1
