"""Half-spaces of controls that stand for the constraints near a control, compiled.

The state of a hold is affine in the control, so each constraint's supporting direction d at one moment gives a
half-space d.(free motion + input u) >= need. For a speed or the largest range it contains every safe control; for the
range, the sun cone and passive safety it is contained in the controls that are safe at that moment.
"""

from __future__ import annotations

import math

from safe_inspect.compiling import njit
from safe_inspect.dynamics.cwh_row import RowState
from safe_inspect.rta.filters.backup.arcs import held, turned
from safe_inspect.rta.filters.backup.half_spaces import half_space, needed
from safe_inspect.rta.filters.backup.holds import coasted
from safe_inspect.rta.filters.backup.model import (
    COLLISION,
    FURTHER,
    HOLD_PIECES,
    INNER,
    PSM,
    R_MAX,
    REL_VEL,
    SUN,
    X_VEL,
    Model,
)
from safe_inspect.types import FloatArray

#: Most half-spaces of one row's programme.
MOST = 48


@njit(**INNER)
def _unit(x: float, y: float, z: float) -> tuple[float, float, float]:
    size = math.sqrt(x * x + y * y + z * z)
    return (x / size, y / size, z / size) if size > 1e-9 else (1.0, 0.0, 0.0)


@njit(**INNER)
def support(
    m: Model, code: int, b: RowState, sun: tuple[float, float], length: float, speed: float, d: FloatArray
) -> float:  # fmt: skip
    """Write the direction d of a constraint at the state b, shape (6,), and return the need: safe where d.b >= need.

    `length` and `speed` are the margins [m], [m/s]. Passive safety is not one of them; see `cut_coasting`.
    """
    if code >= FURTHER:
        half = half_space(m, code, b)
        for j in range(6):
            d[j] = half[j]
        return float(needed(half, length, speed))
    for j in range(6):
        d[j] = 0.0
    if code == SUN:
        ca, sa = sun
        _, ek, ez = _unit(0.0, -sa * b[0] - ca * b[1], b[2])
        if ek == 0.0 and ez == 0.0:
            ez = 1.0
        ek, ez = m.cos_b * ek, m.cos_b * ez
        d[0], d[1], d[2] = m.sin_b * ca - ek * sa, -m.sin_b * sa - ek * ca, ez
        return length
    if code >= X_VEL:
        axis = code - X_VEL
        d[3 + axis] = -1.0 if b[3 + axis] > 0.0 else 1.0
        return float(speed - m.limit[axis])
    ex, ey, ez = _unit(b[0], b[1], b[2])
    if code == R_MAX:
        d[0], d[1], d[2] = -ex, -ey, -ez
        return length - m.far
    d[0], d[1], d[2] = ex, ey, ez
    if code == REL_VEL:
        d[0], d[1], d[2] = m.v1 * ex, m.v1 * ey, m.v1 * ez
        vx, vy, vz = _unit(b[3], b[4], b[5])
        d[3], d[4], d[5] = -vx, -vy, -vz
        return m.v1 * m.d0 - m.v0 + speed
    return m.near + length


@njit(**INNER)
def add(
    m: Model, d: FloatArray, need: float, b: RowState, u: FloatArray, k: int,
    rows: FloatArray, bounds: FloatArray, count: int,
) -> int:  # fmt: skip
    """Append the half-space d.state(k) >= need, given the state b that the thrust u leads to; return the new count."""
    if count >= MOST:
        return count
    value = need
    for j in range(6):
        value -= d[j] * b[j]
    for axis in range(3):
        total = 0.0
        for j in range(6):
            total += d[j] * m.hold_gamma[k, j, axis]
        rows[count, axis] = total
        value += total * u[axis]
    bounds[count] = value
    return count + 1


@njit(**INNER)
def cut_near(
    m: Model, x: RowState, u: FloatArray, own_side: bool, always: bool, length: float, d: FloatArray,
    rows: FloatArray, bounds: FloatArray, count: int,
) -> int:  # fmt: skip
    """Append a half-space that keeps off the chief at the worst sample of coasting from the hold's middle and end.

    Its direction is that of the closest approach, to pass beside the chief, or that of the present position, to stay
    on this side of it. Appended where a sample is too near, or in any case.
    """
    near = max(m.near, m.near_psm)
    if not near > 0.0:
        return count
    sx, sy, sz = _unit(x[0], x[1], x[2])
    worst, at_k, at_j = math.inf, 0, 0
    last = m.coast.shape[0] if m.near_psm > 0.0 else 1
    for k in (HOLD_PIECES // 2, HOLD_PIECES):
        for j in range(0, last, 4):
            px, py, pz = coasted(m, x, u, k, j)
            reach = sx * px + sy * py + sz * pz if own_side else math.sqrt(px * px + py * py + pz * pz)
            if reach < worst:
                worst, at_k, at_j = reach, k, j
    if worst >= near + length and not always:
        return count
    if not own_side:
        sx, sy, sz = coasted(m, x, u, at_k, at_j)
        sx, sy, sz = _unit(sx, sy, sz)
    for i in range(6):
        d[i] = sx * m.coast[at_j, 0, i] + sy * m.coast[at_j, 1, i] + sz * m.coast[at_j, 2, i]
    return int(add(m, d, near + length, held(m, x, u, at_k), u, at_k, rows, bounds, count))


@njit(**INNER)
def cut_hold(
    m: Model, x: RowState, sun: tuple[float, float], u: FloatArray, code: int, k: int, own_side: bool,
    length: float, speed: float, d: FloatArray, rows: FloatArray, bounds: FloatArray, count: int,
) -> int:  # fmt: skip
    """Append the half-space of the constraint that refused a hold, at the moment where it did."""
    if code in (PSM, COLLISION):
        return int(cut_near(m, x, u, own_side, True, length, d, rows, bounds, count))
    b, sun_b = held(m, x, u, k), turned(sun, m.hold_sun[k, 0], m.hold_sun[k, 1])
    need = support(m, code, b, sun_b, length, speed, d)
    return int(add(m, d, need, b, u, k, rows, bounds, count))


@njit(**INNER)
def cut_broken(
    m: Model, x: RowState, sun: tuple[float, float], u: FloatArray, own_side: bool, length: float, speed: float,
    d: FloatArray, rows: FloatArray, bounds: FloatArray, count: int,
) -> tuple[int, int]:  # fmt: skip
    """Append the half-spaces of all constraints broken at the end of a hold; return the count and the bits of them."""
    k, bits = HOLD_PIECES, 0
    b, sun_b = held(m, x, u, k), turned(sun, m.hold_sun[k, 0], m.hold_sun[k, 1])
    for code in range(FURTHER + m.further):
        if (code == SUN and not m.sun) or code in (PSM, COLLISION):
            continue
        need = support(m, code, b, sun_b, length, speed, d)
        value = d[0] * b[0] + d[1] * b[1] + d[2] * b[2] + d[3] * b[3] + d[4] * b[4] + d[5] * b[5]
        if value < need:
            count = add(m, d, need, b, u, k, rows, bounds, count)
            bits |= 1 << code
    if m.near > 0.0 and b[0] * b[0] + b[1] * b[1] + b[2] * b[2] < (m.near + length) ** 2:
        bits |= 1 << COLLISION
    before = count
    count = cut_near(m, x, u, own_side, False, length, d, rows, bounds, count)
    if m.near_psm > 0.0 and count > before:
        bits |= 1 << PSM
    return count, bits
