"""Stored plan of a deputy that tracks it, and the margins of the tube about it, compiled; see `BackupFilter`."""

from __future__ import annotations

from safe_inspect.compiling import BORROWING, njit
from safe_inspect.dynamics.cwh import RowState
from safe_inspect.rta.backup.holds import held
from safe_inspect.rta.backup.model import HOLD_PIECES, FilterModel
from safe_inspect.rta.constraints.rows import INLINED, Margins
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


_LENGTH, _SPEED, _COASTING, _THRUST = range(4)


@njit(**INLINED)
def _width(m: FilterModel, part: int, which: int, effort: float, thrust: float) -> float:
    return float(m.tube[part, which, 0] + max(effort, 0.0) * m.tube[part, which, 1] + thrust * m.tube[part, which, 2])


@njit(**INLINED)
def widened(m: FilterModel, margins: Margins, part: int, effort: float, thrust: float) -> Margins:
    """Return the margins for the motion of the model that leave `margins` for the real motion.

    Args:
        m: The task.
        margins: Margins of the constraints.
        part: The part of the motion, such as `HOLD`.
        effort: Size of the thrust that is held before the plan, or now [N]; negative if there is none.
        thrust: Size of the thrust of the plan [N].
    """
    return Margins(
        margins.length + _width(m, part, _LENGTH, effort, thrust),
        margins.speed + _width(m, part, _SPEED, effort, thrust),
        margins.coasting + _width(m, part, _COASTING, effort, thrust),
    )


@njit(**INLINED)
def tracking_thrust(m: FilterModel, part: int, effort: float) -> float:
    """Return the largest component by which tracking a plan changes its thrust [N]."""
    return _width(m, part, _THRUST, effort, 0.0)
