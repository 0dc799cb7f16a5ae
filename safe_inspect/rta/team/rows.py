"""Compiled rows of the team's filter; see `TeamFilter` for the method."""

from __future__ import annotations

import math

import numpy as np

from safe_inspect.compiling import BORROWING, njit
from safe_inspect.dynamics.cwh import row_state
from safe_inspect.rta.active_set import nearest_joint
from safe_inspect.rta.backup.holds import held
from safe_inspect.rta.backup.model import HOLD_PIECES, PLANS, FilterModel
from safe_inspect.rta.backup.plans import NO_PLAN, QUICK, STAY, plan_thrust
from safe_inspect.rta.backup.rows import BACKUP, DESIRED, NEAREST, RETURN, return_control
from safe_inspect.rta.backup.search import EXTRA, MARGINS, POLISH, STILL, squared
from safe_inspect.rta.backup.tracking import begin_plan, follow_plan, forget, plan_after, remembers, tracking
from safe_inspect.rta.backup.workspace import MAX_HALF_SPACES, Workspace, as_bool, as_int, copy, workspace
from safe_inspect.rta.constraints.rows import SunAngle, scaled
from safe_inspect.rta.constraints.sets import COLLISION, PSM
from safe_inspect.rta.team.cuts import cut_holds, cut_plans
from safe_inspect.rta.team.motions import enter, state_of
from safe_inspect.rta.team.plans import FOUND, PASSED, UNSAFE_HOLD, farthest_plans, joint_plan, tested
from safe_inspect.rta.team.workspace import TeamModel, TeamWorkspace, team_workspace
from safe_inspect.types import BoolArray, FloatArray, IntArray

#: Positions (N, D, 3), velocities (N, D, 3) and sun angles (N,).
TeamArrays = tuple[FloatArray, FloatArray, FloatArray]
#: Bits of the constraints on the distance from the chief.
_NEAR_BITS = 1 << COLLISION | 1 << PSM
_ROUNDS = 6
#: Largest number of rounds that end in states without a joint plan.
_RECOVERIES = 2
_HALVINGS = 5
#: Number of plans that the search between the backup and the last proposal tries, in addition to the last safe one.
_FEW = 6
#: Distance of a control from the best one at which that search ends [N].
_FINE = 2e-3


@njit(**BORROWING)
def _cut(g: TeamModel, sun: SunAngle, own_side: bool, t: TeamWorkspace, s: Workspace) -> bool:
    """Search for a joint control by cutting planes; return whether `t.control` is one, with its plan in `t.plan`.

    Each round adds half-spaces for everything that the last proposal violates, and proposes the solution of the
    programme.
    """
    margins = scaled(MARGINS, EXTRA)
    count, unrecovered = as_int(0), 0
    copy(t.desired, t.control)
    for attempt in range(_ROUNDS):
        most = as_int(PLANS) if attempt == 0 else as_int(QUICK)
        verdict, stuck, alone = tested(g, sun, t.control, MARGINS, most, True, t, s)
        if verdict == PASSED:
            return True
        first = attempt == 0 and not own_side
        if verdict == UNSAFE_HOLD:
            count = cut_holds(g, sun, own_side, margins, as_bool(False), first, count, t, s)
        else:
            unrecovered += 1
            if unrecovered > _RECOVERIES:
                return False
            count = cut_plans(g, sun, stuck, alone, MARGINS, first, count, t, s)
        for _ in range(POLISH):
            if not nearest_joint(t.rows, t.bounds, count, g.one.u_max, t.desired, t.trial, t.qp):
                return False
            moved = math.sqrt(squared(t.trial, t.control))
            copy(t.trial, t.control)
            if moved < STILL:
                break
            before = count
            count = cut_holds(g, sun, own_side, scaled(margins, 0.75), as_bool(True), as_bool(False), count, t, s)
            if count == before:
                break
    return False


@njit(**BORROWING)
def _better(g: TeamModel, sun: SunAngle, t: TeamWorkspace, s: Workspace) -> bool:
    """Make `t.trial` the best control if it is nearer to the desired one and passes the test; return whether it is."""
    if not squared(t.trial, t.desired) < squared(t.best, t.desired):
        return False
    if tested(g, sun, t.trial, MARGINS, as_int(_FEW), False, t, s)[0] != PASSED:
        return False
    copy(t.trial, t.best)
    copy(t.plan, t.kept)
    copy(t.plan, t.hint)
    return True


