"""Rigid transforms as homogeneous matrices; their tangents (rotation, translation) act from the right."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from safe_inspect.dynamics import quaternion
from safe_inspect.types import FloatArray


def pose(rotation: FloatArray, translation: FloatArray) -> FloatArray:
    """Return the homogeneous matrix of a rotation, shape (3, 3), and a translation [m], shape (3,)."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, translation
    return matrix


def check_unit(name: str, quaternion: Sequence[float]) -> None:
    """Check that a quaternion [x, y, z, w] is a unit quaternion.

    Raises:
        ValueError: The length of the quaternion is not 1.
    """
    length = float(np.linalg.norm(quaternion))
    if abs(length - 1.0) > 1e-3:
        raise ValueError(f"{name} is not a unit quaternion [x, y, z, w]: its length is {length:.6g}")


def inverse(transform: FloatArray) -> FloatArray:
    """Return the inverse of a homogeneous matrix, shape (4, 4)."""
    return pose(transform[:3, :3].T, -transform[:3, :3].T @ transform[:3, 3])


def move(transform: FloatArray, points: FloatArray) -> FloatArray:
    """Return the transformed points [m], shape (n, 3)."""
    moved: FloatArray = points @ transform[:3, :3].T + transform[:3, 3]
    return moved


def skew(v: FloatArray) -> FloatArray:
    """Return the matrix of the cross product ``v x .``, shape (3, 3)."""
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def rotation_exp(vector: FloatArray) -> FloatArray:
    """Return the rotation matrix of a rotation vector [rad], shape (3, 3)."""
    return quaternion.to_matrix(quaternion.exp(vector))


def rotation_log(rotation: FloatArray) -> FloatArray:
    """Return the rotation vector of a rotation matrix [rad], shape (3,)."""
    return quaternion.log(quaternion.from_matrix(rotation))


def orthonormal(transform: FloatArray) -> FloatArray:
    """Return the transform with an exactly orthonormal rotation, without its rounding errors."""
    q = quaternion.from_matrix(transform[:3, :3])
    return pose(quaternion.to_matrix(q), transform[:3, 3])


def perturbed(transform: FloatArray, tangent: FloatArray) -> FloatArray:
    """Return ``T [Exp(a), b]`` with the tangent (a, b): R Exp(a) and t + R b.

    Args:
        transform: T, shape (4, 4).
        tangent: Rotation a [rad] and translation b [m], shape (6,).
    """
    rotation, translation = transform[:3, :3], transform[:3, 3]
    return pose(rotation @ rotation_exp(tangent[:3]), translation + rotation @ tangent[3:])


def difference(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return the tangent (a, b) with ``perturbed(first, (a, b)) = second``, shape (6,)."""
    between = inverse(first) @ second
    return np.concatenate([rotation_log(between[:3, :3]), between[:3, 3]])


def adjoint(transform: FloatArray) -> FloatArray:
    """Return the matrix that transforms right tangents of T' into right tangents of T T' T^-1, shape (6, 6)."""
    rotation = transform[:3, :3]
    matrix = np.zeros((6, 6))
    matrix[:3, :3] = matrix[3:, 3:] = rotation
    matrix[3:, :3] = skew(transform[:3, 3]) @ rotation
    return matrix
