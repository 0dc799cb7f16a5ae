"""Half-spaces of controls after which a backup plan is safe, compiled.

What a plan leaves to its constraints is a smooth function of the control but for its corners; it is made linear by
differences.
"""

from __future__ import annotations

import math

from safe_inspect.compiling import njit
from safe_inspect.dynamics.coasting import closed_motion_state
from safe_inspect.dynamics.cwh_row import RowState
from safe_inspect.rta.filters.backup.arcs import held, sun_gap, turned
from safe_inspect.rta.filters.backup.cuts import MOST
from safe_inspect.rta.filters.backup.half_spaces import further_slack
from safe_inspect.rta.filters.backup.model import (
    COLLISION,
    FINE_NODES,
    FURTHER,
    HOLD_PIECES,
    INNER,
    ORBIT_CELLS,
    PSM,
    R_MAX,
    REL_VEL,
    SUN,
    X_VEL,
    Model,
)
from safe_inspect.rta.filters.backup.plans import ORDER, QUICK, plan_thrust
from safe_inspect.types import FloatArray

#: What a newton of thrust to spare counts beside distances [m].
_METRES_PER_NEWTON = 100.0
#: Step of the differences [N].
_STEP = 1e-4


@njit(**INNER)
def _slack(m: Model, x: RowState, sun: tuple[float, float], code: int) -> float:
    """Return how far a constraint is from broken, in metres; speeds count as the range of a motion that fast."""
    if code == SUN:
        return float(sun_gap(m, x, sun))
    if code >= FURTHER:
        return float(further_slack(m, code, x))
    r = math.sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2])
    if code == COLLISION:
        return r - max(m.near, m.near_psm)
    if code == R_MAX:
        return m.far - r
    if code == REL_VEL:
        v = math.sqrt(x[3] * x[3] + x[4] * x[4] + x[5] * x[5])
        return (m.v0 + m.v1 * (r - m.d0) - v) / m.n
    return float((m.limit[code - X_VEL] - abs(x[3 + code - X_VEL])) / m.n)


@njit(**INNER)
def _excess(m: Model, w: FloatArray) -> float:
    """Return the slack of the thrusters, in metres, for a plan's thrust."""
    return float(_METRES_PER_NEWTON * (m.u_max - max(abs(w[0]), max(abs(w[1]), abs(w[2])))))


@njit(**INNER)
def _least_slack(m: Model, x: RowState, sun: tuple[float, float]) -> tuple[float, int]:
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
    for code in range(FURTHER, FURTHER + m.further):
        value = further_slack(m, code, x)
        if value < least:
            least, which = value, code
    return least, which


@njit(**INNER)
def _best_plan(m: Model, after: RowState, start: tuple[float, float], w: FloatArray) -> tuple[int, int]:
    """Return the plan with the largest least slack over the nodes of its orbit, and the constraint where that is."""
    best, best_plan, best_code = -math.inf, 0, COLLISION
    for rank in range(QUICK):
        plan = ORDER[rank]
        plan_thrust(m, after, plan, w)
        least, tightest, which = _excess(m, w), math.inf, COLLISION
        if least <= best:
            continue
        begin = held(m, after, w, HOLD_PIECES)
        for place in range(ORBIT_CELLS):
            node = 5 * place % ORBIT_CELLS
            cos, sin = m.orbit[node, 0], m.orbit[node, 1]
            value, code = _least_slack(m, closed_motion_state(m.n, begin, cos, sin), turned(start, cos, sin))
            if value < tightest:
                tightest, which = value, code
            if value < least:
                least = value
                if least <= best:
                    break
        if least > best:
            best, best_plan, best_code = least, plan, which
    return best_plan, best_code


@njit(**INNER)
def cut_recovery(
    m: Model, x: RowState, sun: tuple[float, float], u: FloatArray, margin: float, w: FloatArray,
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
    for code in range(FURTHER + m.further):
        if code == PSM or (code == SUN and not m.sun):
            continue
        previous, falling = math.inf, False
        for place in range(FINE_NODES + 1):
            cos, sin = m.fine[place % FINE_NODES, 0], m.fine[place % FINE_NODES, 1]
            here = _slack(m, closed_motion_state(m.n, b, cos, sin), turned(start, cos, sin), code)
            # only the nodes at which the slack is least count
            if falling and here >= previous and previous < margin:
                cos, sin = m.fine[place - 1, 0], m.fine[place - 1, 1]
                turn = turned(start, cos, sin)
                count = _add_linear(
                    previous, _slack(m, closed_motion_state(m.n, b0, cos, sin), turn, code),
                    _slack(m, closed_motion_state(m.n, b1, cos, sin), turn, code),
                    _slack(m, closed_motion_state(m.n, b2, cos, sin), turn, code), margin, u, rows, bounds, count,
                )  # fmt: skip
            falling = here < previous
            previous = here
    return count, which


@njit(**INNER)
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