@njit(**BORROWING)
def _between(g: TeamModel, sun: SunAngle, t: TeamWorkspace, s: Workspace) -> bool:
    """Search between the backup and the last proposal for the safe control nearest to the desired one; fill `t.best`.

    First, a bisection moves all deputies together from the backup towards the proposal. Then each deputy in turn moves
    alone from the result towards the proposal. Each accepted control has passed the exact test, see `_better`.

    Returns:
        Whether the control differs from the backup.
    """
    deputies, better = t.x.shape[0], False
    copy(t.backup, t.best)
    for i in range(deputies):
        t.hint[i] = NO_PLAN if t.fixed[i] else STAY
        t.kept[i] = t.hint[i]
    size = math.sqrt(squared(t.control, t.backup))
    low, high = 0.0, 1.0
    for _ in range(_HALVINGS):
        if size * (high - low) < _FINE:
            break
        middle = 0.5 * (low + high)
        for k in range(3 * deputies):
            t.trial[k] = t.backup[k] + middle * (t.control[k] - t.backup[k])
        if _better(g, sun, t, s):
            low, better = middle, True
        else:
            high = middle
    for i in range(deputies):
        if t.fixed[i] or deputies == 1:
            continue
        for share in (1.0, 0.5):
            copy(t.best, t.trial)
            for k in range(3 * i, 3 * i + 3):
                t.trial[k] = t.best[k] + share * (t.control[k] - t.best[k])
            if _better(g, sun, t, s):
                better = True
                break
    return better


@njit(**BORROWING)
def _backup(g: TeamModel, sun: SunAngle, t: TeamWorkspace, s: Workspace) -> bool:
    """Write the thrust of a joint plan from the current states to `t.backup`; return whether there is one.

    The stored plan is tried before others, with the full margins and then with half of them. It was accepted with the
    full margins, and rounding errors since then are smaller than half of them, so it always passes.
    """
    for half in range(2):
        margins = scaled(MARGINS, 1.0 - 0.5 * half)
        stuck, _ = joint_plan(g, t.x, sun, margins, as_int(PLANS), True, t, s)
        if stuck == FOUND:
            for i in range(t.x.shape[0]):
                copy(t.thrust[i, t.plan[i]], t.backup[3 * i : 3 * i + 3])
            return True
    return False


@njit(**BORROWING)
def _tracked_backup(g: TeamModel, gain: FloatArray, tracks: FloatArray, t: TeamWorkspace) -> bool:
    """Write the thrusts that track the stored joint plan to `t.backup`; return whether there is one."""
    for place in range(t.x.shape[0]):
        plan = tracks[t.order[place]]
        if t.fixed[place]:  # Its state is that of its plan, which has that thrust.
            copy(t.desired[3 * place : 3 * place + 3], t.u)
        elif remembers(plan):
            tracking(g.one, gain, state_of(t.x, place), plan, t.u)
        else:
            return False
        copy(t.u, t.backup[3 * place : 3 * place + 3])
    return True


@njit(**BORROWING)
def _begin_plans(tracks: FloatArray, t: TeamWorkspace) -> None:
    """Store the joint plan of the present states."""
    for place in range(t.x.shape[0]):
        if not t.fixed[place]:
            begin_plan(state_of(t.x, place), t.backup[3 * place : 3 * place + 3], tracks[t.order[place]])


@njit(**BORROWING)
def _remember_plans(
    m: FilterModel, tracks: FloatArray, moved: bool, lost: bool, t: TeamWorkspace, s: Workspace
) -> None:
    """Store the joint plan after the step: that of `t.best` if `moved`, otherwise the previous one continues."""
    for place in range(t.x.shape[0]):
        plan = tracks[t.order[place]]
        if lost and not t.fixed[place]:
            forget(plan)
        elif moved and not t.fixed[place]:
            u = t.best[3 * place : 3 * place + 3]
            plan_thrust(m, held(m, state_of(t.x, place), u, HOLD_PIECES), t.kept[place], t.u)
            plan_after(m, state_of(t.x, place), u, t.u, plan)
        elif remembers(plan):
            follow_plan(m, plan, s.trial, s.w)


