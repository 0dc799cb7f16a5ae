"""Distances between two points, compiled, for one row, and lengths of many vectors."""

from __future__ import annotations

import math

import numpy as np

from safe_inspect.compiling import njit
from safe_inspect.types import FloatArray


def lengths(vectors: FloatArray) -> FloatArray:
    """Return the lengths of vectors of shape (..., k), shape (...), summed in the same order for any batch."""
    total = vectors[..., 0] * vectors[..., 0]
    for k in range(1, vectors.shape[-1]):
        total = total + vectors[..., k] * vectors[..., k]
    return np.asarray(np.sqrt(total))


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
