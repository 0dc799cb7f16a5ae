"""Compiled half-spaces of joint controls that approximate the constraints of each deputy and each pair.

Those of a deputy alone are the same as in the single filter. Those of a pair's hold are the same with respect to the
other deputy, as half-spaces of the difference of the two thrusts. Those of a pair's plans are linear in both thrusts.
"""

from __future__ import annotations

import math

from safe_inspect.compiling import BORROWING, njit
from safe_inspect.dynamics.coasting import coasting_position
from safe_inspect.dynamics.cwh import RowState
from safe_inspect.rta.backup.cuts import STEP, cut_broken, cut_hold, cut_recovery
from safe_inspect.rta.backup.holds import held, sun_after
from safe_inspect.rta.backup.model import CLOSED, FINE_NODES, HOLD_PIECES, PAIR_BIT, PLAN, FilterModel
from safe_inspect.rta.backup.plans import NO_PLAN, QUICK, plan_thrust
from safe_inspect.rta.backup.sequences import SAFE
from safe_inspect.rta.backup.workspace import Workspace, as_int, copy
from safe_inspect.rta.constraints.rows import NO_MARGINS, Margins, SunAngle, inner, size_of
from safe_inspect.rta.constraints.sets import COLLISION
from safe_inspect.rta.team.motions import coasts, minus, model_about, motion_about, state_of, tube_about, write_thrust
from safe_inspect.rta.team.plans import farthest_plans
from safe_inspect.rta.team.workspace import TeamModel, TeamWorkspace

#: Slack required of a plan at the nodes of its orbit [m], to cover the motion between them.
_NODE_MARGIN = 0.05


@njit(**BORROWING)
def _spread(new: int, i: int, j: int, count: int, t: TeamWorkspace, s: Workspace) -> int:
    """Append the half-spaces in `s.rows` to the programme: of the thrust of i or, if j >= 0, of that of i minus j.

    The thrusts of deputies that coast are fixed.
    """
    for r in range(new):
        first = s.rows[r]
        size = math.sqrt(first[0] ** 2 + first[1] ** 2 + first[2] ** 2)
        if j >= 0 and not (t.fixed[i] or t.fixed[j]):
            size *= math.sqrt(2.0)
        if count >= t.rows.shape[0] or size < 1e-12:
            continue
        t.rows[count, :] = 0.0
        given = 0.0
        for deputy, sign in ((i, 1.0), (j, -1.0)):
            for axis in range(3 if deputy >= 0 else 0):
                if t.fixed[deputy]:
                    given += sign * first[axis] * t.control[3 * deputy + axis]
                else:
                    t.rows[count, 3 * deputy + axis] = sign * first[axis] / size
        t.bounds[count] = (s.bounds[r] - given) / size
        count += 1
    return count


@njit(**BORROWING)
def cut_holds(
    g: TeamModel, sun: SunAngle, own_side: bool, margins: Margins, ends: bool, bits: bool, count: int,
    t: TeamWorkspace, s: Workspace,
) -> int:  # fmt: skip
    """Append half-spaces for the deputies and pairs whose hold of the last proposal was rejected; return the count.

    Args:
        g: The task.
        sun: Cosine and sine of the sun angle.
        own_side: Whether to stay on this side of the chief instead of passing it; for other deputies, always true.
        margins: Margins of the constraints.
        ends: Whether to append them for every hold instead, only for what is violated at its end.
        bits: Whether to record in `t.bits` what rejected the hold.
        count: Number of half-spaces so far.
        t: Workspace, after `tested`.
        s: Workspace.
    """
    for k in range(t.code.shape[0] if g.pairs else t.x.shape[0]):
        i, j = t.first[k], t.second[k]
        if coasts(i, j, t) or not (ends or t.code[k] != SAFE):
            continue
        write_thrust(t.control, i, j, t)
        m, x, same_side, new = model_about(g, j), motion_about(t.x, i, j), own_side or j >= 0, as_int(0)
        wide = tube_about(g, margins, as_int(PLAN), i, j, 0.0, 0.0, t)
        if not ends:
            new = cut_hold(m, x, sun, t.u, (t.code[k], t.at[k]), same_side, wide, s, new)
        new, broken = cut_broken(m, x, sun, t.u, same_side, wide, s, new)
        count = _spread(new, i, j, count, t, s)
        if bits and j < 0:
            t.bits[i] |= broken | 1 << t.code[k]
        elif bits:
            bit = 1 << (PAIR_BIT if t.code[k] == COLLISION else PAIR_BIT + 1)
            t.bits[i] |= bit
            t.bits[j] |= bit
    return count


