"""Is an arc of motion safe at every moment? Bounds that leave no gap between grid points, compiled.

An arc is flown under constant thrust, or none, and is cut into cells. On a cell of length D let f be a quantity that is
smooth in time. Then f is at most (D^2/8) max(f'', 0) 4 x (1 - x) below the chord of its ends at the fraction x of the
cell, and f'' itself is bounded in the same way by its ends and its own second derivative. So the ends of a cell
certify all of it, or the cell is halved. Each constraint is put as such an f:

* range: e.p(t) <= |p(t)| for any unit vector e, here the direction of the cell's middle;
* sun cone: N.q(t) <= the signed distance from the cone, q the position in the frame that turns with the sun and N
  the cone's outward normal beside the cell's middle;
* largest range and speeds: a norm is convex, so that of a smooth vector exceeds the chord of its ends by no more than
  the vector's own departure from its chord.

The derivatives obey the Clohessy-Wiltshire equations: with S a bound of |v| + |a| / n over the cell, the jerk is at
most 3 n^2 S and the fourth derivative of the position at most 6 n^3 S. For k = (n D)^2 / 8 the ends' values bound S
by (largest |v| + largest |a| / n) / (1 - 9 k).
"""

from __future__ import annotations

import math

from safe_inspect.compiling import njit
from safe_inspect.dynamics.cwh_row import RowState, cwh_row
from safe_inspect.rta.filters.backup.model import COLLISION, INNER, R_MAX, REL_VEL, SUN, X_VEL, Y_VEL, Z_VEL, Model
from safe_inspect.types import FloatArray

SAFE = -1


@njit(**INNER)
def held(m: Model, x: RowState, u: FloatArray, k: int) -> RowState:
    """Return the state k / 256 of a hold after x, under the thrust u; at k = 256 to the bit that of the simulator."""
    return cwh_row(m.hold_phi[k], m.hold_gamma[k], x, u[0], u[1], u[2])


@njit(**INNER)
def turned(sun: tuple[float, float], cos: float, sin: float) -> tuple[float, float]:
    """Return the cosine and sine of the sun angle after a turn."""
    return sun[0] * cos - sun[1] * sin, sun[1] * cos + sun[0] * sin


@njit(**INNER)
def lowest(fa: float, fb: float, dip: float) -> float:
    """Return the least over 0 <= x <= 1 of the chord from fa to fb less dip 4 x (1 - x), dip >= 0."""
    rise = abs(fb - fa)
    if rise >= 4.0 * dip:
        return min(fa, fb)
    return min(fa, fb) - dip * (1.0 - 0.25 * rise / dip) ** 2


@njit(**INNER)
def sun_gap(m: Model, x: RowState, sun: tuple[float, float]) -> float:
    """Return the signed distance from the sun cone [m]; not negative outside it."""
    pc, pk = sun[1] * x[1] - sun[0] * x[0], -sun[1] * x[0] - sun[0] * x[1]
    return m.cos_b * math.sqrt(pk * pk + x[2] * x[2]) - m.sin_b * pc


@njit(**INNER)
def broken_at(m: Model, near: float, x: RowState, sun: tuple[float, float], length: float, speed: float) -> int:
    """Return the code of a constraint that is not met at a state with those margins [m], [m/s]; SAFE if all are."""
    r = math.sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2])
    v = math.sqrt(x[3] * x[3] + x[4] * x[4] + x[5] * x[5])
    if r < near + length:
        return COLLISION
    if v > m.v0 + m.v1 * (r - m.d0) - speed:
        return REL_VEL
    if m.sun and sun_gap(m, x, sun) < length:
        return SUN
    if r > m.far - length:
        return R_MAX
    if abs(x[3]) > m.limit[0] - speed:
        return X_VEL
    if abs(x[4]) > m.limit[1] - speed:
        return Y_VEL
    if abs(x[5]) > m.limit[2] - speed:
        return Z_VEL
    return SAFE


@njit(**INNER)
def acceleration_at(n: float, x: RowState, w: tuple[float, float, float]) -> tuple[float, float, float]:
    """Return the acceleration at a state under the thrust's own w [m/s^2]."""
    return 3.0 * n * n * x[0] + 2.0 * n * x[4] + w[0], w[1] - 2.0 * n * x[3], w[2] - n * n * x[2]


