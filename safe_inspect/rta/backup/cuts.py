"""Compiled half-spaces of controls that approximate the constraints near a control.

The state of a hold is affine in the control, so the supporting direction d of a constraint at one moment gives a
half-space d.(free motion + input u) >= need. For a speed or the largest range, it contains every safe control; for the
range, the sun cone and passive safety, all of its controls are safe at that moment. The slack that a backup plan leaves
to its constraints is a piecewise smooth function of the control; it is linearised by differences.
"""

from __future__ import annotations

import math

from safe_inspect.compiling import BORROWING, njit
from safe_inspect.dynamics.coasting import closed_motion_state
from safe_inspect.dynamics.cwh import RowState
from safe_inspect.rta.backup.half_spaces import along, further_slack, half_space, needed
from safe_inspect.rta.backup.holds import coasted, held, sun_after, turned
from safe_inspect.rta.backup.model import (
    CLOSED,
    FINE_NODES,
    FURTHER,
    HOLD_PIECES,
    ORBIT_CELLS,
    PLAN,
    FilterModel,
)
from safe_inspect.rta.backup.plans import ORDER, QUICK, plan_thrust
from safe_inspect.rta.backup.sequences import bits_of, least_slack, slack_of, support_of
from safe_inspect.rta.backup.tracking import tracking_thrust, widened
from safe_inspect.rta.backup.workspace import Workspace, as_bool, as_int
from safe_inspect.rta.constraints.rows import NO_MARGINS, Margins, Node, SunAngle, direction, inner, node, size_of
from safe_inspect.rta.constraints.sets import COLLISION, PSM
from safe_inspect.types import FloatArray

#: Bits of the constraints whose half-spaces contain every safe control, and of further constraints, for which they may.
CONVEX = -1 << FURTHER | bits_of("convex")


#: Code of the constraint that rejected a hold, and the piece of the hold where it did.
Refusal = tuple[int, int]


@njit(**BORROWING)
def support(m: FilterModel, code: int, at: Node, margins: Margins, d: FloatArray) -> float:
    """Write the direction d of a constraint at a state, shape (6,), and return the need: safe where d.state >= need.

    Passive safety has none; see `cut_near`.
    """
    if code >= FURTHER:
        half = half_space(m, code, at.state)
        for j in range(6):
            d[j] = half[j]
        return float(needed(half, margins))
    d[:] = 0.0
    return float(support_of(m.constraints, code, at, margins, d))


@njit(**BORROWING)
def add(m: FilterModel, need: float, b: RowState, u: FloatArray, k: int, s: Workspace, count: int) -> int:
    """Append the half-space d.state(k) >= need for d in `s.d`, given the state b reached with the thrust u.

    Returns:
        The new count.
    """
    if count >= s.bounds.shape[0]:
        return count
    value = need
    for j in range(6):
        value -= s.d[j] * b[j]
    for axis in range(3):
        total = 0.0
        for j in range(6):
            total += s.d[j] * m.hold_gamma[k, j, axis]
        s.rows[count, axis] = total
        value += total * u[axis]
    s.bounds[count] = value
    return count + 1


