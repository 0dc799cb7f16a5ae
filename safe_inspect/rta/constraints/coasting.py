"""Closest approach to the chief of a deputy that coasts, compiled, one state at a time."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from safe_inspect.compiling import njit
from safe_inspect.dynamics.coasting import coast
from safe_inspect.types import FloatArray

#: Widest cell of the grid, as an angle of the orbit [rad]; the range squared holds no frequency above 2 n.
CELL = 0.1
#: Below this range [m] at the closest approach, coasting counts as a hit on the centre.
LENGTH_FLOOR = 1e-6
_FEWEST_CELLS = 4
_STEPS = 60
_TOLERANCE = 1e-9


@lru_cache(maxsize=64)
def grid(n: float, horizon: float) -> FloatArray:
    """Return the times of the grid and their terms: t, sin nt, cos nt, shape (K, 3)."""
    cells = max(_FEWEST_CELLS, math.ceil(n * horizon / CELL))
    time = np.linspace(0.0, horizon, cells + 1)
    table = np.stack((time, np.sin(n * time), np.cos(n * time)), axis=-1)
    table.setflags(write=False)
    return table


@njit
def _turn(p: FloatArray, v: FloatArray, low: float, high: float, sign: float, n: float) -> float:
    """Return the time in (low, high) at which the second derivative, of that sign at `high`, is zero; by bisection."""
    for _ in range(_STEPS):
        middle = 0.5 * (low + high)
        if sign * coast(p, v, middle, math.sin(n * middle), math.cos(n * middle), n)[8] < 0.0:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


@njit
def _approach(p: FloatArray, v: FloatArray, low: float, high: float, start: float, n: float) -> float:
    """Return the time in (low, high) at which the range stops falling; Newton's method, held in the bracket."""
    t = start
    for _ in range(_STEPS):
        now = coast(p, v, t, math.sin(n * t), math.cos(n * t), n)
        first, second = now[7], now[8]
        if first < 0.0:
            low = t
        else:
            high = t
        following = 0.5 * (low + high)
        if second > 0.0:
            newton = t - first / second
            if abs(newton - t) <= _TOLERANCE:
                return min(max(newton, low), high)
            if low < newton < high:
                following = newton
        if high - low <= _TOLERANCE:
            return following
        t = following
    return t


@njit
def _least(p: FloatArray, v: FloatArray, table: FloatArray, n: float) -> float:
    """Return the time of the closest approach over the grid's span."""
    a, f_a, g_a = 0.0, 0.0, 0.0
    best, best_f = 0.0, 0.0
    for k in range(table.shape[0]):
        b = table[k, 0]
        node = coast(p, v, b, table[k, 1], table[k, 2], n)
        f_b, g_b, square = node[7], node[8], node[6]
        if k == 0 or square < best_f:
            best, best_f = b, square
        if k > 0:
            low, high = a, b
            found = f_a < 0.0 <= f_b
            if not found and f_a * f_b > 0.0 and f_a * g_a < 0.0 and f_b * g_b > 0.0:
                # falling at both ends or rising at both: the tangents of the derivative say if it may turn between
                meet = (f_b - f_a + g_a * a - g_b * b) / (g_a - g_b)
                if f_a * (f_a + g_a * (meet - a)) < 0.0:
                    meet = _turn(p, v, a, b, 1.0 if g_b > 0.0 else -1.0, n)
                    between = coast(p, v, meet, math.sin(n * meet), math.cos(n * meet), n)[7]
                    found = f_a * between < 0.0
                    if f_a > 0.0:
                        low, high = meet, b
                    else:
                        low, high = a, meet
            if found:
                start = 0.5 * (low + high)
                if low == a and high == b:
                    start = a - f_a * (b - a) / (f_b - f_a)
                t = _approach(p, v, low, high, start, n)
                square = coast(p, v, t, math.sin(n * t), math.cos(n * t), n)[6]
                if square < best_f:
                    best, best_f = t, square
        a, f_a, g_a = b, f_b, g_b
    return best


@njit
def _across(vx: float, vy: float, vz: float) -> tuple[float, float, float]:
    """Return a unit vector across the velocity; +x where the velocity is zero."""
    in_plane, whole = math.sqrt(vx * vx + vy * vy), math.sqrt(vx * vx + vy * vy + vz * vz)
    if not in_plane > 1e-9 * whole:
        return 1.0, 0.0, 0.0
    return -vy / in_plane, vx / in_plane, 0.0


@njit
def passive_safety(
    position: FloatArray, velocity: FloatArray, table: FloatArray, n: float, radius: float,
    phi: FloatArray, h: FloatArray, gradient: FloatArray,
) -> None:  # fmt: skip
    """Write the least coasting range less the radius, and its gradient by the envelope theorem."""
    for i in range(position.shape[0]):
        p, v = position[i], velocity[i]
        t = _least(p, v, table, n)
        s, c = math.sin(n * t), math.cos(n * t)
        x, y, z, vx, vy, vz, square, _, _ = coast(p, v, t, s, c, n)
        distance = math.sqrt(square)
        if distance < LENGTH_FLOOR:
            ex, ey, ez = _across(vx, vy, vz)
        else:
            ex, ey, ez = x / distance, y / distance, z / distance
        phi[i] = distance - radius
        h[i] = distance - radius
        gradient[i, 0] = (4.0 - 3.0 * c) * ex + 6.0 * (s - n * t) * ey
        gradient[i, 1] = ey
        gradient[i, 2] = c * ez
        gradient[i, 3] = (s * ex - 2.0 * (1.0 - c) * ey) / n
        gradient[i, 4] = (2.0 * (1.0 - c) * ex + 4.0 * s * ey) / n - 3.0 * t * ey
        gradient[i, 5] = s * ez / n