@njit(**INNER)
def uncertain(
    m: Model, near: float, a: RowState, b: RowState, sun_a: tuple[float, float], sun_b: tuple[float, float],
    w: tuple[float, float, float], span: float, length: float, speed: float,
) -> int:  # fmt: skip
    """Return the code of a constraint that a cell's ends cannot certify with those margins; SAFE if there is none.

    Args:
        m: The task.
        near: Least range [m].
        a: RowState at the cell's beginning.
        b: RowState at its end.
        sun_a: Cosine and sine of the sun angle at the beginning.
        sun_b: The same at the end.
        w: Constant acceleration of the thrust [m/s^2].
        span: Length of the cell [s].
        length: Margin of the ranges and the sun cone [m].
        speed: Margin of the speeds [m/s].
    """
    n = m.n
    ax, ay, az = acceleration_at(n, a, w)
    bx, by, bz = acceleration_at(n, b, w)
    r2a, r2b = a[0] * a[0] + a[1] * a[1] + a[2] * a[2], b[0] * b[0] + b[1] * b[1] + b[2] * b[2]
    va = math.sqrt(a[3] * a[3] + a[4] * a[4] + a[5] * a[5])
    vb = math.sqrt(b[3] * b[3] + b[4] * b[4] + b[5] * b[5])
    acceleration = math.sqrt(max(ax * ax + ay * ay + az * az, bx * bx + by * by + bz * bz))
    eighth = 0.125 * span * span
    k = n * n * eighth
    s = (max(va, vb) + acceleration / n) / (1.0 - 9.0 * k)
    bend = eighth * acceleration + 6.0 * k * k * s / n
    slack = 3.0 * k * s
    ra, rb = math.sqrt(r2a), math.sqrt(r2b)
    farthest = max(ra, rb) + bend
    if farthest > m.far - length and lowest(-ra, -rb, bend) < length - m.far:
        return R_MAX
    if lowest(-abs(a[3]), -abs(b[3]), slack) < speed - m.limit[0]:
        return X_VEL
    if lowest(-abs(a[4]), -abs(b[4]), slack) < speed - m.limit[1]:
        return Y_VEL
    if lowest(-abs(a[5]), -abs(b[5]), slack) < speed - m.limit[2]:
        return Z_VEL
    ex, ey, ez = a[0] + b[0], a[1] + b[1], a[2] + b[2]
    size = math.sqrt(ex * ex + ey * ey + ez * ez)
    if size <= 0.0:
        return COLLISION
    ex, ey, ez = ex / size, ey / size, ez / size
    fa, fb = ex * a[0] + ey * a[1] + ez * a[2], ex * b[0] + ey * b[1] + ez * b[2]
    curve = max(ex * ax + ey * ay + ez * az, ex * bx + ey * by + ez * bz)
    dip = max(0.0, eighth * curve + 6.0 * k * k * s / n)
    if lowest(fa, fb, dip) < near + length:
        return COLLISION
    if m.v0 - m.v1 * m.d0 + lowest(m.v1 * fa - va, m.v1 * fb - vb, m.v1 * dip + slack) < speed:
        return REL_VEL
    if m.sun:
        ca, sa = sun_a
        cb, sb = sun_b
        qca, qka = sa * a[1] - ca * a[0], -sa * a[0] - ca * a[1]
        qcb, qkb = sb * b[1] - cb * b[0], -sb * b[0] - cb * b[1]
        ek, ez = qka + qkb, a[2] + b[2]
        size = math.sqrt(ek * ek + ez * ez)
        if size > 0.0:
            ek, ez = ek / size, ez / size
        else:
            ek, ez = 0.0, 1.0
        nk, nz = m.cos_b * ek, m.cos_b * ez
        ga, gb = nk * qka + nz * a[2] - m.sin_b * qca, nk * qkb + nz * b[2] - m.sin_b * qcb
        # accelerations in the frame that turns with the sun
        vca, vka = sa * a[4] - ca * a[3], -sa * a[3] - ca * a[4]
        vcb, vkb = sb * b[4] - cb * b[3], -sb * b[3] - cb * b[4]
        aca, aka = sa * ay - ca * ax - n * (2.0 * vka + n * qca), -sa * ax - ca * ay + n * (2.0 * vca - n * qka)
        acb, akb = sb * by - cb * bx - n * (2.0 * vkb + n * qcb), -sb * bx - cb * by + n * (2.0 * vcb - n * qkb)
        curve = max(nk * aka + nz * az - m.sin_b * aca, nk * akb + nz * bz - m.sin_b * acb)
        dip = max(0.0, eighth * curve + k * k * (24.0 * s / n + farthest))
        if lowest(ga, gb, dip) < length:
            return SUN
    return SAFE
