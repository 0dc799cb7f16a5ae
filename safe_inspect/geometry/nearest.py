"""The direction to the nearest cluster, which the uninspected-points sensor reports."""

from __future__ import annotations

import math

import numpy as np

from safe_inspect.compiled import njit
from safe_inspect.types import FloatArray, IntArray

# A centre nearer to the origin [m] is only rounding away from it and has no direction.
_AT_ORIGIN = 1e-9


@njit(cache=True)  # type: ignore[untyped-decorator]
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
    direction = np.zeros((position.shape[0], 3))
    for row in range(position.shape[0]):
        best, least = -1, math.inf
        for j in range(count[row]):
            squared = 0.0
            for axis in range(3):
                squared += (position[row, axis] - centres[row, j, axis]) ** 2
            if squared < least:
                best, least = j, squared
        if best < 0:
            continue
        x, y, z = centres[row, best, 0], centres[row, best, 1], centres[row, best, 2]
        length = math.sqrt(x * x + y * y + z * z)
        if length > _AT_ORIGIN:
            direction[row, 0], direction[row, 1], direction[row, 2] = x / length, y / length, z / length
    return direction
