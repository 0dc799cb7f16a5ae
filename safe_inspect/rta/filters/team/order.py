"""Sorting of an environment's deputies into the order of the team's filter, compiled."""

from __future__ import annotations

from safe_inspect.compiling import BORROWING, njit
from safe_inspect.rta.filters.backup.model import PLANS, FilterModel
from safe_inspect.rta.filters.backup.plans import NO_PLAN, plan_thrust
from safe_inspect.rta.filters.team.tracking import state_of
from safe_inspect.rta.filters.team.workspace import TeamWorkspace
from safe_inspect.rta.filters.tube.rows import remembers
from safe_inspect.types import BoolArray, FloatArray, IntArray


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
            for k in range(6):
                t.x[place, k] = tracks[i, k]
            for axis in range(3):
                t.u[axis] = tracks[i, 6 + axis]
        elif fixed[i] and t.hint[place] != NO_PLAN:
            plan_thrust(m, state_of(t.x, place), t.hint[place], t.u)
        for axis in range(3):
            t.desired[3 * place + axis] = min(max(t.u[axis], -m.u_max), m.u_max)
