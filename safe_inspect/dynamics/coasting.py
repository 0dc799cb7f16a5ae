"""Closed-form motion without thrust in CWH dynamics, compiled, one state at a time.

Each function solves the same equations (Clohessy and Wiltshire, "Terminal guidance system for satellite rendezvous", J.
Aerospace Sciences 27, 1960) for the quantities that its callers need, with its own order of operations.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from safe_inspect.compiling import njit
from safe_inspect.dynamics.cwh import RowState
from safe_inspect.types import FloatArray

#: Largest cell of the grid, as an angle of the orbit [rad]; the range squared contains no frequency above 2 n.
CELL = 0.1
_FEWEST_CELLS = 4
_STEPS = 60
_TOLERANCE = 1e-9


@njit
def coast(p: FloatArray, v: FloatArray, t: float, s: float, c: float, n: float) -> tuple[float, ...]:
    """Return position, velocity, range squared, and half of the latter's first and second derivatives at time t.

    Args:
        p: Position at time 0 [m].
        v: Velocity at time 0 [m/s].
        t: Time [s].
        s: sin(n t).
        c: cos(n t).
        n: Mean motion [rad/s].
    """
    x = (4.0 - 3.0 * c) * p[0] + (s * v[0] + 2.0 * (1.0 - c) * v[1]) / n
    y = 6.0 * (s - n * t) * p[0] + p[1] - (2.0 * (1.0 - c) * v[0] - 4.0 * s * v[1]) / n - 3.0 * t * v[1]
    z = c * p[2] + s * v[2] / n
    vx = 3.0 * n * s * p[0] + c * v[0] + 2.0 * s * v[1]
    vy = 6.0 * n * (c - 1.0) * p[0] - 2.0 * s * v[0] + (4.0 * c - 3.0) * v[1]
    vz = c * v[2] - n * s * p[2]
    ax, ay, az = 3.0 * n * n * x + 2.0 * n * vy, -2.0 * n * vx, -n * n * z
    first = x * vx + y * vy + z * vz
    second = vx * vx + vy * vy + vz * vz + x * ax + y * ay + z * az
    return x, y, z, vx, vy, vz, x * x + y * y + z * z, first, second


@njit(error_model="numpy")
def coasting_position(n: float, x: RowState, angle: float, cos: float, sin: float) -> tuple[float, float, float]:
    """Return the position [m] after coasting through the orbit angle n t, given with its cosine and sine."""
    u, v, w = x[3] / n, x[4] / n, x[5] / n
    return (
        4.0 * x[0] + 2.0 * v - cos * (3.0 * x[0] + 2.0 * v) + sin * u,
        x[1] - 2.0 * (1.0 - cos) * u + 2.0 * sin * (3.0 * x[0] + 2.0 * v) - 3.0 * angle * (2.0 * x[0] + v),
        cos * x[2] + sin * w,
    )


@njit(error_model="numpy")
def closed_motion_state(n: float, x: RowState, cos: float, sin: float) -> RowState:
    """Return the state of the drift-free motion from x, v_y = -2 n x, after the angle n t with this cosine and sine."""
    px = cos * x[0] + sin * x[3] / n
    return (
        px,
        x[1] - 2.0 * (1.0 - cos) * x[3] / n - 2.0 * sin * x[0],
        cos * x[2] + sin * x[5] / n,
        cos * x[3] - n * sin * x[0],
        -2.0 * n * px,
        cos * x[5] - n * sin * x[2],
    )


@lru_cache(maxsize=64)
def grid(n: float, horizon: float, cell: float = CELL) -> FloatArray:
    """Return the times of the grid and their terms: t, sin nt, cos nt, shape (K, 3).

    Args:
        n: Mean motion [rad/s].
        horizon: Span of the grid [s].
        cell: Largest cell, as an angle of the orbit [rad].
    """
    cells = max(_FEWEST_CELLS, math.ceil(n * horizon / cell))
    time = np.linspace(0.0, horizon, cells + 1)
    table = np.stack((time, np.sin(n * time), np.cos(n * time)), axis=-1)
    table.setflags(write=False)
    return table


@njit
def _turn(p: FloatArray, v: FloatArray, low: float, high: float, sign: float, n: float) -> float:
    """Return the time of the zero of the squared range's second derivative in (low, high) [s], by bisection.

    The second derivative has the given sign at `high`.
    """
    for _ in range(_STEPS):
        middle = 0.5 * (low + high)
        if sign * coast(p, v, middle, math.sin(n * middle), math.cos(n * middle), n)[8] < 0.0:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


@njit
def _approach(p: FloatArray, v: FloatArray, low: float, high: float, start: float, n: float, sign: float) -> float:
    """Return the time in (low, high) of the minimum of sign * range [s], by bracketed Newton iterations."""
    t = start
    for _ in range(_STEPS):
        now = coast(p, v, t, math.sin(n * t), math.cos(n * t), n)
        first, second = sign * now[7], sign * now[8]
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
def extreme_time(p: FloatArray, v: FloatArray, table: FloatArray, n: float, sign: float) -> float:
    """Return the time within the grid's span at which sign * range is smallest [s]; sign is 1 or -1."""
    a, f_a, g_a = 0.0, 0.0, 0.0
    best, best_f = 0.0, 0.0
    for k in range(table.shape[0]):
        b = table[k, 0]
        node = coast(p, v, b, table[k, 1], table[k, 2], n)
        f_b, g_b, square = sign * node[7], sign * node[8], sign * node[6]
        if k == 0 or square < best_f:
            best, best_f = b, square
        if k > 0:
            low, high = a, b
            found = f_a < 0.0 <= f_b
            if not found and f_a * f_b > 0.0 and f_a * g_a < 0.0 and f_b * g_b > 0.0:
                # It falls at both ends or rises at both: the tangents of the derivative show if it may turn in between.
                meet = (f_b - f_a + g_a * a - g_b * b) / (g_a - g_b)
                if f_a * (f_a + g_a * (meet - a)) < 0.0:
                    meet = _turn(p, v, a, b, sign if g_b > 0.0 else -sign, n)
                    between = sign * coast(p, v, meet, math.sin(n * meet), math.cos(n * meet), n)[7]
                    found = f_a * between < 0.0
                    if f_a > 0.0:
                        low, high = meet, b
                    else:
                        low, high = a, meet
            if found:
                start = 0.5 * (low + high)
                if low == a and high == b:
                    start = a - f_a * (b - a) / (f_b - f_a)
                t = _approach(p, v, low, high, start, n, sign)
                square = sign * coast(p, v, t, math.sin(n * t), math.cos(n * t), n)[6]
                if square < best_f:
                    best, best_f = t, square
        a, f_a, g_a = b, f_b, g_b
    return best


@njit
def least_coasting_range(p: FloatArray, v: FloatArray, table: FloatArray, n: float) -> float:
    """Return the smallest range over the grid's span without thrust [m].

    Args:
        p: Position in Hill's frame [m], shape (3,).
        v: Velocity [m/s], shape (3,).
        table: See `grid`.
        n: Mean motion [rad/s].
    """
    t = extreme_time(p, v, table, n, 1.0)
    return math.sqrt(coast(p, v, t, math.sin(n * t), math.cos(n * t), n)[6])


@njit
def largest_coasting_range(p: FloatArray, v: FloatArray, table: FloatArray, n: float) -> float:
    """Return the largest range over the grid's span without thrust [m]; arguments as for `least_coasting_range`."""
    t = extreme_time(p, v, table, n, -1.0)
    return math.sqrt(coast(p, v, t, math.sin(n * t), math.cos(n * t), n)[6])
