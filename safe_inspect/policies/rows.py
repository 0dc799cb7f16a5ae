"""Row-wise vector operations by components, so that each bit of a result is independent of the batch size."""

from __future__ import annotations

import numpy as np

from safe_inspect.types import FloatArray


def cross_rows(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the cross products of rows, shape (R, 3)."""
    return np.stack([a[:, i] * b[:, j] - a[:, j] * b[:, i] for i, j in ((1, 2), (2, 0), (0, 1))], axis=-1)


def dot_rows(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the dot products of rows of three elements, shape (R,)."""
    return np.asarray(a[:, 0] * b[:, 0] + a[:, 1] * b[:, 1] + a[:, 2] * b[:, 2])


def size_of_rows(vector: FloatArray) -> FloatArray:
    """Return the lengths of rows of three elements, shape (R,)."""
    return np.asarray(np.sqrt(dot_rows(vector, vector)))
