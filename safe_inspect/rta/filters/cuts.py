"""Half-spaces of controls that stand for the constraints near a control, compiled.

The state of a hold is affine in the control, so each constraint's supporting direction d at one moment gives a
half-space d.(free motion + input u) >= need. For a speed or the largest range it contains every safe control; for the
range, the sun cone and passive safety it is contained in the controls that are safe at that moment.
"""

from __future__ import annotations

import math

from numba import njit

from safe_inspect.rta.filters.arcs import State, closed, held, sun_gap, turned
from safe_inspect.rta.filters.holds import coasted
from safe_inspect.rta.filters.model import (
    COLLISION,
    HOLD_PIECES,
    ORBIT_CELLS,
    PSM,
    R_MAX,
    REL_VEL,
    SUN,
    X_VEL,
    Model,
)
from safe_inspect.rta.filters.plans import PLANS, plan_thrust
from safe_inspect.types import FloatArray

#: Most half-spaces of one row's programme.
MOST = 48
_METRES_PER_NEWTON = 100.0
_STEP = 1e-4


@njit(cache=True)  # type: ignore[misc,untyped-decorator]
def _unit(x: float, y: float, z: float) -> tuple[float, float, float]:
    size = math.sqrt(x * x + y * y + z * z)
    return (x / size, y / size, z / size) if size > 1e-9 else (1.0, 0.0, 0.0)


@njit(cache=True)  # type: ignore[misc,untyped-decorator]
def support(
    m: Model, code: int, b: State, sun: tuple[float, float], length: float, speed: float, d: FloatArray
) -> float:  # fmt: skip
    """Write the direction d of a constraint at the state b, shape (6,), and return the need: safe where d.b >= need.

    `length` and `speed` are the margins [m], [m/s]. Passive safety is not one of them; see `cut_coasting`.
    """
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
        return speed - m.limit[axis]
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


@njit(cache=True)  # type: ignore[misc,untyped-decorator]
def add(
    m: Model, d: FloatArray, need: float, b: State, u: FloatArray, k: int,
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


@njit(cache=True)  # type: ignore[misc,untyped-decorator]
def cut_coasting(
    m: Model, x: State, u: FloatArray, k: int, j: int, length: float, d: FloatArray,
    rows: FloatArray, bounds: FloatArray, count: int,
) -> int:  # fmt: skip
    """Append the half-space of passive safety at piece k of the hold and entry j of coasting."""
    px, py, pz = coasted(m, x, u, k, j)
    ex, ey, ez = _unit(px, py, pz)
    for i in range(6):
        d[i] = ex * m.coast[j, 0, i] + ey * m.coast[j, 1, i] + ez * m.coast[j, 2, i]
    return int(add(m, d, m.near_psm + length, held(m, x, u, k), u, k, rows, bounds, count))


@njit(cache=True)  # type: ignore[misc,untyped-decorator]
def cut_hold(
    m: Model, x: State, sun: tuple[float, float], u: FloatArray, code: int, k: int, j: int,
    length: float, speed: float, d: FloatArray, rows: FloatArray, bounds: FloatArray, count: int,
) -> int:  # fmt: skip
    """Append the half-space of the constraint that refused a hold, at the moment where it did."""
    if code == PSM:
        return int(cut_coasting(m, x, u, k, j, length, d, rows, bounds, count))
    b, sun_b = held(m, x, u, k), turned(sun, m.hold_sun[k, 0], m.hold_sun[k, 1])
    need = support(m, code, b, sun_b, length, speed, d)
    return int(add(m, d, need, b, u, k, rows, bounds, count))


@njit(cache=True)  # type: ignore[misc,untyped-decorator]
def cut_broken(
    m: Model, x: State, sun: tuple[float, float], u: FloatArray, length: float, speed: float,
    d: FloatArray, rows: FloatArray, bounds: FloatArray, count: int,
) -> tuple[int, int]:  # fmt: skip
    """Append the half-spaces of all constraints broken at the end of a hold; return the count and the bits of them."""
    k, bits = HOLD_PIECES, 0
    b, sun_b = held(m, x, u, k), turned(sun, m.hold_sun[k, 0], m.hold_sun[k, 1])
    for code in range(8):
        if (code == SUN and not m.sun) or code == PSM:
            continue
        need = support(m, code, b, sun_b, length, speed, d)
        value = d[0] * b[0] + d[1] * b[1] + d[2] * b[2] + d[3] * b[3] + d[4] * b[4] + d[5] * b[5]
        if value < need:
            count = add(m, d, need, b, u, k, rows, bounds, count)
            bits |= 1 << code
    if m.near_psm > 0.0:
        reach, worst, at = m.near_psm + length, 0.0, -1
        for j in range(0, m.coast.shape[0], 8):
            px, py, pz = coasted(m, x, u, k, j)
            short = reach * reach - (px * px + py * py + pz * pz)
            if short > worst:
                worst, at = short, j
        if at >= 0:
            count = cut_coasting(m, x, u, k, at, length, d, rows, bounds, count)
            bits |= 1 << PSM
    return count, bits


@njit(cache=True)  # type: ignore[misc,untyped-decorator]
def _slack(m: Model, x: State, sun: tuple[float, float], code: int) -> float:
    """Return how far a constraint is from broken, in metres; speeds count as the range of a motion that fast."""
    if code == SUN:
        return sun_gap(m, x, sun)
    r = math.sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2])
    if code == COLLISION:
        return r - max(m.near, m.near_psm)
    if code == R_MAX:
        return m.far - r
    if code == REL_VEL:
        v = math.sqrt(x[3] * x[3] + x[4] * x[4] + x[5] * x[5])
        return (m.v0 + m.v1 * (r - m.d0) - v) / m.n
    return (m.limit[code - X_VEL] - abs(x[3 + code - X_VEL])) / m.n


