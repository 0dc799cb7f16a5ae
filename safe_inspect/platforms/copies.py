"""Row kernels of the sensors that copy values of the state."""

from __future__ import annotations

from safe_inspect.compiling import njit
from safe_inspect.dynamics.rotation_row import rotated
from safe_inspect.types import FloatArray


@njit
def copy_vector(vector: FloatArray, reading: FloatArray) -> None:
    """Write a vector, shape (size,)."""
    for k in range(len(reading)):
        reading[k] = vector[k]


@njit
def copy_difference(one: FloatArray, other: FloatArray, reading: FloatArray) -> None:
    """Write the difference of two vectors, shape (size,)."""
    for k in range(len(reading)):
        reading[k] = one[k] - other[k]


@njit
def copy_turned(bound: float, orientation: FloatArray, vector: FloatArray, reading: FloatArray) -> None:
    """Write ``R(q) v`` for an attitude q, shape (4,), and a vector v, shape (3,), with elements within a bound."""
    turned = rotated(orientation, vector[0], vector[1], vector[2])
    for k in range(3):
        reading[k] = min(max(turned[k], -bound), bound)


@njit
def copy_axes(first: int, orientation: FloatArray, reading: FloatArray) -> None:
    """Write two axes of a body as unit vectors, x and y (first = 0) or y and z (1), for its attitude, shape (6,)."""
    one = rotated(orientation, 1.0 - first, float(first), 0.0)
    other = rotated(orientation, 0.0, 1.0 - first, float(first))
    for k in range(3):
        reading[k] = min(max(one[k], -1.0), 1.0)
        reading[3 + k] = min(max(other[k], -1.0), 1.0)


@njit
def copy_number(number: float, reading: FloatArray) -> None:
    """Write a number, shape (1,)."""
    reading[0] = float(number)
