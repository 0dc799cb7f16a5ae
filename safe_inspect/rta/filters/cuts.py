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
    FINE_NODES,
    HOLD_PIECES,
    ORBIT_CELLS,
    PSM,
    R_MAX,
    REL_VEL,
    SUN,
    X_VEL,
    Model,
)
from safe_inspect.rta.filters.plans import ORDER, QUICK, plan_thrust
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
def cut_near(
    m: Model, x: State, u: FloatArray, own_side: bool, always: bool, length: float, d: FloatArray,
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


@njit(cache=True)  # type: ignore[misc,untyped-decorator]
def cut_hold(
    m: Model, x: State, sun: tuple[float, float], u: FloatArray, code: int, k: int, own_side: bool,
    length: float, speed: float, d: FloatArray, rows: FloatArray, bounds: FloatArray, count: int,
) -> int:  # fmt: skip
    """Append the half-space of the constraint that refused a hold, at the moment where it did."""
    if code in (PSM, COLLISION):
        return int(cut_near(m, x, u, own_side, True, length, d, rows, bounds, count))
    b, sun_b = held(m, x, u, k), turned(sun, m.hold_sun[k, 0], m.hold_sun[k, 1])
    need = support(m, code, b, sun_b, length, speed, d)
    return int(add(m, d, need, b, u, k, rows, bounds, count))


@njit(cache=True)  # type: ignore[misc,untyped-decorator]
def cut_broken(
    m: Model, x: State, sun: tuple[float, float], u: FloatArray, own_side: bool, length: float, speed: float,
    d: FloatArray, rows: FloatArray, bounds: FloatArray, count: int,
) -> tuple[int, int]:  # fmt: skip
    """Append the half-spaces of all constraints broken at the end of a hold; return the count and the bits of them."""
    k, bits = HOLD_PIECES, 0
    b, sun_b = held(m, x, u, k), turned(sun, m.hold_sun[k, 0], m.hold_sun[k, 1])
    for code in range(8):
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
def _excess(m: Model, w: FloatArray) -> float:
    """Return the slack of the thrusters, in metres, for a plan's thrust."""
    return _METRES_PER_NEWTON * (m.u_max - max(abs(w[0]), max(abs(w[1]), abs(w[2]))))


@njit(cache=True)  # type: ignore[misc,untyped-decorator]
def _least_slack(m: Model, x: State, sun: tuple[float, float]) -> tuple[float, int]:
    """Return the least slack of all constraints [m], and whose it is."""
    r = math.sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2])
    v = math.sqrt(x[3] * x[3] + x[4] * x[4] + x[5] * x[5])
    least, which = r - max(m.near, m.near_psm), COLLISION
    value = (m.v0 + m.v1 * (r - m.d0) - v) / m.n
    if value < least:
        least, which = value, REL_VEL
    if m.far - r < least:
        least, which = m.far - r, R_MAX
    for axis in range(3):
        value = (m.limit[axis] - abs(x[3 + axis])) / m.n
        if value < least:
            least, which = value, X_VEL + axis
    if m.sun:
        value = sun_gap(m, x, sun)
        if value < least:
            least, which = value, SUN
    return least, which


@njit(cache=True)  # type: ignore[misc,untyped-decorator]
def _best_plan(m: Model, after: State, start: tuple[float, float], w: FloatArray) -> tuple[int, int]:
    """Return the plan with the largest least slack over the nodes of its orbit, and the constraint where that is."""
    best, best_plan, best_code = -math.inf, 0, COLLISION
    for rank in range(QUICK):
        plan = ORDER[rank]
        plan_thrust(m, after, plan, w)
        least, which = _excess(m, w), PSM
        if least <= best:
            continue
        begin = held(m, after, w, HOLD_PIECES)
        for place in range(ORBIT_CELLS):
            node = 5 * place % ORBIT_CELLS
            cos, sin = m.orbit[node, 0], m.orbit[node, 1]
            value, code = _least_slack(m, closed(m.n, begin, cos, sin), turned(start, cos, sin))
            if value < least:
                least, which = value, code
                if least <= best:
                    break
        if least > best:
            best, best_plan, best_code = least, plan, which
    return best_plan, best_code


