"""The way back for a state from which no backup plan is known, compiled."""

from __future__ import annotations

import math

from numba import njit

from safe_inspect.rta.filters.arcs import State, held, sun_gap, turned
from safe_inspect.rta.filters.cuts import add, cut_near, support
from safe_inspect.rta.filters.model import COLLISION, HOLD_PIECES, PSM, R_MAX, SUN, X_VEL, Model
from safe_inspect.rta.filters.projection import nearest
from safe_inspect.rta.filters.scratch import Scratch
from safe_inspect.types import FloatArray

#: How far inside the limits the way back leads [m].
INSIDE = 5.0
_ROUNDS = 4


@njit(cache=True)  # type: ignore[misc,untyped-decorator]
def _allowed(m: Model, x: State) -> float:
    """Return half of the speed that is allowed at a position [m/s]."""
    r = math.sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2])
    slowest = min(m.limit[0], min(m.limit[1], m.limit[2]))
    return float(0.5 * max(0.0, min(slowest, min(m.v0 + m.v1 * (r - m.d0), m.u_max / m.mass * m.dt))))


@njit(cache=True)  # type: ignore[misc,untyped-decorator]
def return_control(
    m: Model, x: State, sun: tuple[float, float], desired: FloatArray, out: FloatArray, s: Scratch
) -> int:  # fmt: skip
    """Write the least-violating control of the way back; return the bits of the constraints that shape it.

    Asked of the state after the hold: the speeds within their limits, and each distance that is less than `INSIDE`
    (from the chief, the largest range, the sun cone) grown by half the allowed speed times the hold, up to `INSIDE`;
    coasting on must miss the chief. The half-spaces have unit normals, so violations are in newtons.
    """
    from_rest = _allowed(m, x) * m.dt
    k, bits = HOLD_PIECES, 0
    sun_b = turned(sun, m.hold_sun[k, 0], m.hold_sun[k, 1])
    r = math.sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2])
    for axis in range(3):
        out[axis] = 0.0
    for _ in range(_ROUNDS):
        b, count, bits = held(m, x, out, k), 0, 0
        for code in range(8):
            if (code == SUN and not m.sun) or code == PSM:
                continue
            if code == COLLISION and m.near <= 0.0:
                continue
            want = 0.0
            if code in (COLLISION, SUN, R_MAX):
                gap = r - m.near if code == COLLISION else (m.far - r if code == R_MAX else sun_gap(m, x, sun))
                if not gap < INSIDE:
                    continue
                want = min(INSIDE, gap + from_rest)
            need = support(m, code, b, sun_b, want, 0.0, s.d)
            if not math.isfinite(need):
                continue
            count = add(m, s.d, need, b, out, k, s.rows, s.bounds, count)
            value = need
            for j in range(6):
                value -= s.d[j] * b[j]
            if value > 0.0 or code < X_VEL:
                bits |= 1 << code
        if r > m.near_psm:
            before = count
            count = cut_near(m, x, out, False, False, 0.0, s.d, s.rows, s.bounds, count)
            if count > before:
                bits |= 1 << PSM
        _to_unit(s.rows, s.bounds, count)
        nearest(s.rows, s.bounds, count, m.u_max, desired, True, s.proposal, s.missed, s.a, s.c, s.size, s.w)
        for axis in range(3):
            out[axis] = s.proposal[axis]
    return bits


@njit(cache=True)  # type: ignore[misc,untyped-decorator]
def _to_unit(rows: FloatArray, bounds: FloatArray, count: int) -> None:
    for i in range(count):
        size = math.sqrt(rows[i, 0] ** 2 + rows[i, 1] ** 2 + rows[i, 2] ** 2)
        if size > 1e-12:
            bounds[i] /= size
            for axis in range(3):
                rows[i, axis] /= size
