"""The inverse of a small matrix, compiled, without BLAS, so that its bits are the same on every machine."""

from __future__ import annotations

from safe_inspect.compiling import njit
from safe_inspect.types import FloatArray

#: Smallest allowed pivot.
_SINGULAR = 1e-9


@njit
def invert(matrix: FloatArray, inverse: FloatArray, size: int) -> bool:
    """Write the inverse of a matrix by Gauss-Jordan elimination with partial pivoting; return whether it exists.

    Args:
        matrix: The matrix, in the first `size` rows and columns; it is overwritten.
        inverse: Output: the inverse, in the same rows and columns.
        size: Number of rows.
    """
    for i in range(size):
        for j in range(size):
            inverse[i, j] = 1.0 if i == j else 0.0
    for i in range(size):
        best = i
        for k in range(i + 1, size):
            if abs(matrix[k, i]) > abs(matrix[best, i]):
                best = k
        if abs(matrix[best, i]) < _SINGULAR:
            return False
        if best != i:
            for j in range(size):
                matrix[i, j], matrix[best, j] = matrix[best, j], matrix[i, j]
                inverse[i, j], inverse[best, j] = inverse[best, j], inverse[i, j]
        pivot = 1.0 / matrix[i, i]
        for j in range(size):
            matrix[i, j] *= pivot
            inverse[i, j] *= pivot
        for k in range(size):
            factor = matrix[k, i]
            if k != i and factor != 0.0:
                for j in range(size):
                    matrix[k, j] -= factor * matrix[i, j]
                    inverse[k, j] -= factor * inverse[i, j]
    return True
