"""Rotation of a camera towards a point by the smallest angle.

Frames: W inertial; B the chaser's body, x forward, y right, z down; C its camera, z forward, x right, y down.
"""

from __future__ import annotations

import numpy as np

from safe_inspect.types import FloatArray

# Rotation from C to B: the columns are the camera's axes in B.
R_BC: FloatArray = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])

# Below this distance [m] the direction to the target is not defined, and the previous direction is used.
_LEAST_RANGE = 1e-6
# Two directions are opposite if 1 + cos of the angle between them is less than this.
_OPPOSITE = 1e-12


def shortest_arc(first: FloatArray, last: FloatArray, about: FloatArray) -> FloatArray:
    """Return the rotation by the smallest angle from one direction to another.

    ``R = I + v^ + v^ v^ / (1 + c)`` with ``v = a x b``, ``c = a.b``, where v^ is the skew matrix of v.

    Args:
        first: Unit vectors a, shape (..., 3).
        last: Unit vectors b, shape (..., 3).
        about: Unit vectors perpendicular to a, shape (..., 3): the axis of the half turn if b = -a.

    Returns:
        R with R a = b, shape (..., 3, 3).
    """
    cosine = (first * last).sum(axis=-1)
    v = np.cross(first, last)
    skew = np.zeros((*v.shape, 3))
    skew[..., 0, 1], skew[..., 0, 2], skew[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    skew[..., 1, 0], skew[..., 2, 0], skew[..., 2, 1] = v[..., 2], -v[..., 1], v[..., 0]
    opposite = (1.0 + cosine < _OPPOSITE)[..., None, None]
    arc = np.eye(3) + skew + skew @ skew / np.where(opposite, 1.0, (1.0 + cosine)[..., None, None])
    half_turn = 2.0 * about[..., :, None] * about[..., None, :] - np.eye(3)
    return np.asarray(np.where(opposite, half_turn, arc))


def point_camera(camera: FloatArray, position: FloatArray, target: FloatArray) -> FloatArray:
    """Return the attitude of a camera after turning it towards a point by the shortest arc, without roll.

    Args:
        camera: R_WC before, shape (..., 3, 3).
        position: The camera's position in W [m], shape (..., 3).
        target: The point in W [m], shape (..., 3).

    Returns:
        R_WC with its z axis along target - position, shape (..., 3, 3); unchanged if the point is at the camera.
    """
    way = np.asarray(target - position)
    distance = np.sqrt((way * way).sum(axis=-1, keepdims=True))
    undefined = distance < _LEAST_RANGE
    axis = np.where(undefined, camera[..., :, 2], way / np.where(undefined, 1.0, distance))
    turned = shortest_arc(camera[..., :, 2], axis, camera[..., :, 0]) @ camera
    return _orthonormal(turned, axis)


def _orthonormal(camera: FloatArray, axis: FloatArray) -> FloatArray:
    """Return the rotation matrix with the given z axis and the closest x axis, so that rounding does not accumulate."""
    x = camera[..., :, 0]
    x = x - (x * axis).sum(axis=-1, keepdims=True) * axis
    x = x / np.sqrt((x * x).sum(axis=-1, keepdims=True))
    return np.stack((x, np.cross(axis, x), axis), axis=-1)
