"""Compiled search for the safe control that is nearest to the desired one.

First, the desired control is projected onto the half-spaces of the convex constraints, speeds and the largest range.
These contain all controls that satisfy the constraints, except for a few that are excluded by the tangent half-space of
`rel_vel`, whose limit grows with the range. Therefore, if the projection passes the exact test, no other control is
nearer by more than a few mN. If it does not, because of the chief, the sun cone, or a missing plan, the set of safe
controls is not convex. Then a pattern search (Hooke and Jeeves, "Direct search solution of numerical and statistical
problems", Journal of the ACM 8, 1961) leads from the thrust of the backup towards the desired control through controls
that pass the test.
"""

from __future__ import annotations

import math

from safe_inspect.compiling import BORROWING, njit
from safe_inspect.dynamics.cwh import RowState
from safe_inspect.rta.backup.cuts import CONVEX, cut_broken, cut_end, cut_hold, tightest
from safe_inspect.rta.backup.holds import held, hold, sun_after
from safe_inspect.rta.backup.model import HOLD, HOLD_PIECES, PLAN, FilterModel
from safe_inspect.rta.backup.plans import NO_PLAN, STAY, find_plan
from safe_inspect.rta.backup.sequences import SAFE
from safe_inspect.rta.backup.tracking import widened
from safe_inspect.rta.backup.workspace import Workspace, as_bool, as_int, copy
from safe_inspect.rta.constraints.rows import Margins, SunAngle, scaled, size_of
from safe_inspect.rta.projection import nearest
from safe_inspect.types import FloatArray

#: Margins that a control must leave to be accepted; a backup needs only half of them.
MARGINS = Margins(1e-3, 1e-5, 1e-3)
#: Margins that the half-spaces of the programme add, as multiples of `MARGINS`.
EXTRA = 2.0
#: Largest number of rounds of the projection.
ROUNDS = 6
#: Largest number of solutions of the programme in a round.
POLISH = 4
#: A proposal that moves by less than this [N] has converged.
STILL = 1e-7
#: Halvings of the segment from the backup to the projection, at the start of the pattern search.
_HALVINGS = 3
#: First step of the search as a fraction of the distance to gain, largest step, and last step, in multiples of `u_max`.
_SHARE, _LARGEST, _SMALLEST = 0.8, 0.5, 0.015
#: Weight of the direction to the desired control, beyond the part that would only preserve the distance from it.
_TURN = 0.3
#: Largest number of repetitions of an accepted step, and the factor by which each is longer than the one before.
_STRIDES, _STRETCH = 4, 1.5
#: If no step gains, the next steps are multiplied by this and point between the previous ones.
_SHRINK = 0.5
#: A step must gain at least this fraction of its length.
_GAIN = 0.05


@njit(**BORROWING)
def squared(a: FloatArray, b: FloatArray) -> float:
    """Return the squared distance between two thrusts, or between those of several deputies [N^2]."""
    total = 0.0
    for k in range(a.shape[0]):
        total += (a[k] - b[k]) ** 2
    return total


@njit(**BORROWING)
def verified(
    m: FilterModel, x: RowState, sun: SunAngle, u: FloatArray, first: int, s: Workspace
) -> tuple[int, int]:  # fmt: skip
    """Return the constraint that rejects the hold of u, or SAFE, and a plan for the state after it, or NO_PLAN."""
    effort = size_of(u)
    code = hold(m, x, sun, u, widened(m, MARGINS, as_int(HOLD), effort, 0.0), s.cells, s.where)
    if code != SAFE:
        return code, NO_PLAN
    after, later = held(m, x, u, HOLD_PIECES), sun_after(m, sun, HOLD_PIECES)
    return SAFE, find_plan(m, after, later, MARGINS, effort, first, s.w, s)


@njit(**BORROWING)
def _wanted(m: FilterModel, u: FloatArray) -> Margins:
    """Return the margins of the programme's half-spaces: those before a plan, because a plan follows the hold."""
    return widened(m, scaled(MARGINS, EXTRA), as_int(PLAN), size_of(u), 0.0)


@njit(**BORROWING)
def _refusals(m: FilterModel, x: RowState, sun: SunAngle, u: FloatArray, code: int, s: Workspace) -> int:
    """Return the bits of the constraints that reject a control, given the result of `verified` for its hold."""
    if code == SAFE:
        return 1 << tightest(m, x, sun, u, s)
    return int(cut_broken(m, x, sun, u, as_bool(False), _wanted(m, u), s, as_int(0))[1] | 1 << code)


@njit(**BORROWING)
def propose(
    m: FilterModel, x: RowState, sun: SunAngle, desired: FloatArray, rounds: int, u: FloatArray, s: Workspace
) -> tuple[int, bool]:  # fmt: skip
    """Project the desired control into u, in at most `rounds` rounds.

    The desired control, clipped, is written to `s.desired`, and the thrust of the plan after a verified u to `s.w`.

    Returns:
        The bits of the constraints that reject the desired control, and whether u is verified.
    """
    for axis in range(3):
        s.desired[axis] = min(max(desired[axis], -m.u_max), m.u_max)
        u[axis] = s.desired[axis]
    code, plan = verified(m, x, sun, u, as_int(NO_PLAN), s)
    if plan != NO_PLAN:
        return 0, True
    bits, count, piece = 0, as_int(0), s.where[0]
    bits = _refusals(m, x, sun, u, code, s)
    for attempt in range(rounds):
        margins, before = _wanted(m, u), count
        if code != SAFE and CONVEX >> code & 1:
            count = cut_hold(m, x, sun, u, (code, piece), as_bool(False), margins, s, count)
        elif attempt > 0:
            break
        count = cut_end(m, x, sun, u, as_int(CONVEX), margins, s, count)[0]
        if count == before:
            break
        for _ in range(POLISH):
            if not nearest(s.rows, s.bounds, count, m.u_max, s.desired, as_bool(False), s.proposal, s.projection):
                return bits, False
            moved = math.sqrt(squared(s.proposal, u))
            copy(s.proposal, u)
            if moved < STILL:
                break
            before = count
            count = cut_end(m, x, sun, u, as_int(CONVEX), scaled(margins, 0.75), s, count)[0]
            if count == before:
                break
        code, plan = verified(m, x, sun, u, as_int(NO_PLAN), s)
        if plan != NO_PLAN:
            return bits, True
        piece = s.where[0]
    return bits, False


