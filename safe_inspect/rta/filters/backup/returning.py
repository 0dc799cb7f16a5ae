"""The way back for a state from which no backup plan is known, compiled."""

from __future__ import annotations

import math

from safe_inspect.compiling import njit
from safe_inspect.dynamics.cwh_row import RowState
from safe_inspect.rta.filters.backup.arcs import held, sun_gap, turned
from safe_inspect.rta.filters.backup.cuts import add, cut_near, support
from safe_inspect.rta.filters.backup.half_spaces import further_slack
from safe_inspect.rta.filters.backup.model import COLLISION, FURTHER, HOLD_PIECES, INNER, PSM, R_MAX, SUN, Model
from safe_inspect.rta.filters.backup.scratch import Scratch, plain
from safe_inspect.rta.numerics.projection import nearest
from safe_inspect.types import FloatArray

#: How far inside the limits the way back leads [m].
INSIDE = 5.0
#: Beyond this part of v / (2 n), v the largest along-track speed, closed motions are too fast: the way leads inside.
_CLOSABLE = 0.9
_ROUNDS = 5
#: Speed to spare [m/s].
_SPARE = 1e-5
#: What is broken by less than this [m], [m/s] counts as met.
_MET = 1e-6


@njit(**INNER)
def _allowed(m: Model, x: RowState) -> float:
    """Return half of the speed that is allowed at a position [m/s]."""
    r = math.sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2])
    slowest = min(m.limit[0], min(m.limit[1], m.limit[2]))
    return float(0.5 * max(0.0, min(slowest, min(m.v0 + m.v1 * (r - m.d0), m.u_max / m.mass * m.dt))))


@njit(**INNER)
def _to_rate(m: Model, code: int, sun: tuple[float, float], d: FloatArray) -> None:
    """Replace a direction of positions by that of its rate of change; the sun cone's normal turns with the sun."""
    for j in range(3):
        d[3 + j], d[j] = d[j], 0.0
    if code == SUN:
        ca, sa = sun
        along, across = sa * d[4] - ca * d[3], -sa * d[3] - ca * d[4]
        d[0], d[1] = m.n * (along * sa - across * ca), m.n * (along * ca + across * sa)


@njit(**INNER)
def _ask(m: Model, need: float, b: RowState, u: FloatArray, s: Scratch, count: int) -> tuple[int, bool]:
    """Append d.state >= need for the direction in `s.d` unless u meets it; return the count and whether it was."""
    short = need
    for j in range(6):
        short -= s.d[j] * b[j]
    if not short > _MET:
        return count, False
    return add(m, s.d, need, b, u, HOLD_PIECES, s.rows, s.bounds, count), True


@njit(**INNER)
def _bounds_speeds(d: FloatArray) -> bool:
    return bool(d[3] != 0.0 or d[4] != 0.0 or d[5] != 0.0)


@njit(**INNER)
def return_control(m: Model, x: RowState, sun: tuple[float, float], out: FloatArray, s: Scratch) -> int:
    """Write the least-violating control of the way back, and of such the smallest; return the bits of what shapes it.

    Asked of the state after the hold: the speeds within their limits, each distance that is less than `INSIDE` (from
    the chief, the largest range, the sun cone) growing at half the allowed speed and, if it was not negative, not
    negative; coasting on must miss the chief. The half-spaces have unit normals, so violations are in newtons. Each
    round adds those that the last control breaks. The desired control has no say.
    """
    k, count, bits = HOLD_PIECES, plain(0), 0
    rate = _allowed(m, x)
    sun_b = turned(sun, m.hold_sun[k, 0], m.hold_sun[k, 1])
    r = math.sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2])
    far = min(m.far, _CLOSABLE * m.limit[1] / (2.0 * m.n))
    for axis in range(3):
        s.trial[axis], out[axis] = 0.0, 0.0
    for _ in range(_ROUNDS):
        b, before = held(m, x, out, k), count
        for code in range(FURTHER + m.further):
            if code == PSM or (code == SUN and not m.sun) or (code == R_MAX and not math.isfinite(m.far)):
                continue
            need = support(m, code, b, sun_b, 0.0, _SPARE, s.d)
            if code in (COLLISION, SUN, R_MAX) or (code >= FURTHER and not _bounds_speeds(s.d)):
                if code >= FURTHER:
                    gap = further_slack(m, code, x)
                else:
                    gap = r - m.near if code == COLLISION else (far - r if code == R_MAX else sun_gap(m, x, sun))
                if gap < INSIDE:
                    count, asked = _ask(m, need if gap >= 0.0 else -math.inf, b, out, s, count)
                    _to_rate(m, code, sun_b, s.d)
                    count, more = _ask(m, rate, b, out, s, count)
                    asked = asked or more
                else:
                    asked = False
            else:
                count, asked = _ask(m, need, b, out, s, count)
            if asked:
                bits |= 1 << code
        if r > m.near_psm:
            psm = count
            count = cut_near(m, x, out, False, False, 0.0, s.d, s.rows, s.bounds, count)
            if count > psm:
                bits |= 1 << PSM
        if count == before:
            break
        _to_unit(s.rows, s.bounds, count)
        nearest(s.rows, s.bounds, count, m.u_max, s.trial, True, s.proposal, s.missed, s.a, s.c, s.size, s.w)
        for axis in range(3):
            out[axis] = s.proposal[axis]
    return bits


@njit(**INNER)
def _to_unit(rows: FloatArray, bounds: FloatArray, count: int) -> None:
    for i in range(count):
        size = math.sqrt(rows[i, 0] ** 2 + rows[i, 1] ** 2 + rows[i, 2] ** 2)
        if size > 1e-12:
            bounds[i] /= size
            for axis in range(3):
                rows[i, axis] /= size
