"""Quaternions [x, y, z, w] in Hamilton's convention, R(p q) = R(p) R(q), over the last axis of arrays.

All products are written out by components, so that a row gives bit-identical results in a batch of any size. Source:
Markley and Crassidis, "Fundamentals of Spacecraft Attitude Determination and Control", Springer 2014, chapter 2 (with
the opposite convention of the product).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from safe_inspect.compiling import njit
from safe_inspect.dynamics.rotation_row import product, rotated
from safe_inspect.types import FloatArray

#: The row's arithmetic in Python, which also accepts whole arrays as components.
_product: Any = product.__wrapped__  # type: ignore[attr-defined]
_rotated: Any = rotated.__wrapped__  # type: ignore[attr-defined]


def _joined(*components: FloatArray) -> FloatArray:
    """Return components of one shape along a new last axis; several times faster than `numpy.stack` for a few rows."""
    out = np.empty((*np.shape(components[0]), len(components)))
    for index, component in enumerate(components):
        out[..., index] = component
    return out


def multiply(p: FloatArray, q: FloatArray) -> FloatArray:
    """Return the product p q, shape (..., 4).

    Args:
        p: Quaternions, shape (..., 4).
        q: Quaternions, shape (..., 4).
    """
    first, second = ((a[..., 0], a[..., 1], a[..., 2], a[..., 3]) for a in (p, q))
    return _joined(*_product(first, second))


def conjugate(q: FloatArray) -> FloatArray:
    """Return the conjugates, shape (..., 4), which are the inverses of unit quaternions."""
    return np.asarray(q * np.array([-1.0, -1.0, -1.0, 1.0]))


def normalise(q: FloatArray) -> FloatArray:
    """Return the quaternions divided by their norms, shape (..., 4)."""
    x, y, z, w = q[..., 0], q[..., 1], q[..., 2], q[..., 3]
    return np.asarray(q / np.sqrt(x * x + y * y + z * z + w * w)[..., None])


def to_matrix(q: FloatArray) -> FloatArray:
    """Return the rotation matrices of unit quaternions, shape (..., 3, 3)."""
    x, y, z, w = q[..., 0], q[..., 1], q[..., 2], q[..., 3]
    matrix = np.empty((*q.shape[:-1], 3, 3))
    matrix[..., 0, 0] = 1.0 - 2.0 * (y * y + z * z)
    matrix[..., 0, 1] = 2.0 * (x * y - w * z)
    matrix[..., 0, 2] = 2.0 * (x * z + w * y)
    matrix[..., 1, 0] = 2.0 * (x * y + w * z)
    matrix[..., 1, 1] = 1.0 - 2.0 * (x * x + z * z)
    matrix[..., 1, 2] = 2.0 * (y * z - w * x)
    matrix[..., 2, 0] = 2.0 * (x * z - w * y)
    matrix[..., 2, 1] = 2.0 * (y * z + w * x)
    matrix[..., 2, 2] = 1.0 - 2.0 * (x * x + y * y)
    return matrix


def from_matrix(matrix: FloatArray) -> FloatArray:
    """Return unit quaternions of rotation matrices, of either sign, shape (..., 4).

    Of the four expressions for a multiple of the quaternion, the longest is used (Shepperd 1978), to avoid
    cancellation.

    Args:
        matrix: Rotation matrices, shape (..., 3, 3).
    """
    found = np.empty((*matrix.shape[:-2], 4))
    _from_matrices(np.ascontiguousarray(matrix, dtype=np.float64).reshape(-1, 3, 3), found.reshape(-1, 4))
    return found


@njit(error_model="numpy")
def _from_matrices(matrices: FloatArray, out: FloatArray) -> None:
    for n in range(len(matrices)):
        m, q = matrices[n], out[n]
        a, b, c = m[0, 0], m[1, 1], m[2, 2]
        squares = 1.0 + a - b - c, 1.0 - a + b - c, 1.0 - a - b + c, 1.0 + a + b + c  # 4 q_i q_i
        i = 0
        for other in range(1, 4):
            i = other if squares[other] > squares[i] else i
        q[i] = squares[i]
        for k in range(3):
            j, last = (k + 1) % 3, (k + 2) % 3
            if i == k:
                q[j], q[last], q[3] = m[k, j] + m[j, k], m[k, last] + m[last, k], m[last, j] - m[j, last]
            elif i == 3:
                q[k] = m[last, j] - m[j, last]
        norm = math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
        for k in range(4):
            q[k] /= norm


def exp(rotation: FloatArray) -> FloatArray:
    """Return the quaternions of rotation vectors, shape (..., 4).

    ``Exp(v) = [sin(|v| / 2) v / |v|, cos(|v| / 2)]``.

    Args:
        rotation: Rotation vectors [rad], shape (..., 3).
    """
    x, y, z = rotation[..., 0], rotation[..., 1], rotation[..., 2]
    half = 0.5 * np.sqrt(x * x + y * y + z * z)
    scale = 0.5 * np.sinc(half / np.pi)  # sin(half) / (2 half)
    return _joined(scale * x, scale * y, scale * z, np.cos(half))


def log(q: FloatArray) -> FloatArray:
    """Return the rotation vectors of unit quaternions [rad], of length at most pi, shape (..., 3).

    Args:
        q: Unit quaternions, shape (..., 4); q and -q give the same vector.
    """
    x, y, z, w = q[..., 0], q[..., 1], q[..., 2], q[..., 3]
    sine = np.sqrt(x * x + y * y + z * z)
    positive = np.where(w < 0.0, -1.0, 1.0)
    half = np.arctan2(sine, positive * w)
    scale = positive * np.where(sine > 0.0, 2.0 * half / np.where(sine > 0.0, sine, 1.0), 2.0)
    return _joined(scale * x, scale * y, scale * z)


def rotate(q: FloatArray, v: FloatArray) -> FloatArray:
    """Return R(q) v, shape (..., 3).

    Args:
        q: Unit quaternions, shape (..., 4).
        v: Vectors, shape (..., 3).
    """
    x, y, z, w = q[..., 0], q[..., 1], q[..., 2], q[..., 3]
    return _joined(*_rotated((x, y, z, w), v[..., 0], v[..., 1], v[..., 2]))


def rotate_back(q: FloatArray, v: FloatArray) -> FloatArray:
    """Return R(q)^T v, shape (..., 3); arguments as for `rotate`."""
    return rotate(conjugate(q), v)


def continuous(q: FloatArray, first: FloatArray) -> FloatArray:
    """Return the quaternions with signs chosen so that each is closer to its predecessor than its negative is.

    Args:
        q: Unit quaternions of successive times, shape (n, k, 4).
        first: The quaternions that precede the first of each row, shape (n, 4).
    """
    before = np.concatenate((first[:, None], q[:, :-1]), axis=1)
    product = q * before
    dot = product[..., 0] + product[..., 1] + product[..., 2] + product[..., 3]
    return np.asarray(q * np.cumprod(np.where(dot < 0.0, -1.0, 1.0), axis=1)[..., None])
