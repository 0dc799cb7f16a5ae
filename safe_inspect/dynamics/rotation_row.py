"""Products of quaternions [x, y, z, w] and rotations of vectors, compiled; `quaternion` applies them to batches."""

from __future__ import annotations

from safe_inspect.compiling import njit
from safe_inspect.types import FloatArray

#: Three components.
Components = tuple[float, float, float]
#: A quaternion, shape (4,).
Quaternion = FloatArray | tuple[float, float, float, float]


@njit
def product(p: Quaternion, q: Quaternion) -> tuple[float, float, float, float]:
    """Return the product of two quaternions, p q."""
    return (
        p[3] * q[0] + p[0] * q[3] + p[1] * q[2] - p[2] * q[1],
        p[3] * q[1] - p[0] * q[2] + p[1] * q[3] + p[2] * q[0],
        p[3] * q[2] + p[0] * q[1] - p[1] * q[0] + p[2] * q[3],
        p[3] * q[3] - p[0] * q[0] - p[1] * q[1] - p[2] * q[2],
    )


@njit
def rotated(q: Quaternion, a: float, b: float, c: float) -> Components:
    """Return the vector [a, b, c] rotated by q, ``R(q) [a, b, c]``.

    Args:
        q: Unit quaternion, shape (4,).
        a: First component of the vector.
        b: Second component.
        c: Third component.
    """
    x, y, z, w = q[0], q[1], q[2], q[3]
    tx, ty, tz = 2.0 * (y * c - z * b), 2.0 * (z * a - x * c), 2.0 * (x * b - y * a)
    return a + w * tx + y * tz - z * ty, b + w * ty + z * tx - x * tz, c + w * tz + x * ty - y * tx


@njit
def rotated_back(q: Quaternion, a: float, b: float, c: float) -> Components:
    """Return the vector [a, b, c] rotated by the inverse of q, ``R(q)^T [a, b, c]``; arguments as for `rotated`."""
    x, y, z, w = q[0], q[1], q[2], q[3]
    tx, ty, tz = 2.0 * (y * c - z * b), 2.0 * (z * a - x * c), 2.0 * (x * b - y * a)
    return a - w * tx + y * tz - z * ty, b - w * ty + z * tx - x * tz, c - w * tz + x * ty - y * tx
