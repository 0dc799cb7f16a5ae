"""Compiled rows of the backup filter; see `BackupFilter` for the method."""

from __future__ import annotations

import math

from safe_inspect.compiling import BORROWING, njit
from safe_inspect.dynamics.cwh import RowState
from safe_inspect.rta.constraints.rows import SunAngle, scaled
from safe_inspect.rta.filters.backup.model import PLANS, FilterModel
from safe_inspect.rta.filters.backup.plans import NO_HOLD, NO_PLAN, STAY, find_plan
from safe_inspect.rta.filters.backup.returning import return_control
from safe_inspect.rta.filters.backup.search import MARGINS, ROUNDS, propose, search, verified
from safe_inspect.rta.filters.backup.workspace import MAX_HALF_SPACES, Workspace, as_int, workspace
from safe_inspect.rta.filters.tube.rows import begin_plan, follow_plan, plan_after, remembers, tracking
from safe_inspect.types import BoolArray, FloatArray, IntArray

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
        if find_plan(m, x, sun, margins, NO_HOLD, first, as_int(PLANS), s.backup, s) != NO_PLAN:
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
        x = (
            position[i, 0], position[i, 1], position[i, 2], velocity[i, 0], velocity[i, 1], velocity[i, 2]
        )  # fmt: skip
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
            for axis in range(3):
                control[i, axis] = s.backup[axis]
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
    """Write whether each row's control is within the limits, safe over the hold, and leaves a backup plan."""
    s = workspace(as_int(1))
    for i in range(position.shape[0]):
        x = (
            position[i, 0], position[i, 1], position[i, 2], velocity[i, 0], velocity[i, 1], velocity[i, 2]
        )  # fmt: skip
        u = control[i]
        if max(abs(u[0]), max(abs(u[1]), abs(u[2]))) <= m.u_max:
            sun = (math.cos(sun_angle[i]), math.sin(sun_angle[i]))
            out[i] = verified(m, x, sun, u, as_int(NO_PLAN), as_int(PLANS), s)[1] != NO_PLAN
        else:
            out[i] = False


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
        x = (
            position[i, 0], position[i, 1], position[i, 2], velocity[i, 0], velocity[i, 1], velocity[i, 2]
        )  # fmt: skip
        sun = (math.cos(sun_angle[i]), math.sin(sun_angle[i]))
        plan = find_plan(m, x, sun, scaled(MARGINS, share), NO_HOLD, as_int(STAY), as_int(PLANS), control[i], s)
        out[i] = plan != NO_PLAN
        if not out[i]:
            for axis in range(3):
                control[i, axis] = 0.0
