"""Paths between the target's principal axes T and the inertial frame W."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from safe_inspect.dynamics.quaternion import conjugate, rotate
from safe_inspect.dynamics.tumble import angular_acceleration
from safe_inspect.types import FloatArray


class TargetMotion(NamedTuple):
    """The rotation of the target at some times.

    Attributes:
        orientation: Quaternion q_WT [x, y, z, w], shape (..., 4).
        angular_velocity: Angular velocity w in T [rad/s], shape (..., 3).
        angular_acceleration: Derivative of w in T [rad/s^2], shape (..., 3).
    """

    orientation: FloatArray
    angular_velocity: FloatArray
    angular_acceleration: FloatArray


class Path(NamedTuple):
    """The motion of a point in one frame: its components and their first and second derivatives.

    Attributes:
        position: Position [m], shape (..., 3).
        velocity: Velocity [m/s], shape (..., 3).
        acceleration: Acceleration [m/s^2], shape (..., 3).
    """

    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray


def torque_free(inertia: FloatArray, orientation: FloatArray, angular_velocity: FloatArray) -> TargetMotion:
    """Return the motion of a body without torque, ``w' = -J^-1 (w x J w)``.

    Args:
        inertia: Principal moments, up to a common factor, shape (..., 3).
        orientation: Attitude q_WT, shape (..., 4).
        angular_velocity: Angular velocity in T [rad/s], shape (..., 3).
    """
    return TargetMotion(orientation, angular_velocity, angular_acceleration(inertia, angular_velocity))


def to_inertial(motion: TargetMotion, path: Path, centre: FloatArray | float = 0.0) -> Path:
    """Transform a path from T to W.

    ``r = c + R p``, ``r' = R (v + w x p)`` and ``r'' = R (a + 2 w x v + w' x p + w x (w x p))``, where p, v and a are
    the components in T and their derivatives, and the centre of mass c is at rest.

    Args:
        motion: The rotation of the target.
        path: The path in T.
        centre: The target's centre of mass in W [m], shape (..., 3).
    """
    q, w, dw = motion
    p, v, a = path
    wp = np.cross(w, p)
    return Path(
        centre + rotate(q, p),
        rotate(q, v + wp),
        rotate(q, a + 2.0 * np.cross(w, v) + np.cross(dw, p) + np.cross(w, wp)),
    )


def to_target(motion: TargetMotion, path: Path, centre: FloatArray | float = 0.0) -> Path:
    """Transform a path from W to T, the inverse of `to_inertial`.

    ``p = R' (r - c)``, ``v = R' r' - w x p``, ``a = R' r'' - 2 w x v - w' x p - w x (w x p)``.
    """
    q, w, dw = motion
    back = conjugate(q)
    p = rotate(back, path.position - centre)
    wp = np.cross(w, p)
    v = rotate(back, path.velocity) - wp
    a = rotate(back, path.acceleration) - 2.0 * np.cross(w, v) - np.cross(dw, p) - np.cross(w, wp)
    return Path(p, v, a)
