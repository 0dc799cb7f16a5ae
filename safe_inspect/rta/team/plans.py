"""Joint backup plans of a team, and the exact test of a joint control, compiled.

The difference of two motions about the chief satisfies the same equations, with the difference of the thrusts as its
input, and the difference of two closed motions is closed. A pair is therefore tested as one deputy about a chief in the
place of the other deputy.
"""

from __future__ import annotations

import math

from safe_inspect.compiling import BORROWING, njit
from safe_inspect.dynamics.coasting import coasting_position
from safe_inspect.dynamics.cwh import RowState
from safe_inspect.rta.backup.closed_motion import closed_motion
from safe_inspect.rta.backup.holds import held, hold, sun_after
from safe_inspect.rta.backup.model import CLOSED, FINE_NODES, HOLD, HOLD_PIECES, PLAN, PLANS, FilterModel
from safe_inspect.rta.backup.plans import NO_HOLD, NO_PLAN, ORDER, STAY, still, try_plan
from safe_inspect.rta.backup.sequences import SAFE
from safe_inspect.rta.backup.workspace import Workspace, as_int
from safe_inspect.rta.constraints.rows import Margins, SunAngle, inner, lowest, size_of
from safe_inspect.rta.constraints.sets import COLLISION
from safe_inspect.rta.team.motions import coasts, minus, model_about, motion_about, state_of, tube_about, write_thrust
from safe_inspect.rta.team.workspace import TeamModel, TeamWorkspace
from safe_inspect.types import FloatArray

#: Number of orbits for which a pair is certified that neither drifts away nor is without drift.
ORBITS = 4
_CELL = math.pi / 8.0
_FINEST = _CELL / 2.0**16


@njit(**BORROWING)
def apart(n: float, x: RowState, reach: float) -> bool:
    """Return whether the range of a coasting relative motion stays at least `reach`; see `ORBITS` for the duration.

    The motion may drift: it is a centre that moves along y at a constant rate, plus an oscillation o with the orbit's
    period. In the angle tau = n t of the orbit, its second derivative is -o, and every derivative of o is at most
    rho = sqrt(4 A^2 + B^2) long, where A and B are the amplitudes in x and z. A cell of the path is therefore certified
    by its ends as in `constraints.rows`, and the speed, at most |drift| + rho, bounds how soon the deputies can be near
    each other. When the centre has passed the other deputy by more than the amplitude of the motion along y, the two
    stay apart permanently.

    Args:
        n: Mean motion [rad/s].
        x: The initial relative state.
        reach: Least range [m].
    """
    u, v, w = x[3] / n, x[4] / n, x[5] / n
    level, offset = 4.0 * x[0] + 2.0 * v, 3.0 * x[0] + 2.0 * v
    amplitude, across = math.sqrt(offset * offset + u * u), math.sqrt(x[2] * x[2] + w * w)
    centre, drift = x[1] - 2.0 * u, -1.5 * level
    rho = math.sqrt(4.0 * amplitude * amplitude + across * across)
    fastest = abs(drift) + rho
    a, angle, span = (x[0], x[1], x[2]), 0.0, _CELL
    while True:
        r = size_of(a)
        if r < reach:
            return False
        middle = centre + drift * angle
        if abs(level) - amplitude >= reach or (middle * drift >= 0.0 and abs(middle) - 2.0 * amplitude >= reach):
            return True
        if angle > ORBITS * 2.0 * math.pi or not fastest > 0.0:
            return True
        clear = (r - reach) / fastest
        if clear >= span:
            angle += clear
            a = coasting_position(n, x, angle, math.cos(angle), math.sin(angle))
            continue
        while True:
            end = angle + span
            b = coasting_position(n, x, end, math.cos(end), math.sin(end))
            e = a[0] + b[0], a[1] + b[1], a[2] + b[2]
            size = size_of(e)
            if size <= 0.0:
                return False
            e = e[0] / size, e[1] / size, e[2] / size
            fa, fb, k = inner(e, a), inner(e, b), 0.125 * span * span
            bend = max(e[0] * level + e[1] * middle - fa, e[0] * level + e[1] * (centre + drift * end) - fb)
            if lowest(fa, fb, max(0.0, k * bend + k * k * rho)) >= reach:
                break
            if span <= _FINEST or inner(b, b) < reach * reach:
                return False
            span *= 0.5
        a, angle, span = b, end, min(2.0 * span, _CELL)


#: Index of a deputy, and of its plan.
Choice = tuple[int, int]
#: Results of the test of a joint control.
PASSED, UNSAFE_HOLD, NO_JOINT_PLAN = range(3)
#: Value if all deputies have a plan; otherwise, the index of the one that has none.
FOUND = -1
_UNKNOWN, _GOOD, _BAD = range(3)
#: Number of times that the deputies choose their plans after a proposal.
_TURNS = 2
#: Stride of the fine nodes of an orbit at which the distances of pairs are compared.
_STRIDE = 4