@njit(cache=True)  # type: ignore[misc,untyped-decorator]
def cut_recovery(
    m: Model, x: State, sun: tuple[float, float], u: FloatArray, margin: float, w: FloatArray,
    rows: FloatArray, bounds: FloatArray, count: int,
) -> tuple[int, int]:  # fmt: skip
    """Append half-spaces that make the best plan after a hold safe where it is not; return count and code.

    The slacks at the nodes of the plan's orbit, and that of the thrusters, are made linear in the control by
    differences.
    """
    sun_b = turned(sun, m.hold_sun[HOLD_PIECES, 0], m.hold_sun[HOLD_PIECES, 1])
    start = turned(sun_b, m.hold_sun[HOLD_PIECES, 0], m.hold_sun[HOLD_PIECES, 1])
    after = held(m, x, u, HOLD_PIECES)
    plan, which = _best_plan(m, after, start, w)
    plan_thrust(m, after, plan, w)
    b, over = held(m, after, w, HOLD_PIECES), _excess(m, w)
    # the same after a small step of the control along each axis
    u[0] += _STEP
    after = held(m, x, u, HOLD_PIECES)
    u[0] -= _STEP
    plan_thrust(m, after, plan, w)
    b0, over0 = held(m, after, w, HOLD_PIECES), _excess(m, w)
    u[1] += _STEP
    after = held(m, x, u, HOLD_PIECES)
    u[1] -= _STEP
    plan_thrust(m, after, plan, w)
    b1, over1 = held(m, after, w, HOLD_PIECES), _excess(m, w)
    u[2] += _STEP
    after = held(m, x, u, HOLD_PIECES)
    u[2] -= _STEP
    plan_thrust(m, after, plan, w)
    b2, over2 = held(m, after, w, HOLD_PIECES), _excess(m, w)
    if over < margin:
        count = _add_linear(over, over0, over1, over2, margin, u, rows, bounds, count)
    for code in range(8):
        if code == PSM or (code == SUN and not m.sun):
            continue
        previous, falling = math.inf, False
        for place in range(FINE_NODES + 1):
            cos, sin = m.fine[place % FINE_NODES, 0], m.fine[place % FINE_NODES, 1]
            here = _slack(m, closed(m.n, b, cos, sin), turned(start, cos, sin), code)
            # only the nodes at which the slack is least count
            if falling and here >= previous and previous < margin:
                cos, sin = m.fine[place - 1, 0], m.fine[place - 1, 1]
                turn = turned(start, cos, sin)
                count = _add_linear(
                    previous, _slack(m, closed(m.n, b0, cos, sin), turn, code),
                    _slack(m, closed(m.n, b1, cos, sin), turn, code),
                    _slack(m, closed(m.n, b2, cos, sin), turn, code), margin, u, rows, bounds, count,
                )  # fmt: skip
            falling = here < previous
            previous = here
    return count, which


@njit(cache=True)  # type: ignore[misc,untyped-decorator]
def _add_linear(
    here: float, s0: float, s1: float, s2: float, margin: float, u: FloatArray,
    rows: FloatArray, bounds: FloatArray, count: int,
) -> int:  # fmt: skip
    """Append slack >= margin, given the slack at u and after a small step along each axis; return the new count."""
    if count >= MOST:
        return count
    rows[count, 0], rows[count, 1], rows[count, 2] = (s0 - here) / _STEP, (s1 - here) / _STEP, (s2 - here) / _STEP
    bounds[count] = margin - here + rows[count, 0] * u[0] + rows[count, 1] * u[1] + rows[count, 2] * u[2]
    return count + 1
