"""The rows of the backup filter, compiled; `BackupFilter` documents the method."""

from __future__ import annotations

import math

from safe_inspect.compiling import njit
from safe_inspect.dynamics.cwh_row import RowState
from safe_inspect.rta.constraints.certified import COLLISION, PSM
from safe_inspect.rta.constraints.rows import INNER, Margins, SunAngle, scaled
from safe_inspect.rta.filters.backup.arcs import held, turned
from safe_inspect.rta.filters.backup.cuts import Refusal, cut_broken, cut_hold
from safe_inspect.rta.filters.backup.holds import hold
from safe_inspect.rta.filters.backup.model import HOLD, HOLD_PIECES, PLAN, FilterModel
from safe_inspect.rta.filters.backup.plan_cuts import cut_recovery
from safe_inspect.rta.filters.backup.plans import NO_HOLD, NO_PLAN, PLANS, QUICK, STAY, find_plan
from safe_inspect.rta.filters.backup.returning import return_control
from safe_inspect.rta.filters.backup.sequences import SAFE
from safe_inspect.rta.filters.backup.workspace import MAX_HALF_SPACES, Workspace, as_int, workspace
from safe_inspect.rta.filters.tube.margins import widened
from safe_inspect.rta.filters.tube.rows import begin_plan, follow_plan, plan_after, remembers, tracking
from safe_inspect.rta.numerics.projection import nearest
from safe_inspect.types import BoolArray, FloatArray, IntArray

#: Where a row's control comes from: it is the desired one, the nearest safe one that cutting planes lead to, one
#: between the backup and that, or the way back from a state without a backup.
DESIRED, NEAREST, BACKUP, RETURN = range(4)
#: Margins that a control must leave to be taken; a backup is still one with half of them.
MARGINS = Margins(1e-3, 1e-5, 1e-3)
#: Bits of what keeps off the chief.
NEAR_BITS = 1 << COLLISION | 1 << PSM
#: What the half-spaces of the programme ask for beyond the margins, in multiples of them.
_EXTRA = 2.0
_ROUNDS = 6
#: Rounds that may end in a state without a plan.
_RECOVERIES = 2
#: Slack that a plan is asked for at the nodes of its orbit [m], for what lies between them.
NODE_MARGIN = 0.05
_POLISH = 4
#: A proposal that moves less than this [N] has settled.
_STILL = 1e-7
_HALVINGS = 6
#: Plans that the search along a line tries, beside the last that was safe.
_FEW = 6
#: Distance of a control from the best one at which the search along a line ends [N].
_FINE = 2e-3


@njit(**INNER)
def _verified(
    m: FilterModel, x: RowState, sun: SunAngle, u: FloatArray, first: int, most: int, s: Workspace
) -> tuple[int, int]:  # fmt: skip
    """Return the constraint that refuses the hold of u, or SAFE, and a plan for the state after it, or NO_PLAN."""
    effort = math.sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2])
    code = hold(m, x, sun, u, widened(m, MARGINS, as_int(HOLD), effort, 0.0), s.cells, s.where)
    if code != SAFE:
        return code, NO_PLAN
    after, later = held(m, x, u, HOLD_PIECES), turned(sun, m.hold_sun[HOLD_PIECES, 0], m.hold_sun[HOLD_PIECES, 1])
    return SAFE, find_plan(m, after, later, MARGINS, effort, first, most, s.w, s)


@njit(**INNER)
def _cut(
    m: FilterModel, x: RowState, sun: SunAngle, desired: FloatArray, own_side: bool, u: FloatArray, s: Workspace
) -> tuple[int, bool]:  # fmt: skip
    """Look for a verified control by cutting planes; return the bits of the refusals and whether u is one.

    Each round adds half-spaces for what the last proposal breaks and proposes the control of the programme.
    """
    count, bits, plan, unrecovered = as_int(0), as_int(0), as_int(NO_PLAN), 0
    for axis in range(3):
        u[axis] = desired[axis]
    for attempt in range(_ROUNDS):
        code, plan = _verified(m, x, sun, u, plan, as_int(PLANS) if attempt == 0 else as_int(QUICK), s)
        if plan != NO_PLAN:
            return bits, True
        broken = 0
        # the state after the hold is that before a plan, about which the tube is wider
        effort = math.sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2])
        margins = widened(m, scaled(MARGINS, _EXTRA), as_int(PLAN), effort, 0.0)
        if code != SAFE:
            count = cut_hold(m, x, sun, u, Refusal(code, s.where[0]), own_side, margins, s, count)
            count, broken = cut_broken(m, x, sun, u, own_side, margins, s, count)
        else:
            unrecovered += 1
            if unrecovered > _RECOVERIES:
                return bits, False
            count, code = cut_recovery(m, x, sun, u, NODE_MARGIN, s, count)
        if attempt == 0:
            bits = broken | 1 << code
        for _ in range(_POLISH):
            if not nearest(s.rows, s.bounds, count, m.u_max, desired, False, s.proposal, s.missed, s.projection):
                return bits, False
            moved = math.sqrt(_squared(s.proposal, u))
            for axis in range(3):
                u[axis] = s.proposal[axis]
            if moved < _STILL:
                break
            before = count
            count, _ = cut_broken(m, x, sun, u, own_side, scaled(margins, 0.75), s, count)
            if count == before:
                break
    return bits, False


