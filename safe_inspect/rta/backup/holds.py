"""Certificate that a hold is safe at every moment, and that coasting is safe from every moment of it, compiled.

The arc under constant thrust is divided into cells, see `constraints.rows`. The derivatives satisfy the
Clohessy-Wiltshire equations: if S is a bound on |v| + |a| / n over the cell, the jerk is at most 3 n^2 S and the fourth
derivative of the position at most 6 n^3 S. For k = (n D)^2 / 8, the values at the ends bound S by
(largest |v| + largest |a| / n) / (1 - 9 k).
"""

from __future__ import annotations

import math

from safe_inspect.compiling import BORROWING, njit
from safe_inspect.dynamics.cwh import RowState, cwh_row
from safe_inspect.rta.backup.half_spaces import further_broken, further_uncertain
from safe_inspect.rta.backup.model import HOLD_PIECES, FilterModel
from safe_inspect.rta.backup.sequences import SAFE, broken_at, uncertain
from safe_inspect.rta.constraints.rows import INLINED, ArcCell, Margins, Node, SunAngle, Triple, inner, node, size_of
from safe_inspect.rta.constraints.sets import PSM
from safe_inspect.types import FloatArray, IntArray


@njit(**BORROWING)
def held(m: FilterModel, x: RowState, u: FloatArray, k: int) -> RowState:
    """Return the state k / 256 of a hold after x, under the thrust u; at k = 256 bit-identical to the simulator's."""
    return cwh_row(m.hold_phi[k], m.hold_gamma[k], x, u[0], u[1], u[2])


@njit(**BORROWING)
def turned(sun: SunAngle, cos: float, sin: float) -> SunAngle:
    """Return the cosine and sine of the sun angle after a rotation."""
    return sun[0] * cos - sun[1] * sin, sun[1] * cos + sun[0] * sin


@njit(**INLINED)
def sun_after(m: FilterModel, sun: SunAngle, k: int) -> SunAngle:
    """Return the cosine and sine of the sun angle k / 256 of a hold later."""
    return turned(sun, m.hold_sun[k, 0], m.hold_sun[k, 1])


@njit(**BORROWING)
def _acceleration_at(n: float, x: RowState, w: Triple) -> Triple:
    """Return the acceleration at a state, including the acceleration w of the thrust [m/s^2]."""
    return 3.0 * n * n * x[0] + 2.0 * n * x[4] + w[0], w[1] - 2.0 * n * x[3], w[2] - n * n * x[2]


@njit(**INLINED)
def arc_cell(n: float, a: Node, b: Node, w: Triple, span: float) -> ArcCell:
    """Return a cell with the bounds that its ends give.

    Args:
        n: Mean motion [rad/s].
        a: Start of the cell.
        b: End of the cell.
        w: Constant acceleration of the thrust [m/s^2].
        span: Length of the cell [s].
    """
    first, last = _acceleration_at(n, a.state, w), _acceleration_at(n, b.state, w)
    acceleration = math.sqrt(max(inner(first, first), inner(last, last)))
    eighth = 0.125 * span * span
    k = n * n * eighth
    reach = (max(a.speed, b.speed) + acceleration / n) / (1.0 - 9.0 * k)
    bend = eighth * acceleration + 6.0 * k * k * reach / n
    p, q = a.state, b.state
    middle = p[0] + q[0], p[1] + q[1], p[2] + q[2]
    size = size_of(middle)
    e = middle[0] / size, middle[1] / size, middle[2] / size
    return ArcCell(
        a, b, first, last, eighth, k, reach, bend, 3.0 * k * reach, max(a.range, b.range) + bend, size, inner(e, p),
        inner(e, q), max(0.0, eighth * max(inner(e, first), inner(e, last)) + 6.0 * k * k * reach / n),
    )  # fmt: skip


_MOST_CELLS = 2000


@njit(**BORROWING)
def hold(
    m: FilterModel, x: RowState, sun: SunAngle, u: FloatArray, margins: Margins, work: IntArray, where: IntArray
) -> int:  # fmt: skip
    """Return a constraint that the hold of u from x may violate, or SAFE.

    Args:
        m: The task.
        x: The initial state.
        sun: Cosine and sine of the sun angle there.
        u: The thrust [N], shape (3,).
        margins: Margins of the constraints.
        work: Workspace, shape (64, 4).
        where: Receives the piece of the hold, and the entry of the coasting table, where it may be violated.
    """
    where[1] = 0
    w = (u[0] / m.mass, u[1] / m.mass, u[2] / m.mass)
    a, time, top = node(x, sun), 0, 0
    work[0, 0] = HOLD_PIECES
    while top >= 0:
        end = work[top, 0]
        b = node(held(m, x, u, end), sun_after(m, sun, end))
        where[0] = end
        code = broken_at(m.constraints, b, margins)
        if code == SAFE and m.further:
            code = further_broken(m, b.state, margins)
        if code != SAFE:
            return int(code)
        cell = arc_cell(m.n, a, b, w, (end - time) * (m.dt / HOLD_PIECES))
        code = uncertain(m.constraints, cell, margins)
        if code == SAFE and m.further:
            code = further_uncertain(m, cell, margins)
        if code == SAFE:
            a, time = b, end
            top -= 1
            continue
        if end - time <= 1:
            return int(code)
        top += 1
        work[top, 0] = time + (end - time) // 2
    if m.near_psm > 0.0 and not _coasting(m, x, u, margins.coasting, work, where):
        return PSM
    return SAFE


