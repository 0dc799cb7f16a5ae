"""Compiled rows of the backup filter; see `BackupFilter` for the method."""

from __future__ import annotations

import math

from safe_inspect.compiling import BORROWING, njit
from safe_inspect.dynamics.cwh import RowState, row_state
from safe_inspect.rta.backup.cuts import add, cut_near, support
from safe_inspect.rta.backup.half_spaces import further_slack
from safe_inspect.rta.backup.holds import held, sun_after
from safe_inspect.rta.backup.model import FURTHER, HOLD_PIECES, FilterModel
from safe_inspect.rta.backup.plans import NO_HOLD, NO_PLAN, STAY, find_plan
from safe_inspect.rta.backup.search import MARGINS, ROUNDS, propose, search
from safe_inspect.rta.backup.sequences import bits_of, gap_of, least_allowed_speed, turn_of
from safe_inspect.rta.backup.tracking import begin_plan, follow_plan, plan_after, remembers, tracking
from safe_inspect.rta.backup.workspace import MAX_HALF_SPACES, Workspace, as_bool, as_int, copy, workspace
from safe_inspect.rta.constraints.rows import NO_MARGINS, Margins, Node, SunAngle, node, scaled
from safe_inspect.rta.constraints.sets import PSM
from safe_inspect.rta.projection import nearest
from safe_inspect.types import BoolArray, FloatArray, IntArray

#: Distance inside the limits that the return control aims for [m].
INSIDE = 5.0
_ROUNDS = 5
#: Reserve of speed [m/s].
_SPARE = Margins(0.0, 1e-5, 0.0)
#: Violations below this [m], [m/s] are ignored.
_MET = 1e-6
#: Bits of the constraints that are distances, which must grow, and of those that rotate with the sun.
_DISTANCES, _TURNING = bits_of("gap"), bits_of("turn")


@njit(**BORROWING)
def _allowed(m: FilterModel, at: Node) -> float:
    """Return half of the speed allowed at a position [m/s]."""
    return float(0.5 * max(0.0, min(least_allowed_speed(m.constraints, at)[0], m.u_max / m.mass * m.dt)))


@njit(**BORROWING)
def _to_rate(m: FilterModel, code: int, sun: SunAngle, d: FloatArray) -> None:
    """Replace a direction of positions by that of its rate of change."""
    for j in range(3):
        d[3 + j], d[j] = d[j], 0.0
    if _TURNING >> code & 1:
        turn_of(m.constraints, code, sun, d)


@njit(**BORROWING)
def _ask(m: FilterModel, need: float, b: RowState, u: FloatArray, s: Workspace, count: int) -> tuple[int, bool]:
    """Append d.state >= need for the direction in `s.d` unless u satisfies it; return the count and whether it was."""
    short = need
    for j in range(6):
        short -= s.d[j] * b[j]
    if not short > _MET:
        return count, False
    return add(m, need, b, u, as_int(HOLD_PIECES), s, count), True


@njit(**BORROWING)
def return_control(m: FilterModel, x: RowState, sun: SunAngle, out: FloatArray, s: Workspace) -> int:
    """Write the least-violating return control, the smallest if there are several; return the bits of its constraints.

    It must satisfy, for the state after the hold: speeds are within their limits; each distance that is less than
    `INSIDE` (from the chief, the largest range, the sun cone) grows at half the allowed speed and, if it was not
    negative, is not negative; and coasting misses the chief. The half-spaces have unit normals, so violations are in
    newtons. Each round adds the conditions that the last control violates. The desired control is ignored.
    """
    k, count, bits = HOLD_PIECES, as_int(0), 0
    now = node(x, sun)
    rate = _allowed(m, now)
    sun_b = sun_after(m, sun, k)
    s.trial[:], out[:] = 0.0, 0.0
    for _ in range(_ROUNDS):
        b, before = held(m, x, out, k), count
        end = node(b, sun_b)
        for code in range(FURTHER + m.further):
            if not m.active >> code & 1:
                continue
            need = support(m, code, end, _SPARE, s.d)
            if _DISTANCES >> code & 1 or (code >= FURTHER and s.d[3] == s.d[4] == s.d[5] == 0.0):
                gap = further_slack(m, code, x) if code >= FURTHER else gap_of(m.constraints, code, now)
                asked = False
                if gap < INSIDE:
                    count, asked = _ask(m, need if gap >= 0.0 else -math.inf, b, out, s, count)
                    _to_rate(m, code, sun_b, s.d)
                    count, more = _ask(m, rate, b, out, s, count)
                    asked = asked or more
            else:
                count, asked = _ask(m, need, b, out, s, count)
            if asked:
                bits |= 1 << code
        if now.range > m.near_psm:
            psm = count
            count = cut_near(m, x, out, as_bool(False), as_bool(False), NO_MARGINS, s, count)
            if count > psm:
                bits |= 1 << PSM
        if count == before:
            break
        _to_unit(s.rows, s.bounds, count)
        nearest(s.rows, s.bounds, count, m.u_max, s.trial, as_bool(True), s.proposal, s.projection)
        copy(s.proposal, out)
    return bits