@njit(**BORROWING)
def _plan_end(m: FilterModel, i: int, axis: int, t: TeamWorkspace, s: Workspace) -> RowState:
    """Return the state after the hold of a deputy's last proposal, stepped along an axis, and of its plan."""
    copy(t.control[3 * i : 3 * i + 3], t.u)
    if axis >= 0:
        t.u[axis] += STEP
    after = held(m, state_of(t.x, i), t.u, HOLD_PIECES)
    if t.fixed[i]:
        s.w[:] = 0.0
    else:
        plan_thrust(m, after, t.plan[i], s.w)
    return held(m, after, s.w, HOLD_PIECES)


@njit(**BORROWING)
def _cut_pair_plans(g: TeamModel, i: int, j: int, count: int, t: TeamWorkspace, s: Workspace) -> int:
    """Append half-spaces that keep a pair's plans apart, at nodes of an orbit where they are not; return the count."""
    m, n = g.one, g.one.n
    one, two = size_of(t.thrust[i, t.plan[i]]), size_of(t.thrust[j, t.plan[j]])
    wide = tube_about(g, NO_MARGINS, as_int(CLOSED), i, j, one, two, t)
    reach = g.pair.constraints[COLLISION].closed_near + _NODE_MARGIN + wide.coasting
    a, b = _plan_end(m, i, as_int(-1), t, s), _plan_end(m, j, as_int(-1), t, s)
    ends_i = _plan_end(m, i, as_int(0), t, s), _plan_end(m, i, as_int(1), t, s), _plan_end(m, i, as_int(2), t, s)
    ends_j = _plan_end(m, j, as_int(0), t, s), _plan_end(m, j, as_int(1), t, s), _plan_end(m, j, as_int(2), t, s)
    rel = minus(a, b)
    previous, falling = math.inf, False
    for place in range(FINE_NODES + 1):
        node = place % FINE_NODES
        p = coasting_position(n, rel, place * (2.0 * math.pi / FINE_NODES), m.fine[node, 0], m.fine[node, 1])
        here = size_of(p)
        if falling and here >= previous and previous < reach and count < t.rows.shape[0]:
            angle, cos, sin = (place - 1) * (2.0 * math.pi / FINE_NODES), m.fine[place - 1, 0], m.fine[place - 1, 1]
            p = coasting_position(n, rel, angle, cos, sin)
            size = size_of(p) + 1e-9
            p = p[0] / size, p[1] / size, p[2] / size
            t.rows[count, :] = 0.0
            for axis in range(3):
                pa = coasting_position(n, minus(ends_i[axis], a), angle, cos, sin)
                pb = coasting_position(n, minus(ends_j[axis], b), angle, cos, sin)
                if not t.fixed[i]:
                    t.rows[count, 3 * i + axis] = inner(p, pa) / STEP
                if not t.fixed[j]:
                    t.rows[count, 3 * j + axis] = -inner(p, pb) / STEP
            length, value = 0.0, reach - previous
            for k in range(t.rows.shape[1]):
                length += t.rows[count, k] ** 2
                value += t.rows[count, k] * t.control[k]
            length = math.sqrt(length)
            if length > 1e-9:
                for k in range(t.rows.shape[1]):
                    t.rows[count, k] /= length
                t.bounds[count] = value / length
                count += 1
        falling = here < previous
        previous = here
    return count


@njit(**BORROWING)
def cut_plans(
    g: TeamModel, sun: SunAngle, stuck: int, alone: bool, margins: Margins, bits: bool, count: int, t: TeamWorkspace,
    s: Workspace,
) -> int:  # fmt: skip
    """Append half-spaces for the joint plan that the last proposal does not allow; return the count.

    Args:
        g: The task.
        sun: Cosine and sine of the sun angle before the hold.
        stuck: The deputy that found no plan.
        alone: Whether it has none even alone: then its own constraints are linearised, otherwise the distances of the
            pairs, on the plans that are farthest apart.
        margins: Margins of the plans.
        bits: Whether to record in `t.bits` what rejected the hold.
        count: Number of half-spaces so far.
        t: Workspace, after `tested`.
        s: Workspace.
    """
    if alone:
        write_thrust(t.control, stuck, as_int(-1), t)
        new, code = cut_recovery(g.one, state_of(t.x, stuck), sun, t.u, _NODE_MARGIN, s, as_int(0))
        if bits:
            t.bits[stuck] |= 1 << code
        return int(_spread(new, stuck, as_int(-1), count, t, s))
    later = sun_after(g.one, sun, HOLD_PIECES)
    if bits:
        t.bits[stuck] |= 1 << PAIR_BIT
    farthest_plans(g, t.after, later, margins, as_int(QUICK), t, s)
    for i in range(t.x.shape[0]):
        for j in range(i + 1, t.x.shape[0]):
            if t.plan[i] != NO_PLAN and t.plan[j] != NO_PLAN and not (t.fixed[i] and t.fixed[j]):
                count = _cut_pair_plans(g, i, j, count, t, s)
    return count
