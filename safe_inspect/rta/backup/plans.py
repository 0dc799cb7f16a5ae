"""Compiled backup plans: holds of thrust to a closed natural motion that is safe permanently.

If the thrusters are strong, a plan has one hold. If they are weak, further holds may precede it, which move towards the
first plan of `ORDER` as far as the thrusters allow. The first of these is applied, and the rest is found again one step
later.

A plan is defined by two numbers, the radial and the cross-track speed after its hold; the along-track speed is then
-2 n x, which leaves no drift. Velocities are affine in the thrust, so computing a plan's thrust takes a 3 x 3 product.
"""

from __future__ import annotations

from safe_inspect.compiling import BORROWING, njit
from safe_inspect.dynamics.cwh import RowState, cwh_row
from safe_inspect.rta.backup.closed_motion import closed_motion, refuted
from safe_inspect.rta.backup.holds import held, hold, sun_after
from safe_inspect.rta.backup.model import (
    CLOSED,
    CROSS,
    FIRST_CLOSED,
    FIRST_PLAN,
    HOLD_PIECES,
    PLAN,
    PLANS,
    RADIAL,
    FilterModel,
)
from safe_inspect.rta.backup.sequences import SAFE
from safe_inspect.rta.backup.tracking import tracking_thrust, widened
from safe_inspect.rta.backup.workspace import Workspace, as_int
from safe_inspect.rta.constraints.rows import INLINED, Margins, SunAngle, size_of
from safe_inspect.types import FloatArray

NO_PLAN = -1
#: Value of an effort if there is no hold before a plan.
NO_HOLD = -1.0
#: Index of the plan with several holds.
SEVERAL = PLANS
_C = len(CROSS) + 1
#: Index of the plan that does not change the radial and cross-track speeds: it stays on a closed motion.
STAY = _C + 1
#: A plan that changes the velocity by less than this [m/s] is coasting, well within the margins.
_STILL = 1e-10
#: Number of plans that a quick search tries; 97 % of the states that have a plan, visited under adversarial controls,
#: have one of these.
QUICK = 24
#: Plans in the order in which they are tried: each is safe in the most of those states in which no earlier one is safe.
ORDER = (
    4, 9, 3, 47, 55, 0, 72, 64, 2, 1, 61, 46, 73, 49, 39, 54, 44, 65, 14, 57, 5, 6, 15, 58, 68, 77, 24, 38, 7, 13, 78,
    67, 74, 63, 8, 12, 79, 33, 53, 75, 76, 52, 62, 41, 59, 51, 56, 70, 10, 23, 27, 35, 48, 11, 40, 66, 30, 36, 22, 25,
    60, 69, 16, 71, 17, 19, 21, 31, 42, 45, 50, 18, 29, 32, 37, 26, 20, 34, 43, 28,
)  # fmt: skip


@njit(**BORROWING)
def plan_thrust(m: FilterModel, x: RowState, index: int, u: FloatArray) -> float:
    """Write the thrust of a plan from x, which may exceed the limits; return the largest component [N].

    Args:
        m: The task.
        x: The initial state.
        index: The plan, 0 to PLANS - 1.
        u: Receives the thrust [N], shape (3,).
    """
    return float(_thrust(m, _coasted_hold(m, x), index, u))


@njit(**INLINED)
def _coasted_hold(m: FilterModel, x: RowState) -> RowState:
    """Return the state after a hold without thrust."""
    return cwh_row(m.hold_phi[HOLD_PIECES], m.hold_gamma[HOLD_PIECES], x, 0.0, 0.0, 0.0)


@njit(**INLINED)
def _thrust(m: FilterModel, free: RowState, index: int, u: FloatArray) -> float:
    """Write the thrust of a plan, given the state after a hold without thrust; see `plan_thrust`."""
    scale = m.n * size_of(free)
    a, c = index // _C, index % _C
    radial = free[3] if a == 1 else 0.5 * m.n * free[1] + scale * RADIAL[a - 1 if a > 1 else 0]
    cross = free[5] if c == 1 else scale * CROSS[c - 1 if c > 1 else 0]
    dx, dy, dz = radial - free[3], -2.0 * m.n * free[0] - free[4], cross - free[5]
    for axis in range(3):
        u[axis] = m.plan[axis, 0] * dx + m.plan[axis, 1] * dy + m.plan[axis, 2] * dz
    return float(max(abs(u[0]), abs(u[1]), abs(u[2])))


@njit(**BORROWING)
def still(m: FilterModel, u: FloatArray) -> bool:
    """Return whether holding a thrust is equivalent to coasting."""
    return bool(max(abs(u[0]), abs(u[1]), abs(u[2])) * m.dt <= _STILL * m.mass)


@njit(**INLINED)
def _tube_parts(effort: float) -> tuple[int, int]:
    """Return the part of the motion of a plan's hold, and that of the closed motion after it."""
    return (PLAN, CLOSED) if effort >= 0.0 else (FIRST_PLAN, FIRST_CLOSED)


