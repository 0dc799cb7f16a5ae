"""Distances between two points, compiled, for one row."""

from __future__ import annotations

import math

from safe_inspect.compiling import njit
from safe_inspect.types import FloatArray


@njit
def distance(one: FloatArray, other: FloatArray) -> float:
    """Return the distance between two points, each of shape (3,)."""
    x, y, z = one[0] - other[0], one[1] - other[1], one[2] - other[2]
    return math.sqrt(x * x + y * y + z * z)


@njit
def is_nearer(limit: float, one: FloatArray, other: FloatArray) -> bool:
    """Return whether two points are closer to each other than a limit."""
    return distance(one, other) < limit


@njit
def is_farther(limit: float, one: FloatArray, other: FloatArray) -> bool:
    """Return whether two points are farther apart than a limit."""
    return distance(one, other) > limit