@njit(**BORROWING)
def cut_near(
    m: FilterModel, x: RowState, u: FloatArray, own_side: bool, always: bool, margins: Margins, s: Workspace,
    count: int,
) -> int:  # fmt: skip
    """Append a half-space that avoids the chief at the worst sample of coasting from the hold's middle and end.

    Its direction is that of the closest approach, to pass the chief, or that of the present position, to stay on this
    side of it. It is appended if a sample is too near, or unconditionally if `always`.
    """
    near = m.constraints[COLLISION].closed_near
    if not near > 0.0:
        return count
    side = direction(x)
    worst, at_k, at_j = math.inf, as_int(0), as_int(0)
    last = m.coast.shape[0] if m.near_psm > 0.0 else 1
    for k in (HOLD_PIECES // 2, HOLD_PIECES):
        for j in range(0, last, 4):
            p = coasted(m, x, u, k, j)
            reach = inner(side, p) if own_side else size_of(p)
            if reach < worst:
                worst, at_k, at_j = reach, k, j
    if worst >= near + margins.coasting and not always:
        return count
    if not own_side:
        side = direction(coasted(m, x, u, at_k, at_j))
    for i in range(6):
        s.d[i] = inner(side, m.coast[at_j, :, i])
    return int(add(m, near + margins.coasting, held(m, x, u, at_k), u, at_k, s, count))


@njit(**BORROWING)
def cut_hold(
    m: FilterModel, x: RowState, sun: SunAngle, u: FloatArray, refusal: Refusal, own_side: bool, margins: Margins,
    s: Workspace, count: int,
) -> int:  # fmt: skip
    """Append the half-space of the constraint that rejected a hold, at the moment of the violation."""
    code, k = refusal
    if code in (PSM, COLLISION):
        return int(cut_near(m, x, u, own_side, as_bool(True), margins, s, count))
    b, sun_b = held(m, x, u, k), sun_after(m, sun, k)
    need = support(m, code, node(b, sun_b), margins, s.d)
    return int(add(m, need, b, u, k, s, count))


@njit(**BORROWING)
def cut_end(
    m: FilterModel, x: RowState, sun: SunAngle, u: FloatArray, codes: int, margins: Margins, s: Workspace, count: int
) -> tuple[int, int]:  # fmt: skip
    """Append the half-spaces of the constraints of the bits `codes` that are violated at the end of a hold.

    Returns:
        The new count, and the bits of the constraints that are violated.
    """
    k, bits = as_int(HOLD_PIECES), 0
    b, sun_b = held(m, x, u, k), sun_after(m, sun, k)
    end = node(b, sun_b)
    for code in range(FURTHER + m.further):
        if not (m.active & codes) >> code & 1:
            continue
        need = support(m, code, end, margins, s.d)
        if along(s.d, b) < need:
            count = add(m, need, b, u, k, s, count)
            bits |= 1 << code
    return count, bits


@njit(**BORROWING)
def cut_broken(
    m: FilterModel, x: RowState, sun: SunAngle, u: FloatArray, own_side: bool, margins: Margins, s: Workspace,
    count: int,
) -> tuple[int, int]:  # fmt: skip
    """Append the half-spaces of all constraints violated at the end of a hold; return the count and their bits."""
    count, bits = cut_end(m, x, sun, u, as_int(~(1 << COLLISION)), margins, s, count)
    b = held(m, x, u, HOLD_PIECES)
    near = m.constraints[COLLISION].near
    if near > 0.0 and b[0] * b[0] + b[1] * b[1] + b[2] * b[2] < (near + margins.length) ** 2:
        bits |= 1 << COLLISION
    before = count
    count = cut_near(m, x, u, own_side, as_bool(False), margins, s, count)
    if m.near_psm > 0.0 and count > before:
        bits |= 1 << PSM
    return count, bits


#: Weight of a newton of remaining thrust relative to distances [m].
_METRES_PER_NEWTON = 100.0
#: Bits of the constraints that are speeds.
_SPEEDS = bits_of("allowed_speed")
#: Step of the differences [N].
STEP = 1e-4


@njit(**BORROWING)
def _slack(m: FilterModel, at: Node, code: int) -> float:
    """Return the distance of a constraint from violation [m]; a speed counts as the range of such a motion."""
    if code >= FURTHER:
        return float(further_slack(m, code, at.state))
    return float(slack_of(m.constraints, code, at))


@njit(**BORROWING)
def _excess(m: FilterModel, w: FloatArray) -> float:
    """Return the slack of the thrusters, in metres, for a plan's thrust."""
    return float(_METRES_PER_NEWTON * (m.u_max - max(abs(w[0]), max(abs(w[1]), abs(w[2])))))


@njit(**BORROWING)
def _least_slack(m: FilterModel, at: Node) -> tuple[float, int]:
    """Return the least slack of all constraints [m], and the code of that constraint."""
    least, which = least_slack(m.constraints, at)
    for code in range(FURTHER, FURTHER + m.further):
        value = further_slack(m, code, at.state)
        if value < least:
            least, which = value, code
    return least, which


@njit(**BORROWING)
def _orbit_node(n: float, begin: RowState, start: SunAngle, cos: float, sin: float) -> Node:
    """Return the node of a plan's closed motion at the angle with the given cosine and sine."""
    return node(closed_motion_state(n, begin, cos, sin), turned(start, cos, sin))


@njit(**BORROWING)
def _best_plan(m: FilterModel, after: RowState, start: SunAngle, w: FloatArray) -> tuple[int, int]:
    """Return the plan with the largest least slack over the nodes of its orbit, and the constraint with that slack."""
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
            value, code = _least_slack(m, _orbit_node(m.n, begin, start, cos, sin))
            if value < tightest:
                tightest, which = value, code
            if value < least:
                least = value
                if least <= best:
                    break
        if least > best:
            best, best_plan, best_code = least, plan, which
    return best_plan, best_code


@njit(**BORROWING)
def tightest(m: FilterModel, x: RowState, sun: SunAngle, u: FloatArray, s: Workspace) -> int:
    """Return the constraint with the least slack on the best plan after a hold."""
    k = HOLD_PIECES
    start = sun_after(m, sun_after(m, sun, k), k)
    return _best_plan(m, held(m, x, u, k), start, s.w)[1]


@njit(**BORROWING)
def _after_plan(m: FilterModel, after: RowState, plan: int, w: FloatArray) -> tuple[RowState, float]:
    """Write the thrust of a plan from a state; return the state after its hold, and the slack of the thrusters."""
    plan_thrust(m, after, plan, w)
    return held(m, after, w, HOLD_PIECES), _excess(m, w)


@njit(**BORROWING)
def _stepped_end(m: FilterModel, x: RowState, u: FloatArray, axis: int) -> RowState:
    """Return the state after the hold of a control that is stepped along an axis."""
    u[axis] += STEP
    end = held(m, x, u, HOLD_PIECES)
    u[axis] -= STEP
    return end


@njit(**BORROWING)
def cut_recovery(
    m: FilterModel, x: RowState, sun: SunAngle, u: FloatArray, margin: float, s: Workspace, count: int
) -> tuple[int, int]:  # fmt: skip
    """Append half-spaces that make the best plan after a hold safe if it is not; return the count and the code.

    The slacks at the nodes of the plan's orbit, and that of the thrusters, are linearised in the control by
    differences.
    """
    w = s.w
    effort = size_of(u)
    start = sun_after(m, sun_after(m, sun, HOLD_PIECES), HOLD_PIECES)
    after = held(m, x, u, HOLD_PIECES)
    plan, which = _best_plan(m, after, start, w)
    b, over = _after_plan(m, after, plan, w)
    tube = widened(m, NO_MARGINS, CLOSED, effort, size_of(w))
    spare = margin + _METRES_PER_NEWTON * tracking_thrust(m, PLAN, effort)
    # The same after a small step of the control along each axis.
    b0, over0 = _after_plan(m, _stepped_end(m, x, u, as_int(0)), plan, w)
    b1, over1 = _after_plan(m, _stepped_end(m, x, u, as_int(1)), plan, w)
    b2, over2 = _after_plan(m, _stepped_end(m, x, u, as_int(2)), plan, w)
    if over < spare:
        count = _add_linear((over, over0, over1, over2), spare, u, s, count)
    for code in range(FURTHER + m.further):
        if not m.active >> code & 1:
            continue
        previous, falling = math.inf, False
        wanted = margin + (tube.speed / m.n if _SPEEDS >> code & 1 else tube.coasting)
        for place in range(FINE_NODES + 1):
            cos, sin = m.fine[place % FINE_NODES, 0], m.fine[place % FINE_NODES, 1]
            here = _slack(m, _orbit_node(m.n, b, start, cos, sin), code)
            # Only nodes at which the slack has a local minimum are used.
            if falling and here >= previous and previous < wanted:
                cos, sin = m.fine[place - 1, 0], m.fine[place - 1, 1]
                slacks = (
                    previous,
                    _slack(m, _orbit_node(m.n, b0, start, cos, sin), code),
                    _slack(m, _orbit_node(m.n, b1, start, cos, sin), code),
                    _slack(m, _orbit_node(m.n, b2, start, cos, sin), code),
                )
                count = _add_linear(slacks, wanted, u, s, count)
            falling = here < previous
            previous = here
    return count, which


@njit(**BORROWING)
def _add_linear(
    slacks: tuple[float, float, float, float], margin: float, u: FloatArray, s: Workspace, count: int
) -> int:  # fmt: skip
    """Append slack >= margin, given the slack at u and after a small step along each axis; return the new count."""
    if count >= s.bounds.shape[0]:
        return count
    here, rows = slacks[0], s.rows
    rows[count, 0], rows[count, 1], rows[count, 2] = (
        (slacks[1] - here) / STEP, (slacks[2] - here) / STEP, (slacks[3] - here) / STEP
    )  # fmt: skip
    s.bounds[count] = margin - here + rows[count, 0] * u[0] + rows[count, 1] * u[1] + rows[count, 2] * u[2]
    return count + 1
