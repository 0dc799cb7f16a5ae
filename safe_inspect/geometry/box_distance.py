"""Signed distance of one point to a union of oriented boxes, compiled; `oriented_boxes` computes it for batches."""

from __future__ import annotations

import math
from typing import NamedTuple

from safe_inspect.compiling import njit
from safe_inspect.types import FloatArray


class BoxArrays(NamedTuple):
    """The arrays of `OrientedBoxes`, in the form that kernels use.

    Attributes:
        centre: Centres [m], shape (B, 3).
        half_size: Half sizes along the boxes' own axes [m], shape (B, 3).
        rotation: Rotations from a box's axes to the common frame, shape (B, 3, 3).
    """

    centre: FloatArray
    half_size: FloatArray
    rotation: FloatArray


@njit
def box_distance(boxes: BoxArrays, x: float, y: float, z: float) -> float:
    """Return the smallest signed distance to the boxes [m], negative inside; see `OrientedBoxes.distance`.

    Args:
        boxes: The boxes.
        x: First coordinate of the point in the boxes' frame [m].
        y: Second coordinate [m].
        z: Third coordinate [m].
    """
    least = math.inf
    for b in range(boxes.centre.shape[0]):
        centre, half_size, rotation = boxes.centre[b], boxes.half_size[b], boxes.rotation[b]
        dx, dy, dz = x - centre[0], y - centre[1], z - centre[2]
        square, deepest = 0.0, -math.inf
        for i in range(3):
            a = abs(rotation[0, i] * dx + rotation[1, i] * dy + rotation[2, i] * dz) - half_size[i]
            deepest = max(deepest, a)
            if a > 0.0:
                square += a * a
        least = min(least, math.sqrt(square) if square > 0.0 else deepest)
    return least
