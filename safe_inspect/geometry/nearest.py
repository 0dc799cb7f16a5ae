"""The direction to the nearest cluster, which is the reading of the sensor of uninspected points."""

from __future__ import annotations

import math

from safe_inspect.compiling import njit
from safe_inspect.types import FloatArray

# A centre closer to the origin than this [m] differs from it only by rounding and has no direction.
_AT_ORIGIN = 1e-9


@njit
def direction_to_nearest(
    viewer: FloatArray, body: FloatArray, centres: FloatArray, count: int, direction: FloatArray
) -> None:
    """Write the direction from a body's centre to the cluster that is nearest to a viewer.

    This is the unit vector c/abs(c) of the centre c with the smallest distance abs(p - c), the first one in a tie;
    zeros if there is no cluster or the nearest centre is the origin.

    Args:
        viewer: Position of the viewer [m], shape (3,).
        body: Position of the body [m], shape (3,); p is the viewer's position relative to it.
        centres: Centres of the clusters relative to the body [m], shape (K, 3).
        count: Number of centres in use.
        direction: Output: the direction [-], shape (3,).
    """
    px, py, pz = viewer[0] - body[0], viewer[1] - body[1], viewer[2] - body[2]
    best, least = -1, math.inf
    for k in range(count):
        squared = (px - centres[k, 0]) ** 2
        squared += (py - centres[k, 1]) ** 2
        squared += (pz - centres[k, 2]) ** 2
        if squared < least:
            best, least = k, squared
    direction[0] = direction[1] = direction[2] = 0.0
    if best < 0:
        return
    x, y, z = centres[best, 0], centres[best, 1], centres[best, 2]
    length = math.sqrt(x * x + y * y + z * z)
    if length > _AT_ORIGIN:
        direction[0], direction[1], direction[2] = x / length, y / length, z / length
