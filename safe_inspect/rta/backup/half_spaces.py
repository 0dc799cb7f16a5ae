"""Compiled constraints that are given by a half-space at each state; see `Constraint.half_space`.

The filter certifies such a constraint over a cell of an arc by the half-space d.x >= need at the middle of the cell.
All states in that half-space are safe, and f = d.x along the motion is certified from its values at the ends of the
cell as in `constraints.rows`, with the same bounds on its second derivative. The constraint itself therefore needs no
bounds, and any number of constraints of any package run in the same machine code: kernels are called by address.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any

from numba import float64, int64

from safe_inspect.compiling import BORROWING, njit
from safe_inspect.compiling.addresses import call_at, compiled_at, on_stack, pointer, read_number
from safe_inspect.dynamics.coasting import closed_motion_state
from safe_inspect.dynamics.cwh import RowState
from safe_inspect.errors import PluginValueError
from safe_inspect.rta.backup.model import FINEST, FURTHER, ORBIT_CELLS, FilterModel
from safe_inspect.rta.backup.sequences import SAFE
from safe_inspect.rta.constraints.base import HalfSpace
from safe_inspect.rta.constraints.rows import ArcCell, Margins, inner, lowest, size_of

_SIGNATURE = "float64(CPointer(float64), CPointer(float64), CPointer(float64))"
#: Direction d of states, and the need.
_Half = tuple[float, float, float, float, float, float, float]
_ZERO = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@cache
def kernel(function: HalfSpace) -> Any:
    """Return a compiled kernel, whose `address` is valid during the whole process.

    Raises:
        PluginValueError: It does not compile.
    """
    try:
        return compiled_at(njit(function), _SIGNATURE)
    except ValueError as error:
        code = function.__code__
        name = f"{function.__module__}.{function.__qualname__} ({code.co_filename}:{code.co_firstlineno})"
        raise PluginValueError(
            f"{name} does not compile as a row kernel; use numbers, `math` and the three arrays, element by element: "
            f"{error}"
        ) from None


@njit(**BORROWING)
def half_space(m: FilterModel, code: int, x: RowState) -> _Half:
    """Return the direction d and the need of a further constraint at a state; it is satisfied where d.x >= need.

    The position part of d has unit length; if there is no such part, the velocity part has.
    """
    entry = m.kernels + 16 * (code - FURTHER)
    parameters: Any = pointer(read_number(entry + 8, int64), float64)  # type: ignore[call-arg]
    d, state = on_stack(_ZERO), on_stack(x)  # type: ignore[call-arg]
    need = call_at(read_number(entry, int64), float64, (parameters, state, d))  # type: ignore[call-arg]
    h = (d[0], d[1], d[2], d[3], d[4], d[5], need)
    position, velocity = _sizes(h)
    size = velocity if position == 0.0 else position
    return h[0] / size, h[1] / size, h[2] / size, h[3] / size, h[4] / size, h[5] / size, h[6] / size


@njit(**BORROWING)
def along(h: Any, x: RowState) -> float:
    """Return d.x."""
    return float(h[0] * x[0] + h[1] * x[1] + h[2] * x[2] + h[3] * x[3] + h[4] * x[4] + h[5] * x[5])


@njit(**BORROWING)
def _sizes(h: _Half) -> tuple[float, float]:
    """Return the lengths of the position and velocity parts of d."""
    return size_of(h), size_of(h[3:])


@njit(**BORROWING)
def needed(h: _Half, margins: Margins) -> float:
    """Return the need with margins of positions [m] and velocities [m/s]."""
    position, velocity = _sizes(h)
    return h[6] + position * margins.length + velocity * margins.speed


@njit(**BORROWING)
def further_slack(m: FilterModel, code: int, x: RowState) -> float:
    """Return the distance of a further constraint from violation [m]; a speed counts as the range of such a motion."""
    h = half_space(m, code, x)
    position, velocity = _sizes(h)
    return (along(h, x) - h[6]) / (position + velocity / m.n)


@njit(**BORROWING)
def further_broken(m: FilterModel, x: RowState, margins: Margins) -> int:
    """Return the code of a further constraint that a state does not satisfy with those margins, or SAFE."""
    for code in range(FURTHER, FURTHER + m.further):
        h = half_space(m, code, x)
        if not along(h, x) >= needed(h, margins):
            return code
    return SAFE


@njit(**BORROWING)
def _between(a: RowState, b: RowState) -> RowState:
    """Return the state in the middle of two states."""
    return (
        0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1]), 0.5 * (a[2] + b[2]),
        0.5 * (a[3] + b[3]), 0.5 * (a[4] + b[4]), 0.5 * (a[5] + b[5]),
    )  # fmt: skip


@njit(**BORROWING)
def further_uncertain(m: FilterModel, cell: ArcCell, margins: Margins) -> int:
    """Return the code of a further constraint that the ends of a cell cannot certify, or SAFE."""
    a, b = cell.a.state, cell.b.state
    eighth, k, reach = cell.eighth, cell.k, cell.reach
    middle = _between(a, b)
    for code in range(FURTHER, FURTHER + m.further):
        h = half_space(m, code, middle)
        position, velocity = _sizes(h)
        curve = max(inner(h, cell.acceleration_a), inner(h, cell.acceleration_b))
        dip = max(0.0, eighth * curve + 6.0 * k * k * reach * position / m.n + 3.0 * k * reach * velocity)
        if not lowest(along(h, a), along(h, b), dip) >= needed(h, margins):
            return code
    return SAFE


@njit(**BORROWING)
def further_closed_motion(m: FilterModel, x: RowState, margins: Margins) -> int:
    """Return a further constraint that the drift-free motion from x violates within an orbit, or SAFE.

    The bounds are those of `closed_motion`: in the angle of the orbit, the second derivative of the position is
    (0, y_c, 0) - p, and every derivative of it is at most rho long.
    """
    u, w = x[3] / m.n, x[5] / m.n
    centre = x[1] - 2.0 * u
    rho = math.sqrt(4.0 * (x[0] * x[0] + u * u) + x[2] * x[2] + w * w)
    for code in range(FURTHER, FURTHER + m.further):
        a, place, span = closed_motion_state(m.n, x, 1.0, 0.0), 0, FINEST // ORBIT_CELLS
        while place < FINEST:
            end = min(place + span, FINEST)
            angle = end * (2.0 * math.pi / FINEST)
            b = closed_motion_state(m.n, x, math.cos(angle), math.sin(angle))
            h = half_space(m, code, b)
            if not along(h, b) >= needed(h, margins):
                return code
            h = half_space(m, code, _between(a, b))
            position, velocity = _sizes(h)
            k = 0.125 * ((end - place) * (2.0 * math.pi / FINEST)) ** 2
            lower = min(inner(h, a), inner(h, b))
            dip = max(0.0, k * (h[1] * centre - lower) + k * rho * (k * position + m.n * velocity))
            if lowest(along(h, a), along(h, b), dip) >= needed(h, margins):
                a, place, span = b, end, min(2 * span, FINEST // ORBIT_CELLS)
            elif span > 1:
                span //= 2
            else:
                return code
    return SAFE
