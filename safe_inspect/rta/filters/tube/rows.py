"""The rows of the filter that tracks its plans, compiled; `TubeFilter` documents the method."""

from __future__ import annotations

import math

from safe_inspect.compiling import njit
from safe_inspect.dynamics.cwh_row import RowState
from safe_inspect.rta.constraints.rows import INNER, SunAngle, scaled
from safe_inspect.rta.filters.backup.arcs import held
from safe_inspect.rta.filters.backup.model import HOLD_PIECES, FilterModel
from safe_inspect.rta.filters.backup.plans import NO_HOLD, NO_PLAN, PLANS, find_plan
from safe_inspect.rta.filters.backup.returning import return_control
from safe_inspect.rta.filters.backup.rows import BACKUP, DESIRED, MARGINS, NEAREST, RETURN, between, propose
from safe_inspect.rta.filters.backup.workspace import MAX_HALF_SPACES, Workspace, as_int, workspace
from safe_inspect.types import FloatArray, IntArray

#: Columns of a memory: the plan's state, its thrust, and 1 where there is a plan.
COLUMNS = 10
_KNOWN = 9


@njit(**INNER)
def _remember(m: FilterModel, z: RowState, u: FloatArray, v: FloatArray, memory: FloatArray) -> None:
    """Write the plan's state after the thrust u from z, and its next thrust v."""
    after = held(m, z, u, HOLD_PIECES)
    for k in range(6):
        memory[k] = after[k]
    memory[6], memory[7], memory[8], memory[_KNOWN] = v[0], v[1], v[2], 1.0


@njit(**INNER)
def _tracking(m: FilterModel, gain: FloatArray, x: RowState, memory: FloatArray, u: FloatArray) -> None:
    """Write the thrust that tracks the remembered plan."""
    for axis in range(3):
        total = memory[6 + axis]
        for k in range(6):
            total += gain[axis, k] * (x[k] - memory[k])
        u[axis] = min(max(total, -m.u_max), m.u_max)


@njit(**INNER)
def _follow(m: FilterModel, memory: FloatArray, s: Workspace) -> None:
    """Advance the remembered plan by a hold; after its thrust it coasts."""
    z = (memory[0], memory[1], memory[2], memory[3], memory[4], memory[5])
    for axis in range(3):
        s.trial[axis], s.w[axis] = memory[6 + axis], 0.0
    _remember(m, z, s.trial, s.w, memory)


@njit(**INNER)
def _first_plan(m: FilterModel, x: RowState, sun: SunAngle, s: Workspace) -> bool:
    """Look for a plan from a state into `s.backup`, with the margins and, as what was found may be, with half of them."""
    for half in range(2):
        margins = scaled(MARGINS, 1.0 - 0.5 * half)
        if find_plan(m, x, sun, margins, NO_HOLD, as_int(NO_PLAN), as_int(PLANS), s.backup, s) != NO_PLAN:
            return True
    return False


@njit(error_model="numpy")
def tube_rows(
    m: FilterModel, gain: FloatArray, position: FloatArray, velocity: FloatArray, sun_angle: FloatArray,
    desired: FloatArray, memory: FloatArray, control: FloatArray, refused: IntArray, stage: IntArray,
) -> None:  # fmt: skip
    """Write what `filter_rows` writes for estimated states, and what is remembered after the step into `memory`."""
    s = workspace(MAX_HALF_SPACES)
    for i in range(position.shape[0]):
        x = (
            position[i, 0], position[i, 1], position[i, 2], velocity[i, 0], velocity[i, 1], velocity[i, 2]
        )  # fmt: skip
        sun = (math.cos(sun_angle[i]), math.sin(sun_angle[i]))
        refused[i], done = propose(m, x, sun, desired[i], control[i], s)
        if done:
            stage[i] = NEAREST if refused[i] else DESIRED
            _remember(m, x, control[i], s.w, memory[i])
            continue
        known = memory[i, _KNOWN] > 0.0
        if not known and not _first_plan(m, x, sun, s):
            stage[i] = RETURN
            refused[i] = return_control(m, x, sun, control[i], s)
            continue
        stage[i] = BACKUP
        if not known:  # the plan begins here
            for k in range(6):
                memory[i, k] = x[k]
            for axis in range(3):
                memory[i, 6 + axis] = s.backup[axis]
            memory[i, _KNOWN] = 1.0
        _tracking(m, gain, x, memory[i], s.backup)
        if between(m, x, sun, s.desired, control[i], s):
            _remember(m, x, control[i], s.plan, memory[i])
        else:
            _follow(m, memory[i], s)