@njit(**BORROWING)
def coasted(m: FilterModel, x: RowState, u: FloatArray, k: int, j: int) -> tuple[float, float, float]:
    """Return the position after the thrust u for k / 256 of a hold, followed by coasting, in Hill's frame [m].

    The time of coasting is j `coast_step`, see `FilterModel`.
    """
    b, phi = held(m, x, u, k), m.coast[j]
    return (
        phi[0, 0] * b[0] + phi[0, 3] * b[3] + phi[0, 4] * b[4],
        phi[1, 0] * b[0] + b[1] + phi[1, 3] * b[3] + phi[1, 4] * b[4],
        phi[2, 2] * b[2] + phi[2, 5] * b[5],
    )


@njit(**BORROWING)
def _remains(dip: float, one: float, other: float) -> float:
    """Return how far a dip below a chord extends below the chord's lower end; see `lowest`.

    The rise of the chord is between the numbers `one` and `other`.
    """
    rise = min(abs(one), abs(other)) if one * other > 0.0 else 0.0
    return 0.0 if rise >= 4.0 * dip else dip * (1.0 - 0.25 * rise / dip) ** 2


@njit(**BORROWING)
def coasting_bends(m: FilterModel, x: RowState, end: RowState, u: FloatArray) -> tuple[float, float]:
    """Return bounds on the second derivatives of the position after a part of a hold and coasting [m/s^2].

    They are those with respect to the time of thrust and to the time of coasting. Speed, acceleration and range over
    the hold are bounded with S for the whole hold.

    Args:
        m: The model.
        x: State at the start of the hold.
        end: State at its end.
        u: The thrust [N].
    """
    n = m.n
    thrust = size_of((u[0] / m.mass, u[1] / m.mass, u[2] / m.mass))
    range_, speed = max(size_of(x), size_of(end)), max(size_of(x[3:]), size_of(end[3:]))
    k = 0.125 * n * n * m.dt * m.dt
    top_a = thrust + 3.0 * n * n * range_ + 2.0 * n * speed
    s = (speed + top_a / n) / (1.0 - 9.0 * k)
    fastest = speed + 3.0 * k * s
    hardest = top_a + 6.0 * k * n * s
    farthest = range_ + 0.125 * m.dt * m.dt * hardest
    jerk = n * (3.0 * n * fastest + 2.0 * hardest)
    bend_t = m.stretch[0] * hardest + m.stretch[1] * jerk
    coasting = n * (3.0 * n * farthest + 2.0 * fastest)
    return bend_t, m.stretch[2] * coasting + m.stretch[3] * fastest


@njit(**BORROWING)
def _coasting(m: FilterModel, x: RowState, u: FloatArray, length: float, work: IntArray, where: IntArray) -> bool:
    """Return whether the range is above the radius at every moment of the hold and of coasting from it.

    The position is a smooth function P(t, s) of the time t of thrust and the time s of coasting. On a rectangle, e.P is
    at least its least value at a corner, minus the largest second derivatives in t and s times the squared sides / 8.
    """
    bend_t, bend_s = coasting_bends(m, x, held(m, x, u, HOLD_PIECES), u)
    reach = m.near_psm + length
    base, last = 64, m.coast.shape[0] - 1
    cells = 0
    for first in range(0, last, base):
        top = 0
        work[0, 0], work[0, 1], work[0, 2], work[0, 3] = 0, HOLD_PIECES, first, first + base
        while top >= 0:
            t0, t1, s0, s1 = work[top, 0], work[top, 1], work[top, 2], work[top, 3]
            top -= 1
            cells += 1
            p, q = coasted(m, x, u, t0, s0), coasted(m, x, u, t0, s1)
            f, g = coasted(m, x, u, t1, s0), coasted(m, x, u, t1, s1)
            e = p[0] + q[0] + f[0] + g[0], p[1] + q[1] + f[1] + g[1], p[2] + q[2] + f[2] + g[2]
            size = size_of(e)
            if size > 0.0:
                e = e[0] / size, e[1] / size, e[2] / size
            pe, qe, fe, ge = inner(e, p), inner(e, q), inner(e, f), inner(e, g)
            dt, ds = (t1 - t0) * (m.dt / HOLD_PIECES), (s1 - s0) * m.coast_step
            dip_t, dip_s = 0.125 * dt * dt * bend_t, 0.125 * ds * ds * bend_s
            bend = _remains(dip_t, fe - pe, ge - qe) + _remains(dip_s, qe - pe, ge - fe)
            if min(min(pe, qe), min(fe, ge)) - bend >= reach:
                continue
            for corner, t, s in ((g, t1, s1), (f, t1, s0), (q, t0, s1)):
                where[0], where[1] = t, s
                if inner(corner, corner) < reach * reach:
                    return False
            if cells > _MOST_CELLS or (t1 - t0 <= 1 and s1 - s0 <= 1):
                where[0], where[1] = t1, s1
                return False
            # Halve the side along which the corners are farther apart.
            along_t = (f[0] - p[0]) ** 2 + (f[1] - p[1]) ** 2 + (f[2] - p[2]) ** 2
            along_t = max(along_t, (g[0] - q[0]) ** 2 + (g[1] - q[1]) ** 2 + (g[2] - q[2]) ** 2)
            along_s = (q[0] - p[0]) ** 2 + (q[1] - p[1]) ** 2 + (q[2] - p[2]) ** 2
            along_s = max(along_s, (g[0] - f[0]) ** 2 + (g[1] - f[1]) ** 2 + (g[2] - f[2]) ** 2)
            halve_t = s1 - s0 <= 1 or (t1 - t0 > 1 and along_t + dip_t * dip_t > along_s + dip_s * dip_s)
            middle = t0 + (t1 - t0) // 2 if halve_t else s0 + (s1 - s0) // 2
            for half in range(2):
                top += 1
                work[top, 0], work[top, 1], work[top, 2], work[top, 3] = t0, t1, s0, s1
                if halve_t:
                    work[top, half] = middle
                else:
                    work[top, 2 + half] = middle
    return True
