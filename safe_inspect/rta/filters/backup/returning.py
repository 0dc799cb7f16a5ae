"""Return control for a state for which no backup plan is found, compiled."""

from __future__ import annotations

import math

from safe_inspect.compiling import BORROWING, njit
from safe_inspect.dynamics.cwh import RowState
from safe_inspect.rta.constraints.certified import PSM
from safe_inspect.rta.constraints.rows import Margins, Node, SunAngle, node
from safe_inspect.rta.filters.backup.arcs import held, turned
from safe_inspect.rta.filters.backup.cuts import add, cut_near, support
from safe_inspect.rta.filters.backup.half_spaces import further_slack
from safe_inspect.rta.filters.backup.model import FURTHER, HOLD_PIECES, FilterModel
from safe_inspect.rta.filters.backup.sequences import bits_of, gap_of, least_allowed_speed, turn_of
from safe_inspect.rta.filters.backup.workspace import Workspace, as_bool, as_int
from safe_inspect.rta.numerics.projection import nearest
from safe_inspect.types import FloatArray

#: Distance inside the limits that the return control aims for [m].
INSIDE = 5.0
_ROUNDS = 5
#: Reserve of speed [m/s].
_SPARE = Margins(0.0, 1e-5, 0.0)
_NO_MARGINS = Margins(0.0, 0.0, 0.0)
#: Violations below this [m], [m/s] are ignored.
_MET = 1e-6
#: Bits of the constraints that are distances, which must grow, and of those that rotate with the sun.
_DISTANCES, _TURNING = bits_of("gap"), bits_of("turn")


@njit(**BORROWING)
def _allowed(m: FilterModel, at: Node) -> float:
    """Return half of the speed allowed at a position [m/s]."""
    return float(0.5 * max(0.0, min(least_allowed_speed(m.constraints, at)[0], m.u_max / m.mass * m.dt)))


@njit(**BORROWING)
def _to_rate(m: FilterModel, code: int, sun: SunAngle, d: FloatArray) -> None:
    """Replace a direction of positions by that of its rate of change."""
    for j in range(3):
        d[3 + j], d[j] = d[j], 0.0
    if _TURNING >> code & 1:
        turn_of(m.constraints, code, sun, d)


@njit(**BORROWING)
def _ask(m: FilterModel, need: float, b: RowState, u: FloatArray, s: Workspace, count: int) -> tuple[int, bool]:
    """Append d.state >= need for the direction in `s.d` unless u satisfies it; return the count and whether it was."""
    short = need
    for j in range(6):
        short -= s.d[j] * b[j]
    if not short > _MET:
        return count, False
    return add(m, need, b, u, as_int(HOLD_PIECES), s, count), True


@njit(**BORROWING)
def _bounds_speeds(d: FloatArray) -> bool:
    return bool(d[3] != 0.0 or d[4] != 0.0 or d[5] != 0.0)


@njit(**BORROWING)
def return_control(m: FilterModel, x: RowState, sun: SunAngle, out: FloatArray, s: Workspace) -> int:
    """Write the least-violating return control, the smallest if there are several; return the bits of its constraints.

    It must satisfy, for the state after the hold: speeds are within their limits; each distance that is less than
    `INSIDE` (from the chief, the largest range, the sun cone) grows at half the allowed speed and, if it was not
    negative, is not negative; and coasting misses the chief. The half-spaces have unit normals, so violations are in
    newtons. Each round adds the conditions that the last control violates. The desired control is ignored.
    """
    k, count, bits = HOLD_PIECES, as_int(0), 0
    now = node(x, sun)
    rate = _allowed(m, now)
    sun_b = turned(sun, m.hold_sun[k, 0], m.hold_sun[k, 1])
    for axis in range(3):
        s.trial[axis], out[axis] = 0.0, 0.0
    for _ in range(_ROUNDS):
        b, before = held(m, x, out, k), count
        end = node(b, sun_b)
        for code in range(FURTHER + m.further):
            if not m.active >> code & 1:
                continue
            need = support(m, code, end, _SPARE, s.d)
            if _DISTANCES >> code & 1 or (code >= FURTHER and not _bounds_speeds(s.d)):
                gap = further_slack(m, code, x) if code >= FURTHER else gap_of(m.constraints, code, now)
                asked = False
                if gap < INSIDE:
                    count, asked = _ask(m, need if gap >= 0.0 else -math.inf, b, out, s, count)
                    _to_rate(m, code, sun_b, s.d)
                    count, more = _ask(m, rate, b, out, s, count)
                    asked = asked or more
            else:
                count, asked = _ask(m, need, b, out, s, count)
            if asked:
                bits |= 1 << code
        if now.range > m.near_psm:
            psm = count
            count = cut_near(m, x, out, as_bool(False), as_bool(False), _NO_MARGINS, s, count)
            if count > psm:
                bits |= 1 << PSM
        if count == before:
            break
        _to_unit(s.rows, s.bounds, count)
        nearest(s.rows, s.bounds, count, m.u_max, s.trial, as_bool(True), s.proposal, s.missed, s.projection)
        for axis in range(3):
            out[axis] = s.proposal[axis]
    return bits


@njit(**BORROWING)
def _to_unit(rows: FloatArray, bounds: FloatArray, count: int) -> None:
    for i in range(count):
        size = math.sqrt(rows[i, 0] ** 2 + rows[i, 1] ** 2 + rows[i, 2] ** 2)
        if size > 1e-12:
            bounds[i] /= size
            for axis in range(3):
                rows[i, axis] /= size