@njit(**BORROWING)
def _return(g: TeamModel, sun: SunAngle, t: TeamWorkspace, s: Workspace) -> None:
    """Write return controls to `t.best`: plans that are safe alone and far apart, or those of the single filter."""
    farthest_plans(g, t.x, sun, scaled(MARGINS, 0.5), as_int(PLANS), t, s)
    for i in range(t.x.shape[0]):
        if t.plan[i] != NO_PLAN:
            copy(t.thrust[i, t.plan[i]], t.best[3 * i : 3 * i + 3])
        else:
            t.bits[i] |= return_control(g.one, state_of(t.x, i), sun, t.u, s)
            copy(t.u, t.best[3 * i : 3 * i + 3])
        t.kept[i] = NO_PLAN


@njit(error_model="numpy")
def filter_team_rows(
    g: TeamModel, states: TeamArrays, desired: FloatArray, fixed: BoolArray, memory: IntArray,
    gain: FloatArray, tracks: FloatArray, control: FloatArray, refused: IntArray, stage: IntArray,
) -> None:  # fmt: skip
    """Write each environment's controls (N, D, 3), bits of what rejected the desired ones (N, D), and stage (N,).

    `memory` (N, D) contains the plan of each deputy, counted from 1, or 0; it is replaced by that of the next state. If
    `tracks` has rows (N, D, 10), it contains the plans themselves and is updated; they are tracked with the given gain.
    """
    position, velocity, sun_angle = states
    s, t, tracks_plans = workspace(as_int(MAX_HALF_SPACES)), team_workspace(position.shape[1]), tracks.shape[0] > 0
    plans = np.zeros((position.shape[1], 10))
    for row in range(position.shape[0]):
        if tracks_plans:
            plans = tracks[row]
        enter(g.one, position[row], velocity[row], desired[row], fixed[row], memory[row], plans, t)
        sun = (math.cos(sun_angle[row]), math.sin(sun_angle[row]))
        done, near, any_bits, moved = False, True, 0, True
        for side in range(2):
            done = _cut(g, sun, side == 1, t, s)
            any_bits = 0
            for i in range(t.x.shape[0]):
                any_bits |= t.bits[i]
            near = any_bits & _NEAR_BITS != 0
            if done or not near:
                break
        if done:
            stage[row] = NEAREST if any_bits else DESIRED
            copy(t.control, t.best)
            copy(t.plan, t.kept)
        elif tracks_plans and _tracked_backup(g, gain, plans, t):
            stage[row] = BACKUP
            moved = _between(g, sun, t, s)
        elif _backup(g, sun, t, s):
            stage[row] = BACKUP
            if tracks_plans:
                _begin_plans(plans, t)
            moved = _between(g, sun, t, s)
        else:
            stage[row] = RETURN
            _return(g, sun, t, s)
        for place in range(t.x.shape[0]):
            i = t.order[place]
            refused[row, i] = t.bits[place]
            memory[row, i] = 0 if t.fixed[place] else t.kept[place] + 1
            copy(t.best[3 * place : 3 * place + 3], control[row, i])
            if t.fixed[place] and remembers(plans[i]):  # The thrust of its plan is applied with tracking.
                x = row_state(position[row, i], velocity[row, i])
                tracking(g.one, gain, x, plans[i], control[row, i])
        if tracks_plans:
            _remember_plans(g.one, plans, moved, stage[row] == RETURN, t, s)


@njit(error_model="numpy")
def plan_team_rows(
    g: TeamModel, states: TeamArrays, fixed: BoolArray, control: FloatArray, memory: IntArray, out: BoolArray
) -> None:
    """Write whether each environment has a joint plan, and its thrusts (N, D, 3) and numbers (N, D), else zeros."""
    position, velocity, sun_angle = states
    s, t = workspace(as_int(MAX_HALF_SPACES)), team_workspace(position.shape[1])
    plans = np.zeros((position.shape[1], 10))
    for row in range(position.shape[0]):
        enter(g.one, position[row], velocity[row], control[row], fixed[row], memory[row], plans, t)
        sun = (math.cos(sun_angle[row]), math.sin(sun_angle[row]))
        stuck, _ = joint_plan(g, t.x, sun, MARGINS, as_int(PLANS), True, t, s)
        out[row] = stuck == FOUND
        for place in range(t.x.shape[0]):
            i = t.order[place]
            for axis in range(3):
                control[row, i, axis] = t.thrust[place, t.plan[place], axis] if out[row] else 0.0
            memory[row, i] = t.plan[place] + 1 if out[row] and not t.fixed[place] else 0
