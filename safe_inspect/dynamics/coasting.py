"""Closed-form motion without thrust in CWH dynamics, compiled, one state at a time.

Each function solves the same equations (Clohessy and Wiltshire, "Terminal guidance system for satellite rendezvous",
J. Aerospace Sciences 27, 1960) for what its callers need, in an order of operations of its own.
"""

from __future__ import annotations

from safe_inspect.compiling import njit
from safe_inspect.dynamics.cwh_row import RowState
from safe_inspect.types import FloatArray


@njit
def coast(p: FloatArray, v: FloatArray, t: float, s: float, c: float, n: float) -> tuple[float, ...]:
    """Return position, velocity, range squared, half its first and half its second derivative at time t."""
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
    """Return the position [m] after coasting through that angle n t, whose cosine and sine are given."""
    u, v, w = x[3] / n, x[4] / n, x[5] / n
    return (
        4.0 * x[0] + 2.0 * v - cos * (3.0 * x[0] + 2.0 * v) + sin * u,
        x[1] - 2.0 * (1.0 - cos) * u + 2.0 * sin * (3.0 * x[0] + 2.0 * v) - 3.0 * angle * (2.0 * x[0] + v),
        cos * x[2] + sin * w,
    )


@njit(error_model="numpy")
def closed_motion_state(n: float, x: RowState, cos: float, sin: float) -> RowState:
    """Return the state of the drift-free motion from x, v_y = -2 n x, after the angle n t of that cosine and sine."""
    px = cos * x[0] + sin * x[3] / n
    return (
        px,
        x[1] - 2.0 * (1.0 - cos) * x[3] / n - 2.0 * sin * x[0],
        cos * x[2] + sin * x[5] / n,
        cos * x[3] - n * sin * x[0],
        -2.0 * n * px,
        cos * x[5] - n * sin * x[2],
    )
