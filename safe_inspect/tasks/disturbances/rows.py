"""Compiled sampling of a bounded disturbance."""

from __future__ import annotations

import math

from safe_inspect.compiling import njit
from safe_inspect.random.splitmix import draw_in_ball, uniform_at
from safe_inspect.types import AnyArray, FloatArray, IntArray

#: Indices of the samples of one deputy.
_DRAWS = 4
_VELOCITY, _POSITION_ERROR, _VELOCITY_ERROR, _THRUST = range(_DRAWS)


@njit
def add_velocity(key: AnyArray, step: IntArray, bound: float, extreme: bool, velocity: FloatArray) -> None:
    """Add a random velocity within a bound [m/s] to the velocity of each deputy, shape (N, D, 3)."""
    for i in range(velocity.shape[0]):
        for j in range(velocity.shape[1]):
            w = draw_in_ball(key[i], step[i], _DRAWS * j + _VELOCITY, bound, extreme)
            for axis in range(3):
                velocity[i, j, axis] += w[axis]


@njit
def write_estimates(
    key: AnyArray, step: IntArray, bounds: tuple[float, float], extreme: bool,
    truth: tuple[FloatArray, FloatArray], estimates: tuple[FloatArray, FloatArray],
) -> None:  # fmt: skip
    """Write estimates of positions and velocities, shape (N, D, 3) each, with errors within two bounds [m], [m/s]."""
    for i in range(key.shape[0]):
        for j in range(truth[0].shape[1]):
            e = draw_in_ball(key[i], step[i], _DRAWS * j + _POSITION_ERROR, bounds[0], extreme)
            f = draw_in_ball(key[i], step[i], _DRAWS * j + _VELOCITY_ERROR, bounds[1], extreme)
            for axis in range(3):
                estimates[0][i, j, axis] = truth[0][i, j, axis] + e[axis]
                estimates[1][i, j, axis] = truth[1][i, j, axis] + f[axis]


@njit
def turn_thrust(
    key: AnyArray, step: IntArray, gain: float, direction: float, extreme: bool, control: FloatArray
) -> None:  # fmt: skip
    """Change the size and the direction of each deputy's thrust, the first three elements of its control.

    Args:
        key: Key of each episode, shape (N,).
        step: Steps since the reset, shape (N,).
        gain: Bound of the relative error of the size.
        direction: Bound of the angle [rad].
        extreme: Whether the errors are on their bounds; otherwise they are uniform within them.
        control: Controls, shape (N, D, C), written in place.
    """
    for i in range(control.shape[0]):
        for j in range(control.shape[1]):
            x, y, z = control[i, j, 0], control[i, j, 1], control[i, j, 2]
            size = math.sqrt(x * x + y * y + z * z)
            if not size > 0.0:
                continue
            pick = 4 * (_DRAWS * j + _THRUST)
            share = 2.0 * uniform_at(key[i], step[i], pick) - 1.0
            angle = direction
            if extreme:
                share = -1.0 if share < 0.0 else 1.0
            else:
                angle *= uniform_at(key[i], step[i], pick + 1)
            around = 2.0 * math.pi * uniform_at(key[i], step[i], pick + 2)
            x, y, z = x / size, y / size, z / size
            # Two directions perpendicular to the thrust: one perpendicular also to the axis that is farthest from the
            # thrust, and their cross product.
            if abs(x) <= min(abs(y), abs(z)):
                ax, ay, az = 0.0, z, -y
            elif abs(y) <= abs(z):
                ax, ay, az = -z, 0.0, x
            else:
                ax, ay, az = y, -x, 0.0
            length = math.sqrt(ax * ax + ay * ay + az * az)
            ax, ay, az = ax / length, ay / length, az / length
            bx, by, bz = y * az - z * ay, z * ax - x * az, x * ay - y * ax
            flown = size * (1.0 + gain * share)
            along, across = flown * math.cos(angle), flown * math.sin(angle)
            p, q = across * math.cos(around), across * math.sin(around)
            control[i, j, 0] = along * x + p * ax + q * bx
            control[i, j, 1] = along * y + p * ay + q * by
            control[i, j, 2] = along * z + p * az + q * bz