@njit(cache=True)  # type: ignore[misc,untyped-decorator]
def _plan_slack(m: Model, x: State, sun: tuple[float, float], plan: int, node: int, code: int, w: FloatArray) -> float:
    """Return the slack of one constraint at one node of a plan's orbit; that of the thrusters for code PSM."""
    plan_thrust(m, x, plan, w)
    if code == PSM:
        return _METRES_PER_NEWTON * (m.u_max - max(abs(w[0]), max(abs(w[1]), abs(w[2]))))
    b = closed(m.n, held(m, x, w, HOLD_PIECES), m.orbit[node, 0], m.orbit[node, 1])
    start = turned(sun, m.hold_sun[HOLD_PIECES, 0], m.hold_sun[HOLD_PIECES, 1])
    return float(_slack(m, b, turned(start, m.orbit[node, 0], m.orbit[node, 1]), code))


@njit(cache=True)  # type: ignore[misc,untyped-decorator]
def cut_recovery(
    m: Model, x: State, sun: tuple[float, float], u: FloatArray, margin: float, w: FloatArray,
    rows: FloatArray, bounds: FloatArray, count: int,
) -> tuple[int, int]:  # fmt: skip
    """Append the half-space that makes the best plan after a hold safe where it is worst; return count and code.

    The best plan is that with the largest least slack over the nodes of its orbit; the slack is made linear in the
    control by differences.
    """
    after = held(m, x, u, HOLD_PIECES)
    sun_b = turned(sun, m.hold_sun[HOLD_PIECES, 0], m.hold_sun[HOLD_PIECES, 1])
    start = turned(sun_b, m.hold_sun[HOLD_PIECES, 0], m.hold_sun[HOLD_PIECES, 1])
    best, best_plan, best_node, best_code = -math.inf, 0, 0, COLLISION
    for plan in range(PLANS):
        plan_thrust(m, after, plan, w)
        least, at, which = _METRES_PER_NEWTON * (m.u_max - max(abs(w[0]), max(abs(w[1]), abs(w[2])))), 0, PSM
        if least <= best:
            continue
        begin = held(m, after, w, HOLD_PIECES)
        for node in range(ORBIT_CELLS):
            b = closed(m.n, begin, m.orbit[node, 0], m.orbit[node, 1])
            sun_c = turned(start, m.orbit[node, 0], m.orbit[node, 1])
            for code in range(8):
                if code == PSM or (code == SUN and not m.sun):
                    continue
                value = _slack(m, b, sun_c, code)
                if value < least:
                    least, at, which = value, node, code
            if least <= best:
                break
        if least > best:
            best, best_plan, best_node, best_code = least, plan, at, which
    if count >= MOST:
        return count, best_code
    here = _plan_slack(m, after, sun_b, best_plan, best_node, best_code, w)
    bound = margin - here
    for axis in range(3):
        before = u[axis]
        u[axis] = before + _STEP
        there = _plan_slack(m, held(m, x, u, HOLD_PIECES), sun_b, best_plan, best_node, best_code, w)
        u[axis] = before
        rows[count, axis] = (there - here) / _STEP
        bound += rows[count, axis] * before
    bounds[count] = bound
    return count + 1, best_code