@njit(**BORROWING)
def _take(m: FilterModel, x: RowState, sun: SunAngle, plan: int, s: Workspace) -> int:
    """Copy `s.trial` to the best control if it is verified; return the plan after it, or NO_PLAN."""
    found = verified(m, x, sun, s.trial, plan, s)[1]
    if found != NO_PLAN:
        copy(s.trial, s.best)
        copy(s.w, s.plan)
    return int(found)


@njit(**BORROWING)
def _step(
    m: FilterModel, x: RowState, sun: SunAngle, away: float, length: float, plan: int, s: Workspace
) -> int:  # fmt: skip
    """Try steps of a length from the best control, 120 degrees apart; return the plan after the new best, or NO_PLAN.

    Args:
        m: The task.
        x: The state.
        sun: Cosine and sine of the sun angle.
        away: Distance of the best control from the desired one [N].
        length: Length of the step [N]; with the opposite sign, steps point between those of the first sign.
        plan: The plan after the best control.
        s: Workspace.
    """
    best, desired, trial = s.best, s.desired, s.trial
    ex, ey, ez = (desired[0] - best[0]) / away, (desired[1] - best[1]) / away, (desired[2] - best[2]) / away
    # A vector perpendicular to that direction, constructed from the axis nearest to perpendicular.
    ax, ay, az = abs(ex), abs(ey), abs(ez)
    if ax <= ay and ax <= az:
        tx, ty, tz = 0.0, -ez, ey
    elif ay <= az:
        tx, ty, tz = ez, 0.0, -ex
    else:
        tx, ty, tz = -ey, ex, 0.0
    scale = 1.0 / math.sqrt(tx * tx + ty * ty + tz * tz)
    tx, ty, tz = scale * tx, scale * ty, scale * tz
    bx, by, bz = ey * tz - ez * ty, ez * tx - ex * tz, ex * ty - ey * tx
    size = abs(length)
    keeping = 0.5 * size / away
    forward = size * (keeping + _TURN * (1.0 - keeping))
    if not forward < size:
        return NO_PLAN
    aside = math.copysign(math.sqrt(size * size - forward * forward), length)
    for which in range(3):
        t, b = aside * (1.0, -0.5, -0.5)[which], aside * (0.0, 0.75**0.5, -(0.75**0.5))[which]
        dx, dy, dz = forward * ex + t * tx + b * bx, forward * ey + t * ty + b * by, forward * ez + t * tz + b * bz
        nearest_yet, taken = (away - _GAIN * size) ** 2, NO_PLAN
        for _ in range(1 + _STRIDES):
            trial[0] = min(max(best[0] + dx, -m.u_max), m.u_max)
            trial[1] = min(max(best[1] + dy, -m.u_max), m.u_max)
            trial[2] = min(max(best[2] + dz, -m.u_max), m.u_max)
            distance = squared(trial, desired)
            if not distance < nearest_yet:
                break
            found = _take(m, x, sun, plan, s)
            if found == NO_PLAN:
                break
            plan, taken, nearest_yet = found, found, distance
            dx, dy, dz = _STRETCH * dx, _STRETCH * dy, _STRETCH * dz
        if taken != NO_PLAN:
            return taken
    return NO_PLAN


@njit(**BORROWING)
def search(m: FilterModel, x: RowState, sun: SunAngle, u: FloatArray, s: Workspace) -> bool:
    """Write to u, which contains the projection, a verified control that the search finds nearest to the desired one.

    The search starts at `s.backup`, and ends when no step of `_SMALLEST` gains, or near the distance of the projection.

    Returns:
        Whether the control differs from the backup; the thrust of the plan after it is then in `s.plan`.
    """
    copy(s.backup, s.best)
    copy(u, s.proposal)
    least, smallest = math.sqrt(squared(u, s.desired)), _SMALLEST * m.u_max
    low, high, plan, moved = 0.0, 1.0, as_int(STAY), False
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        for axis in range(3):
            s.trial[axis] = s.backup[axis] + middle * (s.proposal[axis] - s.backup[axis])
        found = as_int(NO_PLAN)
        if squared(s.trial, s.desired) < squared(s.best, s.desired):
            found = _take(m, x, sun, plan, s)
        if found != NO_PLAN:
            low, plan, moved = middle, found, True
        else:
            high = middle
    away = math.sqrt(squared(s.best, s.desired))
    length = max(min(_LARGEST * m.u_max, _SHARE * (away - least)), smallest)
    while abs(length) >= smallest and away - least > smallest:
        found = _step(m, x, sun, away, length, plan, s)
        if found == NO_PLAN:
            length *= -_SHRINK
            continue
        plan, moved, away = found, True, math.sqrt(squared(s.best, s.desired))
    copy(s.best, u)
    return moved
