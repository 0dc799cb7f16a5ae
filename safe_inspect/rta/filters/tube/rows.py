"""Stored plan of a deputy that tracks it, compiled; see `TubeFilter` for the method."""

from __future__ import annotations

from safe_inspect.compiling import BORROWING, njit
from safe_inspect.dynamics.cwh import RowState
from safe_inspect.rta.filters.backup.arcs import held
from safe_inspect.rta.filters.backup.model import HOLD_PIECES, FilterModel
from safe_inspect.types import FloatArray

#: Column of a memory that is 1 if there is a plan; the columns before it are the plan's state and its thrust.
_KNOWN = 9


@njit(**BORROWING)
def remembers(memory: FloatArray) -> bool:
    """Return whether there is a plan."""
    return bool(memory[_KNOWN] > 0.0)


@njit(**BORROWING)
def forget(memory: FloatArray) -> None:
    """Remove the stored plan."""
    memory[_KNOWN] = 0.0


@njit(**BORROWING)
def begin_plan(x: RowState, v: FloatArray, memory: FloatArray) -> None:
    """Store the plan from a state whose next thrust is v."""
    for k in range(6):
        memory[k] = x[k]
    memory[6], memory[7], memory[8], memory[_KNOWN] = v[0], v[1], v[2], 1.0


@njit(**BORROWING)
def plan_after(m: FilterModel, x: RowState, u: FloatArray, v: FloatArray, memory: FloatArray) -> None:
    """Store the plan from the state after the thrust u, whose next thrust is v."""
    begin_plan(held(m, x, u, HOLD_PIECES), v, memory)


@njit(**BORROWING)
def tracking(m: FilterModel, gain: FloatArray, x: RowState, memory: FloatArray, u: FloatArray) -> None:
    """Write the thrust that tracks the stored plan."""
    for axis in range(3):
        total = memory[6 + axis]
        for k in range(6):
            total += gain[axis, k] * (x[k] - memory[k])
        u[axis] = min(max(total, -m.u_max), m.u_max)


@njit(**BORROWING)
def follow_plan(m: FilterModel, memory: FloatArray, thrust: FloatArray, none: FloatArray) -> None:
    """Advance the stored plan by a hold, after which it coasts; the last two arguments are overwritten, shape (3,)."""
    for axis in range(3):
        thrust[axis], none[axis] = memory[6 + axis], 0.0
    z = (memory[0], memory[1], memory[2], memory[3], memory[4], memory[5])
    plan_after(m, z, thrust, none, memory)