@njit(**BORROWING)
def _write_end(m: FilterModel, x: FloatArray, i: int, u: FloatArray, after: FloatArray) -> None:
    """Write the state of a deputy after a hold of the thrust u, shape (6,)."""
    end = held(m, state_of(x, i), u, HOLD_PIECES)
    for k in range(6):
        after[k] = end[k]


@njit(**BORROWING)
def _reset_plans(m: FilterModel, x: FloatArray, now: bool, t: TeamWorkspace) -> None:
    """Reset the results of the plans; deputies that coast have plan 0, if `now` with the thrust written by `enter`."""
    t.met[:] = _UNKNOWN
    t.known[:] = _UNKNOWN
    for i in range(x.shape[0]):
        t.line[i] = i
        if t.fixed[i]:
            t.plan[i], t.known[i, 0] = 0, _GOOD
            for axis in range(3):
                t.thrust[i, 0, axis] = t.desired[3 * i + axis] if now else 0.0
            _write_end(m, x, i, t.thrust[i, 0], t.end[i, 0])


@njit(**BORROWING)
def _alone_safe(
    m: FilterModel, x: FloatArray, sun: SunAngle, i: int, plan: int, margins: Margins, t: TeamWorkspace, s: Workspace
) -> bool:  # fmt: skip
    """Return whether a plan of a deputy is safe regardless of the others; the result is stored."""
    if t.known[i, plan] == _UNKNOWN:
        u = t.thrust[i, plan]
        t.known[i, plan] = _BAD
        if try_plan(m, state_of(x, i), sun, plan, margins, t.effort[i], u, s):
            t.known[i, plan] = _GOOD
            _write_end(m, x, i, u, t.end[i, plan])
    return bool(t.known[i, plan] == _GOOD)


@njit(**BORROWING)
def _pair_safe(
    g: TeamModel, x: FloatArray, sun: SunAngle, first: Choice, second: Choice, margins: Margins, t: TeamWorkspace,
    s: Workspace,
) -> bool:  # fmt: skip
    """Return whether two deputies stay apart in the holds of their plans and at all later times."""
    q, (i, plan), (j, other) = g.pair, first, second
    after = minus(state_of(t.end[i], plan), state_of(t.end[j], other))
    one, two = size_of(t.thrust[i, plan]), size_of(t.thrust[j, other])
    wide = tube_about(g, margins, as_int(CLOSED), i, j, one, two, t)
    if t.fixed[i] or t.fixed[j]:
        if not apart(q.n, after, q.constraints[COLLISION].closed_near + wide.coasting):
            return False
    elif closed_motion(q, after, sun, wide, s.work, s.weak[PLANS]) != SAFE:
        return False
    elif plan == STAY == other and still(g.one, t.thrust[i, plan]) and still(g.one, t.thrust[j, other]):
        return True
    for axis in range(3):
        t.u[axis] = t.thrust[i, plan, axis] - t.thrust[j, other, axis]
    wide = tube_about(g, margins, as_int(PLAN), i, j, one, two, t)
    return bool(hold(q, motion_about(x, i, j), sun, t.u, wide, s.cells, s.where) == SAFE)


@njit(**BORROWING)
def _fits(
    g: TeamModel, x: FloatArray, sun: SunAngle, place: int, plan: int, margins: Margins, t: TeamWorkspace, s: Workspace
) -> bool:  # fmt: skip
    """Return whether a plan of the deputy at a place of the order is safe, and apart from the plans before it."""
    i = t.line[place]
    if not _alone_safe(g.one, x, sun, i, plan, margins, t, s):
        return False
    if g.pairs:
        for k in range(place):
            j = t.line[k]
            a, b = min(i, j), max(i, j)
            first, second = (plan, t.plan[j]) if i < j else (t.plan[j], plan)
            p = a * (2 * x.shape[0] - a - 1) // 2 + b - a - 1
            if t.met[p, first, second] == _UNKNOWN:
                good = _pair_safe(g, x, sun, (a, first), (b, second), margins, t, s)
                t.met[p, first, second] = _GOOD if good else _BAD
            if t.met[p, first, second] == _BAD:
                return False
    return True


