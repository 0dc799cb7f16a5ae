"""Joint plans that are stored and tracked, and the tubes about them, compiled."""

from __future__ import annotations

import math

from safe_inspect.compiling import BORROWING, njit
from safe_inspect.dynamics.cwh import RowState
from safe_inspect.rta.constraints.rows import Margins
from safe_inspect.rta.filters.backup.arcs import held
from safe_inspect.rta.filters.backup.model import CLOSED, FIRST_PLAN, HOLD, HOLD_PIECES, PLAN, FilterModel
from safe_inspect.rta.filters.backup.plans import plan_thrust
from safe_inspect.rta.filters.backup.workspace import Workspace, as_int
from safe_inspect.rta.filters.team.workspace import TeamModel, TeamWorkspace
from safe_inspect.rta.filters.tube.margins import widened
from safe_inspect.rta.filters.tube.rows import begin_plan, follow_plan, forget, plan_after, remembers, tracking
from safe_inspect.types import FloatArray


@njit(**BORROWING)
def state_of(x: FloatArray, i: int) -> RowState:
    """Return a row of states as the tuple that the tests use."""
    return x[i, 0], x[i, 1], x[i, 2], x[i, 3], x[i, 4], x[i, 5]


@njit(**BORROWING)
def beside(
    g: TeamModel, margins: Margins, part: int, i: int, thrust: float, t: TeamWorkspace
) -> Margins:  # fmt: skip
    """Widen the margins of a pair by the tube of one of its deputies, in a part of its motion, numbered from `HOLD`.

    A deputy that is fixed is within the tube of the closed motion that it tracks.
    """
    if t.fixed[i]:
        most = math.sqrt(3.0) * g.one.u_max
        return widened(g.pair, margins, as_int(CLOSED), most, most)
    if t.effort[i] < 0.0 and part != HOLD:
        part += FIRST_PLAN - PLAN
    return widened(g.pair, margins, part, t.effort[i], thrust)


@njit(**BORROWING)
def tracked_backup(g: TeamModel, gain: FloatArray, tracks: FloatArray, t: TeamWorkspace) -> bool:
    """Write the thrusts that track the stored joint plan to `t.backup`; return whether there is one."""
    for place in range(t.x.shape[0]):
        plan = tracks[t.order[place]]
        if t.fixed[place]:  # Its state is that of its plan, which has that thrust.
            for axis in range(3):
                t.u[axis] = t.desired[3 * place + axis]
        elif remembers(plan):
            tracking(g.one, gain, state_of(t.x, place), plan, t.u)
        else:
            return False
        for axis in range(3):
            t.backup[3 * place + axis] = t.u[axis]
    return True


@njit(**BORROWING)
def begin_plans(tracks: FloatArray, t: TeamWorkspace) -> None:
    """Store the joint plan of the present states."""
    for place in range(t.x.shape[0]):
        if not t.fixed[place]:
            begin_plan(state_of(t.x, place), t.backup[3 * place : 3 * place + 3], tracks[t.order[place]])


@njit(**BORROWING)
def remember_plans(m: FilterModel, tracks: FloatArray, moved: bool, lost: bool, t: TeamWorkspace, s: Workspace) -> None:
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
