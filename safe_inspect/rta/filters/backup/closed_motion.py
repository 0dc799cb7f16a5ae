"""Is a closed natural motion safe for ever? One orbit decides, for the motion and the sun have the same period.

Without drift, v_y = -2 n x, the position is a constant (0, y_c, 0) plus an oscillation o with the orbit's period, and
every derivative with respect to the angle tau = n t of the orbit is at most rho = sqrt(4 A^2 + B^2) long, A and B the
amplitudes in x and z. The orbit is cut into cells of angle D, which their ends certify or which are halved, with the
bounds of `arcs`; they are sharper here, for p'' = -o and |p''''| <= rho.
"""

from __future__ import annotations

import math

from safe_inspect.compiling import njit
from safe_inspect.dynamics.cwh_row import RowState
from safe_inspect.rta.filters.backup.arcs import SAFE, lowest, turned
from safe_inspect.rta.filters.backup.half_spaces import further_closed_motion
from safe_inspect.rta.filters.backup.model import (
    COLLISION,
    FINEST,
    ORBIT_CELLS,
    R_MAX,
    REL_VEL,
    SUN,
    X_VEL,
    Y_VEL,
    Z_VEL,
    Model,
)
from safe_inspect.types import FloatArray

#: Columns of a node: angle in finest cells, x, y, z, range, speed / n, the position along and across the sun cone's
#: axis, cosine and sine of the sun angle.
_COLUMNS = 10
#: Room that `closed_motion` needs.
ROOM = (ORBIT_CELLS + 1 + 16, _COLUMNS)


@njit(error_model="numpy")
def _node(
    m: Model, x: RowState, sun: tuple[float, float], cos: float, sin: float, near: float, length: float, speed: float,
    out: FloatArray,
) -> int:  # fmt: skip
    """Write a node; return a constraint that is broken there, or SAFE."""
    u, w = x[3] / m.n, x[5] / m.n
    px, pz = cos * x[0] + sin * u, cos * x[2] + sin * w
    py = x[1] - 2.0 * (1.0 - cos) * u - 2.0 * sin * x[0]
    vx, vz = cos * u - sin * x[0], cos * w - sin * x[2]
    ca, sa = turned(sun, cos, sin)
    r = math.sqrt(px * px + py * py + pz * pz)
    qc, qk = sa * py - ca * px, -sa * px - ca * py
    out[1], out[2], out[3], out[4], out[6], out[7], out[8], out[9] = px, py, pz, r, qc, qk, ca, sa
    out[5] = math.sqrt(vx * vx + 4.0 * px * px + vz * vz)
    if r < near + length:
        return COLLISION
    if m.sun and m.cos_b * math.sqrt(qk * qk + pz * pz) - m.sin_b * qc < length:
        return SUN
    if m.n * out[5] > m.v0 + m.v1 * (r - m.d0) - speed:
        return REL_VEL
    if r > m.far - length:
        return R_MAX
    return SAFE


@njit(error_model="numpy")
def _uncertain(
    m: Model, a: FloatArray, b: FloatArray, centre: float, rho: float, span: float,
    near: float, length: float, speed: float,
) -> int:  # fmt: skip
    """Return a constraint that a cell's ends cannot certify, or SAFE."""
    k = 0.125 * span * span
    farthest = max(a[4], b[4]) + k * rho
    if farthest > m.far - length and lowest(-a[4], -b[4], k * rho) < length - m.far:
        return R_MAX
    ex, ey, ez = a[1] + b[1], a[2] + b[2], a[3] + b[3]
    size = math.sqrt(ex * ex + ey * ey + ez * ez)
    if size <= 0.0:
        return COLLISION
    size = 1.0 / size
    ex, ey, ez = ex * size, ey * size, ez * size
    fa, fb = ex * a[1] + ey * a[2] + ez * a[3], ex * b[1] + ey * b[2] + ez * b[3]
    dip = max(0.0, k * (ey * centre - min(fa, fb)) + k * k * rho)
    if lowest(fa, fb, dip) < near + length:
        return COLLISION
    slack = m.v1 * dip + m.n * k * rho
    if m.v0 - m.v1 * m.d0 + lowest(m.v1 * fa - m.n * a[5], m.v1 * fb - m.n * b[5], slack) < speed:
        return REL_VEL
    if m.sun:
        ek, ez = a[7] + b[7], a[3] + b[3]
        size = math.sqrt(ek * ek + ez * ez)
        if size > 0.0:
            size = m.cos_b / size
            ek, ez = size * ek, size * ez
        else:
            ek, ez = 0.0, m.cos_b
        ga, gb = ek * a[7] + ez * a[3] - m.sin_b * a[6], ek * b[7] + ez * b[3] - m.sin_b * b[6]
        # in the turning frame the second derivative is at most 3 rho + r, the fourth 15 rho + r
        if min(ga, gb) - k * (3.0 * rho + farthest) < length:
            curve = max(_bend(m, a, centre, ek, ez), _bend(m, b, centre, ek, ez))
            dip = max(0.0, k * curve + k * k * (15.0 * rho + farthest))
            if lowest(ga, gb, dip) < length:
                return SUN
    return SAFE