@njit(**BORROWING)
def joint_plan(
    g: TeamModel, x: FloatArray, sun: SunAngle, margins: Margins, most: int, now: bool, t: TeamWorkspace, s: Workspace
) -> tuple[int, bool]:  # fmt: skip
    """Search for a joint plan from states x, the present ones if `now`, with the hints first; write it to `t.plan`.

    One deputy after another takes the first plan that is safe and apart from the plans before it. A deputy that finds
    none is moved to the front of the order, and all choose again, at most `_TURNS` times, or D + 2 times if `now`.

    Returns:
        The deputy that found no plan, or FOUND, and whether it has none even alone.
    """
    deputies = x.shape[0]
    _reset_plans(g.one, x, now, t)
    if now:
        t.effort[:] = NO_HOLD
    head = 0
    while head < deputies and t.fixed[head]:
        head += 1
    stuck = FOUND
    for _ in range(deputies + 2 if now else _TURNS):
        stuck = FOUND
        for place in range(head, deputies):
            i, chosen = t.line[place], NO_PLAN
            if t.hint[i] != NO_PLAN and _fits(g, x, sun, place, t.hint[i], margins, t, s):
                chosen = t.hint[i]
            else:
                for rank in range(most):
                    if _fits(g, x, sun, place, ORDER[rank], margins, t, s):
                        chosen = ORDER[rank]
                        break
            t.plan[i] = chosen
            if chosen == NO_PLAN:
                stuck = place
                break
        if stuck == FOUND:
            return FOUND, False
        i = t.line[stuck]
        alone = True
        for plan in range(PLANS):
            alone = alone and t.known[i, plan] != _GOOD
        if alone or stuck == head:
            return i, alone
        for place in range(stuck, head, -1):
            t.line[place] = t.line[place - 1]
        t.line[head] = i
    return t.line[head], False


@njit(**BORROWING)
def tested(
    g: TeamModel, sun: SunAngle, control: FloatArray, margins: Margins, most: int, whole: bool, t: TeamWorkspace,
    s: Workspace,
) -> tuple[int, int, bool]:  # fmt: skip
    """Test a joint control exactly: its hold, for each deputy and each pair, and a joint plan after it.

    Args:
        g: The task.
        sun: Cosine and sine of the sun angle.
        control: The thrusts [N], shape (3 D,).
        margins: Margins of the constraints.
        most: Number of plans of each deputy to try.
        whole: True: write the result for every deputy and pair; False: stop at the first violation.
        t: Workspace; the joint plan is written to `t.plan`.
        s: Workspace.

    Returns:
        PASSED, UNSAFE_HOLD or NO_JOINT_PLAN; for the last, followed by the result of `joint_plan`.
    """
    broken = False
    for k in range(t.code.shape[0] if g.pairs else t.x.shape[0]):
        i, j = t.first[k], t.second[k]
        t.code[k] = SAFE
        if j < 0:
            t.effort[i] = 0.0
        if not coasts(i, j, t):
            write_thrust(control, i, j, t)
            if j < 0:
                t.effort[i] = size_of(t.u)
            wide = tube_about(g, margins, as_int(HOLD), i, j, 0.0, 0.0, t)
            t.code[k] = hold(model_about(g, j), motion_about(t.x, i, j), sun, t.u, wide, s.cells, s.where)
            t.at[k] = s.where[0]
        if t.code[k] != SAFE:
            broken = True
            if not whole:
                return UNSAFE_HOLD, FOUND, False
    if broken:
        return UNSAFE_HOLD, FOUND, False
    for i in range(t.x.shape[0]):
        _write_end(g.one, t.x, i, control[3 * i : 3 * i + 3], t.after[i])
    later = sun_after(g.one, sun, HOLD_PIECES)
    stuck, alone = joint_plan(g, t.after, later, margins, most, False, t, s)
    return (PASSED if stuck == FOUND else NO_JOINT_PLAN), stuck, alone


@njit(**BORROWING)
def _least_apart(g: TeamModel, i: int, plan: int, best: float, t: TeamWorkspace) -> float:
    """Return the least squared distance of a deputy's plan from the others' over an orbit, or one not above `best`."""
    least = math.inf
    for j in range(t.x.shape[0]):
        if j == i or t.plan[j] == NO_PLAN:
            continue
        rel = minus(state_of(t.end[i], plan), state_of(t.end[j], t.plan[j]))
        for node in range(0, FINE_NODES, _STRIDE):
            angle = node * (2.0 * math.pi / FINE_NODES)
            p = coasting_position(g.one.n, rel, angle, g.one.fine[node, 0], g.one.fine[node, 1])
            least = min(least, inner(p, p))
            if least <= best:
                return least
    return least


@njit(**BORROWING)
def farthest_plans(
    g: TeamModel, x: FloatArray, sun: SunAngle, margins: Margins, most: int, t: TeamWorkspace, s: Workspace
) -> None:  # fmt: skip
    """Write to `t.plan` plans that are safe alone and, chosen one by one, as far apart as possible.

    A deputy that has no plan alone gets NO_PLAN. Results that `joint_plan` has stored for the same states are used.
    """
    deputies = x.shape[0]
    for i in range(deputies):
        if not t.fixed[i]:
            t.plan[i] = NO_PLAN
    for _ in range(2):
        for place in range(deputies):
            i, best, chosen = t.line[place], -1.0, NO_PLAN
            if t.fixed[i]:
                continue
            for rank in range(most):
                plan = ORDER[rank]
                if _alone_safe(g.one, x, sun, i, plan, margins, t, s):
                    least = _least_apart(g, i, plan, best, t)
                    if least > best:
                        best, chosen = least, plan
            t.plan[i] = chosen
