"""Which deputies are near a deputy, and in which direction: compiled, row by row.

A row is a deputy of a group in an environment: R = N * G rows, environment by environment, as in a view. Positions are
those of the state, (N, B, 3), the D deputies first among the bodies.
"""

from __future__ import annotations

import math

import numpy as np

from safe_inspect.compiling import njit
from safe_inspect.types import FloatArray, IntArray

# A position nearer to the origin [m] is only rounding away from it and has no direction.
_AT_ORIGIN = 1e-9


@njit
def _squared_distance(position: FloatArray, env: int, one: int, other: int) -> float:
    x = position[env, other, 0] - position[env, one, 0]
    y = position[env, other, 1] - position[env, one, 1]
    z = position[env, other, 2] - position[env, one, 2]
    return float(x * x + y * y + z * z)


@njit
def nearest_deputies(
    position: FloatArray, deputies: int, first: int, size: int, count: int, max_range: float
) -> IntArray:  # fmt: skip
    """Return the nearest other deputies within a range, the nearest first; of equals the one of the lower index.

    Args:
        position: Positions of the bodies [m], shape (N, B, 3).
        deputies: Number of deputies, D.
        first: Index of the group's first deputy.
        size: Number of the group's deputies, G.
        count: How many are wanted, k.
        max_range: Distance up to which a deputy counts [m].

    Returns:
        Their indices, -1 where there are no more, shape (R, k).
    """
    environments = position.shape[0]
    found = np.empty((environments * size, count), dtype=np.int64)
    least = np.empty(count)
    for env in range(environments):
        for own in range(first, first + size):
            nearest_to(position, deputies, env, own, max_range, found[env * size + own - first], least)
    return found


@njit
def nearest_to(
    position: FloatArray, deputies: int, env: int, own: int, max_range: float, found: IntArray, least: FloatArray
) -> None:
    """Write what `nearest_deputies` returns for one deputy, shape (k,); `least` is room of that size."""
    count, known, limit = len(found), 0, max_range * max_range
    found[:] = -1
    for other in range(deputies):
        if other == own:
            continue
        squared = _squared_distance(position, env, own, other)
        if not squared <= limit:
            continue
        place = known
        while place > 0 and squared < least[place - 1]:
            place -= 1
        if place >= count:
            continue
        known = min(known + 1, count)
        for later in range(known - 1, place, -1):
            least[later] = least[later - 1]
            found[later] = found[later - 1]
        least[place] = squared
        found[place] = other


@njit
def differences(values: FloatArray, index: IntArray, first: int, size: int) -> FloatArray:
    """Return what others' vectors are beyond the own: v_other - v_own, zeros where there is no other.

    Args:
        values: A vector of each body, such as its velocity, shape (N, B, 3).
        index: Indices of the others, -1 for none, shape (R, k).
        first: Index of the group's first deputy.
        size: Number of the group's deputies, G.

    Returns:
        The differences in the unit of the vectors, shape (R, k, 3).
    """
    rows, count = index.shape
    found = np.zeros((rows, count, 3))
    for row in range(rows):
        env, own = row // size, first + row % size
        for place in range(count):
            other = index[row, place]
            if other >= 0:
                for axis in range(3):
                    found[row, place, axis] = values[env, other, axis] - values[env, own, axis]
    return found


@njit
def outwards(own: FloatArray, distance: float) -> tuple[float, float, float]:
    """Return a vector of a length, from the origin towards a position, shape (3,); +x at the origin itself."""
    length = math.sqrt(own[0] * own[0] + own[1] * own[1] + own[2] * own[2])
    if length > _AT_ORIGIN:
        return distance * (own[0] / length), distance * (own[1] / length), distance * (own[2] / length)
    return distance, 0.0, 0.0


@njit
def pad_outwards(
    relative: FloatArray, index: IntArray, position: FloatArray, first: int, size: int, distance: float
) -> None:  # fmt: skip
    """Put vectors where there is no other deputy: `distance` long, away from the origin; in place.

    Args:
        relative: The vectors [m], shape (R, k, 3).
        index: Indices of the others, -1 for none (behind the others), shape (R, k).
        position: Positions of the bodies [m], shape (N, B, 3). At the origin itself the direction is +x.
        first: Index of the group's first deputy.
        size: Number of the group's deputies, G.
        distance: Length of the vectors that are put in [m].
    """
    rows, count = index.shape
    for row in range(rows):
        if index[row, count - 1] >= 0:
            continue
        own = position[row // size, first + row % size]
        x, y, z = outwards(own, distance)
        for place in range(count):
            if index[row, place] < 0:
                relative[row, place, 0], relative[row, place, 1], relative[row, place, 2] = x, y, z


@njit
def scan_deputies(
    position: FloatArray, deputies: int, first: int, size: int, directions: FloatArray, max_range: float
) -> FloatArray:
    """Return the range to the nearest other deputy in every bin of directions about each deputy.

    A deputy stands in the bin whose direction is nearest to its own, the first of equals; one at the very same place
    stands in every bin.

    Args:
        position: Positions of the bodies [m], shape (N, B, 3).
        deputies: Number of deputies, D.
        first: Index of the group's first deputy.
        size: Number of the group's deputies, G.
        directions: Unit vectors of the bins [-], shape (K, 3).
        max_range: The range where there is none, or none that is nearer [m].

    Returns:
        Ranges [m], shape (R, K).
    """
    environments, bins = position.shape[0], directions.shape[0]
    ranges = np.full((environments * size, bins), max_range)
    limit = max_range * max_range
    for env in range(environments):
        for own in range(first, first + size):
            row = env * size + own - first
            for other in range(deputies):
                if other == own:
                    continue
                squared = _squared_distance(position, env, own, other)
                if not squared < limit:
                    continue
                if squared == 0.0:
                    ranges[row] = 0.0
                    continue
                x = position[env, other, 0] - position[env, own, 0]
                y = position[env, other, 1] - position[env, own, 1]
                z = position[env, other, 2] - position[env, own, 2]
                best, most = 0, -math.inf
                for bin in range(bins):
                    along = directions[bin, 0] * x + directions[bin, 1] * y + directions[bin, 2] * z
                    if along > most:
                        best, most = bin, along
                ranges[row, best] = min(ranges[row, best], math.sqrt(squared))
    return ranges


@njit
def pair_distances(position: FloatArray, deputies: int, distance: FloatArray) -> None:
    """Write the distance of every pair of the first bodies: 0-1, 0-2, ..., 1-2, ... [m].

    Args:
        position: Positions of the bodies, the deputies first [m], shape (N, B, 3).
        deputies: Number of deputies, D.
        distance: Takes the distances [m], shape (N, D (D - 1) / 2).
    """
    for n in range(position.shape[0]):
        pair = 0
        for i in range(deputies):
            for j in range(i + 1, deputies):
                x = position[n, i, 0] - position[n, j, 0]
                y = position[n, i, 1] - position[n, j, 1]
                z = position[n, i, 2] - position[n, j, 2]
                distance[n, pair] = math.sqrt(x * x + y * y + z * z)
                pair += 1