@njit(**INLINED)
def _possible(
    m: FilterModel, free: RowState, sun: SunAngle, index: int, margins: Margins, effort: float, u: FloatArray,
    s: Workspace,
) -> bool:  # fmt: skip
    """Write the thrust of a plan; return False if it is not admissible or its motion is unsafe where it last was.

    `free` is the state after a hold without thrust, and `sun` the sun angle at that time.
    """
    first, then = _tube_parts(effort)
    # With half margins, the thrust may exceed the limits by rounding: 1e-9 of them, which is clipped before use.
    most = m.u_max * (1.0 + max(0.0, 2e-9 - 2e-6 * margins.length)) - tracking_thrust(m, first, effort)
    if _thrust(m, free, index, u) > most:
        return False
    size = size_of(u)
    for axis in range(3):
        u[axis] = min(max(u[axis], -m.u_max), m.u_max)
    gamma = m.hold_gamma[HOLD_PIECES]
    after = (
        free[0] + gamma[0, 0] * u[0] + gamma[0, 1] * u[1], free[1] + gamma[1, 0] * u[0] + gamma[1, 1] * u[1],
        free[2] + gamma[2, 2] * u[2], free[3] + gamma[3, 0] * u[0] + gamma[3, 1] * u[1],
        free[4] + gamma[4, 0] * u[0] + gamma[4, 1] * u[1], free[5] + gamma[5, 2] * u[2],
    )  # fmt: skip
    return not refuted(m, after, sun, widened(m, margins, then, effort, size), s.weak[index])


@njit(**BORROWING)
def _safe(
    m: FilterModel, x: RowState, sun: SunAngle, index: int, margins: Margins, effort: float, u: FloatArray, s: Workspace
) -> bool:  # fmt: skip
    """Return whether a plan's thrust u is safe during the hold and at all later times."""
    first, then = _tube_parts(effort)
    size = size_of(u)
    after, later = held(m, x, u, HOLD_PIECES), sun_after(m, sun, HOLD_PIECES)
    if closed_motion(m, after, later, widened(m, margins, then, effort, size), s.work, s.weak[index]) != SAFE:
        return False
    if index == STAY and still(m, u):
        return True  # The hold is a part of the closed motion.
    return bool(hold(m, x, sun, u, widened(m, margins, first, effort, size), s.cells, s.at) == SAFE)


@njit(**BORROWING)
def try_plan(
    m: FilterModel, x: RowState, sun: SunAngle, index: int, margins: Margins, effort: float, u: FloatArray, s: Workspace
) -> bool:  # fmt: skip
    """Write the thrust of a plan from x; return whether it is admissible and safe in the hold and at all later times.

    `effort` is the size of the thrust before it [N], on which the tube about the plan depends; negative if there is
    none.
    """
    later = sun_after(m, sun, HOLD_PIECES)
    possible = _possible(m, _coasted_hold(m, x), later, index, margins, effort, u, s)
    return bool(possible and _safe(m, x, sun, index, margins, effort, u, s))


@njit(**BORROWING)
def _of_one_hold(
    m: FilterModel, x: RowState, sun: SunAngle, margins: Margins, effort: float, first: int, most: int, u: FloatArray,
    s: Workspace,
) -> int:  # fmt: skip
    """Write the thrust of a safe plan of one hold and return its index, or NO_PLAN; see `find_plan`."""
    if first != NO_PLAN and try_plan(m, x, sun, first, margins, effort, u, s):
        return first
    free, later = _coasted_hold(m, x), sun_after(m, sun, HOLD_PIECES)
    for place in range(most):
        index = ORDER[place]
        if index == first or not _possible(m, free, later, index, margins, effort, u, s):
            continue
        if _safe(m, x, sun, index, margins, effort, u, s):
            return index
    return NO_PLAN


@njit(**BORROWING)
def _lead(m: FilterModel, x: RowState, sun: SunAngle, margins: Margins, u: FloatArray, s: Workspace) -> bool:
    """Write the first thrust of a plan of several holds; return False if it is not safe. It has no tube about it."""
    for k in range(m.leads):
        plan_thrust(m, x, as_int(ORDER[0]), s.lead)
        for axis in range(3):
            s.lead[axis] = min(max(s.lead[axis], -m.u_max), m.u_max)
            if k == 0:
                u[axis] = s.lead[axis]
        if hold(m, x, sun, s.lead, margins, s.cells, s.at) != SAFE:
            return False
        x = held(m, x, s.lead, HOLD_PIECES)
        sun = sun_after(m, sun, HOLD_PIECES)
        if _of_one_hold(m, x, sun, margins, NO_HOLD, as_int(NO_PLAN), as_int(QUICK), s.then, s) != NO_PLAN:
            return True
    return False


@njit(**BORROWING)
def find_plan(
    m: FilterModel, x: RowState, sun: SunAngle, margins: Margins, effort: float, first: int, u: FloatArray, s: Workspace
) -> int:  # fmt: skip
    """Write the first thrust of a safe plan and return its index or SEVERAL; NO_PLAN if there is none.

    Args:
        m: The task.
        x: The state.
        sun: Cosine and sine of the sun angle.
        margins: Margins of the constraints.
        effort: Size of the thrust before the plan [N]; negative if there is none. See `try_plan`.
        first: A plan to try before the others, or NO_PLAN.
        u: Receives the thrust [N], shape (3,).
        s: Workspace.
    """
    if first == SEVERAL and _lead(m, x, sun, margins, u, s):
        return SEVERAL
    known = as_int(NO_PLAN) if first == SEVERAL else first
    index: int = _of_one_hold(m, x, sun, margins, effort, known, as_int(PLANS), u, s)
    if index != NO_PLAN or first == SEVERAL or m.leads == 0:
        return index
    return SEVERAL if _lead(m, x, sun, margins, u, s) else NO_PLAN
