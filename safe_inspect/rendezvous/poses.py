"""Rigid transforms as homogeneous matrices, whose tangents act from the right, and measured relative poses."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from safe_inspect.dynamics import quaternion
from safe_inspect.types import FloatArray

#: Identity and the half turns about the three axes.
HALF_TURNS = np.array([np.diag(signs) for signs in ((1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1))], dtype=float)
#: Value of `Edge.first` for a pose relative to the known model of the target instead of to an earlier frame.
MODEL = -1


def pose(rotation: FloatArray, translation: FloatArray) -> FloatArray:
    """Return the homogeneous matrix of a rotation, shape (3, 3), and a translation [m], shape (3,)."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, translation
    return matrix


def inverse(transform: FloatArray) -> FloatArray:
    """Return the inverse of a homogeneous matrix, shape (4, 4)."""
    return pose(transform[:3, :3].T, -transform[:3, :3].T @ transform[:3, 3])


def move(transform: FloatArray, points: FloatArray) -> FloatArray:
    """Return the transformed points [m], shape (n, 3)."""
    return np.asarray(points @ transform[:3, :3].T + transform[:3, 3])


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


@dataclass(frozen=True, eq=False)
class Edge:
    """A measured relative pose of the chaser with respect to the target between frames i and j.

    Let G be the frame that is fixed to the target and equal to B at the first frame, and G_k = T_GB at frame k. The
    pose is ``T_ij = G_i^-1 G_j``. It transforms the coordinates of points of the target from B at frame j to B at
    frame i.

    If the target's shape is known, a frame can also be registered to the model. With M the model's frame, whose origin
    is the centre of mass, the pose is T_MB at frame j, ``first`` is `MODEL` and ``kind`` is "model". With one more
    node for the constant pose T_GM, this pose is ``T_GM^-1 G_j``: an edge like the others, but its errors do not add
    up over time.

    Attributes:
        first: Number i of the earlier frame, or `MODEL`.
        second: Number j of the later frame.
        pose: T_ij, homogeneous matrix, shape (4, 4) [-, m].
        covariance: Covariance of the tangent (rotation [rad], translation [m]) that acts from the right, shape (6, 6).
        inliers: Fraction of the points of frame j that have a correspondence, in [0, 1].
        kind: "odometry" between consecutive frames, "skip" across keyframes, "loop" at a revisited view, "relocalised",
            or "model" to the known shape.
    """

    first: int
    second: int
    pose: FloatArray
    covariance: FloatArray
    inliers: float
    kind: Literal["odometry", "skip", "loop", "relocalised", "model"] = "odometry"

    def in_units_of(self, length: float) -> Edge:
        """Return the pose with all lengths divided by a length [m]."""
        factors = np.repeat([1.0, 1.0 / length], 3)
        moved = pose(self.pose[:3, :3], self.pose[:3, 3] / length)
        return replace(self, pose=moved, covariance=self.covariance * np.outer(factors, factors))
