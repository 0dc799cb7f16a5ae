"""Compiled lower and upper bounds on the range, one state at a time."""

from __future__ import annotations

import math

from safe_inspect.compiling import njit
from safe_inspect.types import FloatArray

#: Below this distance [m], no direction is derived from the position, because it would be rounding noise.
LENGTH_FLOOR = 1e-6
#: Below this distance [m], the slope of the signed square root is the slope at this distance; it is infinite at 0.
ROOT_FLOOR = 1e-6


@njit
def braking_speed(distance: float, acceleration: float) -> tuple[float, float]:
    """Return sign(d) sqrt(2 a |d|), the speed from which one can brake within d, and its slope."""
    size = abs(distance)
    value = math.sqrt(2.0 * acceleration * size)
    slope = acceleration / math.sqrt(2.0 * acceleration * max(size, ROOT_FLOOR))
    return (value if distance >= 0.0 else -value), slope


@njit
def range_limit(
    state: tuple[FloatArray, FloatArray], limit: float, acceleration: float, side: float,
    phi: FloatArray, h: FloatArray, gradient: FloatArray,
) -> None:  # fmt: skip
    """Write phi, h and the gradient of h of a bound on the range: a lower bound for side = 1, an upper one for -1."""
    position, velocity = state
    for i in range(position.shape[0]):
        x, y, z = position[i]
        vx, vy, vz = velocity[i]
        distance = math.sqrt(x * x + y * y + z * z)
        turning = side / distance if distance >= LENGTH_FLOOR else 0.0
        ex, ey, ez = 1.0, 0.0, 0.0
        if not distance < LENGTH_FLOOR:
            ex, ey, ez = x / distance, y / distance, z / distance
        speed = ex * vx + ey * vy + ez * vz
        gap = side * (distance - limit)
        root, slope = braking_speed(gap, acceleration)
        phi[i] = gap
        h[i] = root + side * speed
        gradient[i, 0] = side * slope * ex + turning * (vx - speed * ex)
        gradient[i, 1] = side * slope * ey + turning * (vy - speed * ey)
        gradient[i, 2] = side * slope * ez + turning * (vz - speed * ez)
        gradient[i, 3] = side * ex
        gradient[i, 4] = side * ey
        gradient[i, 5] = side * ez
