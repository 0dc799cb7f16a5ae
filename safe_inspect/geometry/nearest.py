"""The direction to the nearest cluster, which the uninspected-points sensor reports."""

from __future__ import annotations

import math

import numpy as np

from safe_inspect.compiling import njit
from safe_inspect.types import FloatArray, IntArray

# A centre nearer to the origin [m] is only rounding away from it and has no direction.
_AT_ORIGIN = 1e-9


@njit
def direction_to_nearest(
    px: float, py: float, pz: float, centres: FloatArray, start: int, count: int
) -> tuple[float, float, float]:  # fmt: skip
    """Return what `nearest_centre` does for one viewer, whose centres are a run of numbers from an index on."""
    best, least = -1, math.inf
    for at in range(start, start + 3 * count, 3):
        squared = (px - centres[at]) ** 2
        squared += (py - centres[at + 1]) ** 2
        squared += (pz - centres[at + 2]) ** 2
        if squared < least:
            best, least = at, squared
    if best < 0:
        return 0.0, 0.0, 0.0
    x, y, z = centres[best], centres[best + 1], centres[best + 2]
    length = math.sqrt(x * x + y * y + z * z)
    if length > _AT_ORIGIN:
        return x / length, y / length, z / length
    return 0.0, 0.0, 0.0


@njit
def nearest_centre(position: FloatArray, centres: FloatArray, count: IntArray) -> FloatArray:
    """Return the direction from the chief's centre to the cluster that is nearest to a viewer.

    The unit vector c/abs(c) of the centre c with the smallest distance abs(p - c), the first of equals.

    Args:
        position: Viewers' positions p relative to the chief's centre [m], shape (R, 3).
        centres: Centres of the clusters [m], in the same frame, shape (R, K, 3).
        count: How many of the centres count, shape (R,).

    Returns:
        Unit vectors [-], shape (R, 3); zeros for a row without a cluster, or whose nearest centre is the origin.
    """
    direction = np.empty((position.shape[0], 3))
    flat = np.ascontiguousarray(centres).reshape(-1)
    for row in range(position.shape[0]):
        start = row * 3 * centres.shape[1]
        x, y, z = direction_to_nearest(
            position[row, 0], position[row, 1], position[row, 2], flat, start, count[row]
        )  # fmt: skip
        direction[row, 0], direction[row, 1], direction[row, 2] = x, y, z
    return direction
