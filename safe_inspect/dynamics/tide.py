"""Relative motion about a circular orbit in axes that do not turn: the tide of gravity.

The axes of W are fixed in inertial space, coincide with those of Hill's frame (x radially outwards, y along the orbit,
z normal to it) at time zero, and have their origin at the target. There a chaser obeys

``p'' = n^2 (3 (e . p) e - p) + f / m``, with ``e = (cos nt, sin nt, 0)``,

which are the equations of Clohessy, Wiltshire and Hill without the terms of a rotating frame: the attitude of a body
without torque retains its closed form. See `cwh` for the same motion in Hill's frame.
"""

from __future__ import annotations

import math

import numpy as np

from safe_inspect.types import FloatArray


def tidal_acceleration(mean_motion: float, times: FloatArray, position: FloatArray) -> FloatArray:
    """Return ``n^2 (3 (e . p) e - p)`` [m/s^2], shape (..., 3).

    Args:
        mean_motion: Mean motion n of the target's orbit [rad/s].
        times: Times [s], shape (...).
        position: Positions p relative to the target, in W [m], shape (..., 3).

    Source:
        Clohessy and Wiltshire, "Terminal guidance system for satellite rendezvous", 1960, in inertial axes.
    """
    angle = mean_motion * np.asarray(times, dtype=np.float64)
    outwards = np.stack((np.cos(angle), np.sin(angle), np.zeros_like(angle)), axis=-1)
    along = (outwards * position).sum(axis=-1, keepdims=True)
    return np.asarray(mean_motion**2 * (3.0 * along * outwards - position))


def largest_tide(mean_motion: float, distance: float) -> float:
    """Return the largest tidal acceleration within a distance of the target, ``2 n^2 r`` [m/s^2]."""
    return 2.0 * mean_motion**2 * distance


def to_hill(mean_motion: float, time: float, state: FloatArray) -> FloatArray:
    """Return states of W, positions [m] and velocities [m/s], in Hill's frame, shape (..., 6)."""
    turning = np.eye(6)  # v_H = v - n e_z x p, after the rotation.
    turning[3, 1], turning[4, 0] = mean_motion, -mean_motion
    return np.asarray(state @ (turning @ hill_rotation(mean_motion, time)).T)


def hill_rotation(mean_motion: float, time: float) -> FloatArray:
    """Return the rotation by -nt about z of position and velocity, shape (6, 6)."""
    c, s = math.cos(mean_motion * time), math.sin(mean_motion * time)
    turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    return np.kron(np.eye(2), turn)
