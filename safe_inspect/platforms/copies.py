"""Row kernels of the sensors that read what stands in the state."""

from __future__ import annotations

from safe_inspect.compiling import njit
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
def copy_number(number: float, reading: FloatArray) -> None:
    """Write a number, shape (1,)."""
    reading[0] = float(number)