@njit(**INNER)
def _between(m: FilterModel, x: RowState, sun: SunAngle, desired: FloatArray, u: FloatArray, s: Workspace) -> bool:
    """Write into u a verified control on the segment from the backup to u, as near to the desired as it finds.

    Returns:
        Whether it is another one than the backup; the thrust of the plan after it is then in `s.plan`.
    """
    for axis in range(3):
        s.best[axis], s.proposal[axis] = s.backup[axis], s.backup[axis]
    size = math.sqrt(_squared(u, s.proposal))
    low, high, plan, moved = 0.0, 1.0, as_int(STAY), False
    for _ in range(_HALVINGS):
        if size * (high - low) < _FINE:
            break
        middle = 0.5 * (low + high)
        for axis in range(3):
            s.trial[axis] = s.proposal[axis] + middle * (u[axis] - s.proposal[axis])
        _, found = _verified(m, x, sun, s.trial, plan, as_int(_FEW), s)
        if found != NO_PLAN and _squared(s.trial, desired) < _squared(s.best, desired):
            low, plan, moved = middle, found, True
            for axis in range(3):
                s.best[axis], s.plan[axis] = s.trial[axis], s.w[axis]
        else:
            high = middle
    for axis in range(3):
        u[axis] = s.best[axis]
    return moved


@njit(**INNER)
def _squared(a: FloatArray, b: FloatArray) -> float:
    return float((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2)


@njit(**INNER)
def _propose(
    m: FilterModel, x: RowState, sun: SunAngle, desired: FloatArray, u: FloatArray, s: Workspace
) -> tuple[int, bool]:  # fmt: skip
    """Look for a verified control; return the bits of what refuses the desired one and whether u is verified.

    The desired one, clipped, is written into `s.desired`, and the thrust of the plan after a verified u into `s.w`.
    """
    for axis in range(3):
        s.desired[axis] = min(max(desired[axis], -m.u_max), m.u_max)
    refused, done = 0, False
    for side in range(2):
        bits, done = _cut(m, x, sun, s.desired, side == 1, u, s)
        if side == 0:
            refused = bits
        if done or not bits & NEAR_BITS:
            break
    return refused, done


@njit(**INNER)
def _first_plan(m: FilterModel, x: RowState, sun: SunAngle, s: Workspace) -> bool:
    """Look for a plan from a state and write its thrust into `s.backup`.

    What was taken with the whole margins is still safe with half of them, whatever the rounding since.
    """
    for half in range(2):
        margins = scaled(MARGINS, 1.0 - 0.5 * half)
        if find_plan(m, x, sun, margins, NO_HOLD, as_int(NO_PLAN), as_int(PLANS), s.backup, s) != NO_PLAN:
            return True
    return False


@njit(error_model="numpy")
def filter_rows(
    m: FilterModel, position: FloatArray, velocity: FloatArray, sun_angle: FloatArray, desired: FloatArray,
    gain: FloatArray, memory: FloatArray, control: FloatArray, refused: IntArray, stage: IntArray,
) -> None:  # fmt: skip
    """Write each row's control, the bits of the constraints that refused the desired one, and where it comes from.

    Where `memory` has rows, it holds the plan of each and is written; the plan is tracked with that gain. Without rows
    plans are found anew.
    """
    s, tracks = workspace(MAX_HALF_SPACES), memory.shape[0] > 0
    for i in range(position.shape[0]):
        x = (
            position[i, 0], position[i, 1], position[i, 2], velocity[i, 0], velocity[i, 1], velocity[i, 2]
        )  # fmt: skip
        sun = (math.cos(sun_angle[i]), math.sin(sun_angle[i]))
        refused[i], done = _propose(m, x, sun, desired[i], control[i], s)
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
        moved = _between(m, x, sun, s.desired, control[i], s)
        if tracks:
            if moved:
                plan_after(m, x, control[i], s.plan, memory[i])
            else:
                follow_plan(m, memory[i], s.trial, s.w)


@njit(error_model="numpy")
def admissible_rows(
    m: FilterModel, position: FloatArray, velocity: FloatArray, sun_angle: FloatArray,
    control: FloatArray, out: BoolArray,
) -> None:  # fmt: skip
    """Write whether each row's control is within the thrusters, safe over the hold, and leaves a backup plan."""
    s = workspace(1)
    for i in range(position.shape[0]):
        x = (
            position[i, 0], position[i, 1], position[i, 2], velocity[i, 0], velocity[i, 1], velocity[i, 2]
        )  # fmt: skip
        u = control[i]
        if max(abs(u[0]), max(abs(u[1]), abs(u[2]))) <= m.u_max:
            sun = (math.cos(sun_angle[i]), math.sin(sun_angle[i]))
            out[i] = _verified(m, x, sun, u, as_int(NO_PLAN), as_int(PLANS), s)[1] != NO_PLAN
        else:
            out[i] = False


@njit(error_model="numpy")
def recoverable_rows(
    m: FilterModel, position: FloatArray, velocity: FloatArray, sun_angle: FloatArray, share: float,
    out: BoolArray, control: FloatArray,
) -> None:  # fmt: skip
    """Write whether each row has a backup plan with a share of the margins, and its thrust (zero without one).

    The plan that stays on a closed motion is tried first.
    """
    s = workspace(1)
    for i in range(position.shape[0]):
        x = (
            position[i, 0], position[i, 1], position[i, 2], velocity[i, 0], velocity[i, 1], velocity[i, 2]
        )  # fmt: skip
        sun = (math.cos(sun_angle[i]), math.sin(sun_angle[i]))
        plan = find_plan(m, x, sun, scaled(MARGINS, share), NO_HOLD, as_int(STAY), as_int(PLANS), control[i], s)
        out[i] = plan != NO_PLAN
        if not out[i]:
            for axis in range(3):
                control[i, axis] = 0.0
