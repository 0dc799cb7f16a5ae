"""Order of the deputies in the team's filter, their relative motions, and the tubes about these; compiled."""

from __future__ import annotations

import math

from safe_inspect.compiling import BORROWING, njit
from safe_inspect.dynamics.cwh import RowState
from safe_inspect.rta.backup.model import CLOSED, FIRST_PLAN, HOLD, PLAN, PLANS, FilterModel
from safe_inspect.rta.backup.plans import NO_PLAN, plan_thrust
from safe_inspect.rta.backup.tracking import remembers, widened
from safe_inspect.rta.backup.workspace import as_int, copy
from safe_inspect.rta.constraints.rows import Margins
from safe_inspect.rta.team.workspace import TeamModel, TeamWorkspace
from safe_inspect.types import BoolArray, FloatArray, IntArray


@njit(**BORROWING)
def state_of(x: FloatArray, i: int) -> RowState:
    """Return a row of states as the tuple that the tests use."""
    return x[i, 0], x[i, 1], x[i, 2], x[i, 3], x[i, 4], x[i, 5]


@njit(**BORROWING)
def minus(a: RowState, b: RowState) -> RowState:
    """Return the difference of two states."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2], a[3] - b[3], a[4] - b[4], a[5] - b[5]


@njit(**BORROWING)
def motion_about(x: FloatArray, i: int, j: int) -> RowState:
    """Return the state of a deputy relative to the chief or, if j >= 0, to another deputy."""
    return state_of(x, i) if j < 0 else minus(state_of(x, i), state_of(x, j))


@njit(**BORROWING)
def model_about(g: TeamModel, j: int) -> FilterModel:
    """Return the task of a deputy relative to the chief or, if j >= 0, to another deputy."""
    return g.one if j < 0 else g.pair


@njit(**BORROWING)
def write_thrust(control: FloatArray, i: int, j: int, t: TeamWorkspace) -> None:
    """Write the thrust of a deputy, minus that of another if j >= 0, to `t.u`."""
    for axis in range(3):
        t.u[axis] = control[3 * i + axis] - (control[3 * j + axis] if j >= 0 else 0.0)


@njit(**BORROWING)
def coasts(i: int, j: int, t: TeamWorkspace) -> bool:
    """Return whether a deputy coasts unconditionally, and the other one of the pair too, if j >= 0."""
    return bool(t.fixed[i] and (j < 0 or t.fixed[j]))


@njit(**BORROWING)
def _widened_for(m: FilterModel, margins: Margins, part: int, i: int, thrust: float, t: TeamWorkspace) -> Margins:
    """Widen margins by the tube of one deputy. One that is fixed is in the tube of the closed motion that it tracks."""
    if t.fixed[i]:
        most = math.sqrt(3.0) * m.u_max
        return widened(m, margins, as_int(CLOSED), most, most)
    if t.effort[i] < 0.0 and part != HOLD:
        part += FIRST_PLAN - PLAN
    return widened(m, margins, part, t.effort[i], thrust)


@njit(**BORROWING)
def tube_about(
    g: TeamModel, margins: Margins, part: int, i: int, j: int, one: float, two: float, t: TeamWorkspace
) -> Margins:  # fmt: skip
    """Widen margins by the tubes of a deputy and, if j >= 0, of another one.

    Args:
        g: The task.
        margins: Margins of the constraints.
        part: The part of their motion, numbered from `HOLD`.
        i: The deputy.
        j: The other one, or -1.
        one: Size of the thrust of the deputy's plan [N].
        two: The same of the other one.
        t: Workspace.
    """
    wide = _widened_for(model_about(g, j), margins, part, i, one, t)
    return wide if j < 0 else _widened_for(g.pair, wide, part, j, two, t)


@njit(**BORROWING)
def _before(position: FloatArray, fixed: BoolArray, i: int, j: int) -> bool:
    if fixed[i] != fixed[j]:
        return bool(fixed[i])
    a, b = 0.0, 0.0
    for axis in range(3):
        a += position[i, axis] ** 2
        b += position[j, axis] ** 2
    return a < b


@njit(**BORROWING)
def enter(
    m: FilterModel, position: FloatArray, velocity: FloatArray, desired: FloatArray, fixed: BoolArray, memory: IntArray,
    tracks: FloatArray, t: TeamWorkspace,
) -> None:  # fmt: skip
    """Sort an environment's deputies into the order of the filter: those that coast first, then by range.

    The result therefore does not depend on the order of the deputies, unless two have exactly the same range. A deputy
    that coasts, but for which a plan is stored, applies the hold of that plan first, because the others assume it. For
    a deputy that tracks its plan, `tracks` of shape (D, 10), the state is that of the plan.
    """
    for place in range(position.shape[0]):
        t.order[place] = place
    for place in range(1, position.shape[0]):
        i, k = t.order[place], place
        while k > 0 and _before(position, fixed, i, t.order[k - 1]):
            t.order[k] = t.order[k - 1]
            k -= 1
        t.order[k] = i
    for place in range(position.shape[0]):
        i = t.order[place]
        t.fixed[place], t.bits[place] = fixed[i], 0
        t.hint[place] = memory[i] - 1
        if t.hint[place] < 0 or t.hint[place] >= PLANS:
            t.hint[place] = NO_PLAN
        for axis in range(3):
            t.x[place, axis], t.x[place, 3 + axis] = position[i, axis], velocity[i, axis]
            t.u[axis] = 0.0 if fixed[i] else desired[i, axis]
        if fixed[i] and remembers(tracks[i]):
            copy(tracks[i, :6], t.x[place])
            copy(tracks[i, 6:9], t.u)
        elif fixed[i] and t.hint[place] != NO_PLAN:
            plan_thrust(m, state_of(t.x, place), t.hint[place], t.u)
        for axis in range(3):
            t.desired[3 * place + axis] = min(max(t.u[axis], -m.u_max), m.u_max)