@njit(**BORROWING)
def _to_unit(rows: FloatArray, bounds: FloatArray, count: int) -> None:
    for i in range(count):
        size = math.sqrt(rows[i, 0] ** 2 + rows[i, 1] ** 2 + rows[i, 2] ** 2)
        if size > 1e-12:
            bounds[i] /= size
            for axis in range(3):
                rows[i, axis] /= size


#: Origin of a row's control: the desired one, its projection, the result of the search from the backup, or the return
#: control for a state without a backup.
DESIRED, NEAREST, BACKUP, RETURN = range(4)


@njit(**BORROWING)
def _first_plan(m: FilterModel, x: RowState, sun: SunAngle, s: Workspace) -> bool:
    """Search for a plan from a state, write its thrust to `s.backup`, and return whether there is one.

    A plan that was accepted with the full margins is still safe with half of them, whatever the rounding since. With
    half margins, the plan that stays on a closed motion is tried first: it is the accepted one, and must not be
    replaced by another plan that is certified with half margins only and might be lost one step later.
    """
    for half in range(2):
        margins, first = scaled(MARGINS, 1.0 - 0.5 * half), as_int(STAY if half else NO_PLAN)
        if find_plan(m, x, sun, margins, NO_HOLD, first, s.backup, s) != NO_PLAN:
            return True
    return False


@njit(error_model="numpy")
def filter_rows(
    m: FilterModel, position: FloatArray, velocity: FloatArray, sun_angle: FloatArray, desired: FloatArray,
    goes_near: bool, gain: FloatArray, memory: FloatArray, control: FloatArray, refused: IntArray, stage: IntArray,
) -> None:  # fmt: skip
    """Write each row's control, the bits of the constraints that rejected the desired one, and the control's origin.

    If the desired control is rejected, one near to it is applied if `goes_near`, and otherwise the backup plan. If
    `memory` has rows, it contains the plan of each row and is updated; the plan is tracked with the given gain. If it
    has none, plans are found again.
    """
    s, tracks, rounds = workspace(as_int(MAX_HALF_SPACES)), memory.shape[0] > 0, ROUNDS if goes_near else 0
    for i in range(position.shape[0]):
        x = row_state(position[i], velocity[i])
        sun = (math.cos(sun_angle[i]), math.sin(sun_angle[i]))
        refused[i], done = propose(m, x, sun, desired[i], rounds, control[i], s)
        if done:
            stage[i] = NEAREST if refused[i] else DESIRED
            if tracks:
                plan_after(m, x, control[i], s.w, memory[i])
            continue
        known = tracks and remembers(memory[i])
        if not known and not _first_plan(m, x, sun, s):
            stage[i] = RETURN
            refused[i] = return_control(m, x, sun, control[i], s)
            continue
        stage[i] = BACKUP
        if tracks:
            if not known:
                begin_plan(x, s.backup, memory[i])
            tracking(m, gain, x, memory[i], s.backup)
        moved = False
        if goes_near:
            moved = search(m, x, sun, control[i], s)
        else:
            copy(s.backup, control[i])
        if tracks:
            if moved:
                plan_after(m, x, control[i], s.plan, memory[i])
            else:
                follow_plan(m, memory[i], s.trial, s.w)


@njit(error_model="numpy")
def recoverable_rows(
    m: FilterModel, position: FloatArray, velocity: FloatArray, sun_angle: FloatArray, share: float,
    out: BoolArray, control: FloatArray,
) -> None:  # fmt: skip
    """Write whether each row has a backup plan with a share of the margins, and its thrust (zero if there is none).

    The plan that stays on a closed motion is tried first.
    """
    s = workspace(as_int(1))
    for i in range(position.shape[0]):
        x = row_state(position[i], velocity[i])
        sun = (math.cos(sun_angle[i]), math.sin(sun_angle[i]))
        plan = find_plan(m, x, sun, scaled(MARGINS, share), NO_HOLD, as_int(STAY), control[i], s)
        out[i] = plan != NO_PLAN
        if not out[i]:
            control[i, :] = 0.0