@njit(error_model="numpy")
def _bend(m: Model, a: FloatArray, centre: float, nk: float, nz: float) -> float:
    """Return the second derivative of N.q at a node, q the position in the frame that turns with the sun."""
    ox, oy, ca, sa = a[1], a[2] - centre, a[8], a[9]
    vx, vy = 0.5 * oy, -2.0 * ox
    vc, vk = sa * vy - ca * vx, -sa * vx - ca * vy
    bend_c, bend_k = ca * ox - sa * oy - 2.0 * vk - a[6], sa * ox + ca * oy + 2.0 * vc - a[7]
    return float(nk * bend_k - nz * a[3] - m.sin_b * bend_c)


@njit(error_model="numpy")
def _copy(work: FloatArray, source: int, target: int) -> None:
    for column in range(_COLUMNS):
        work[target, column] = work[source, column]


@njit(error_model="numpy")
def closed_motion(
    m: Model, x: RowState, sun: tuple[float, float], length: float, speed: float, work: FloatArray
) -> int:  # fmt: skip
    """Return a constraint that the drift-free motion from x breaks within an orbit, or SAFE.

    Args:
        m: The task.
        x: The state at the beginning; its along-track speed is taken as -2 n x.
        sun: Cosine and sine of the sun angle there.
        length: Margin of the ranges and the sun cone [m].
        speed: Margin of the speeds [m/s].
        work: Room, shape `ROOM`.
    """
    u, w = x[3] / m.n, x[5] / m.n
    in_plane, across = math.sqrt(x[0] * x[0] + u * u), math.sqrt(x[2] * x[2] + w * w)
    if m.n * in_plane > m.limit[0] - speed:
        return X_VEL
    if 2.0 * m.n * in_plane > m.limit[1] - speed:
        return Y_VEL
    if m.n * across > m.limit[2] - speed:
        return Z_VEL
    near = max(m.near, m.near_psm)
    centre, rho = x[1] - 2.0 * u, math.sqrt(4.0 * in_plane * in_plane + across * across)
    for first in range(4):
        for node in range((0, 2, 1, 3)[first], ORBIT_CELLS, 4):
            cos, sin = m.orbit[node, 0], m.orbit[node, 1]
            code = _node(m, x, sun, cos, sin, near, length, speed, work[node])
            if code != SAFE:
                return code
    _copy(work, 0, ORBIT_CELLS)
    for node in range(ORBIT_CELLS):
        a, b, top = node, node + 1, ORBIT_CELLS
        work[a, 0], work[b, 0] = node * (FINEST // ORBIT_CELLS), (node + 1) * (FINEST // ORBIT_CELLS)
        while True:
            cells = work[b, 0] - work[a, 0]
            code = _uncertain(
                m, work[a], work[b], centre, rho, cells * (2.0 * math.pi / FINEST), near, length, speed
            )  # fmt: skip
            if code == SAFE:
                if b == node + 1:
                    break
                # the right end of this cell is the left end of the next, whose right end lies below on the stack
                _copy(work, b, node)
                a, top = node, top - 1
                b = top if top > ORBIT_CELLS else node + 1
                continue
            if cells <= 1.0:
                return code
            top += 1
            middle = math.floor(0.5 * (work[a, 0] + work[b, 0]))
            angle = middle * (2.0 * math.pi / FINEST)
            code = _node(m, x, sun, math.cos(angle), math.sin(angle), near, length, speed, work[top])
            if code != SAFE:
                return code
            work[top, 0], b = middle, top
    return further_closed_motion(m, x, length, speed) if m.further else SAFE
