"""Constraints that are given by a half-space at each state, compiled; `Constraint.half_space` documents them.

The filter certifies such a constraint over a cell of an arc by the half-space d.x >= need at the cell's middle. All of
it is safe, and f = d.x along the motion is certified from its values at the cell's ends as in `constraints.rows`, with
the same bounds of its second derivative. So no bound of the constraint itself is asked for, and any number of them, of
any package, run in the machine code of this one: kernels are called by address.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numba
from llvmlite import ir
from numba.extending import intrinsic

from safe_inspect.compiling import BORROWING, njit
from safe_inspect.dynamics.coasting import closed_motion_state
from safe_inspect.dynamics.cwh_row import RowState
from safe_inspect.rta.constraints.base import HalfSpace
from safe_inspect.rta.constraints.rows import ArcCell, Margins, lowest
from safe_inspect.rta.filters.backup.model import FINEST, FURTHER, ORBIT_CELLS, FilterModel
from safe_inspect.rta.filters.backup.sequences import SAFE

#: Numba's helpers for machine code, which have no types.
cgutils: Any = numba.core.cgutils
types: Any = numba.core.types
_SIGNATURE = "float64(CPointer(float64), CPointer(float64), CPointer(float64))"
#: Direction d of states and the need.
_Half = tuple[float, float, float, float, float, float, float]


@cache
def kernel(function: HalfSpace) -> Any:
    """Return a compiled kernel, whose `address` holds as long as the process.

    Raises:
        ValueError: It does not compile.
    """
    try:
        return numba.cfunc(_SIGNATURE, error_model="numpy")(function)
    except numba.core.errors.NumbaError as error:
        raise ValueError(
            f"{function.__module__}.{function.__qualname__} does not compile as a row kernel; use numbers, `math` and "
            f"the three arrays, element by element: {error}"
        ) from None


@intrinsic  # type: ignore[misc,untyped-decorator]
def _call(context: Any, table: Any, j: Any, x: Any) -> Any:
    """Return (d, need) of the j-th kernel of the table at an address, with its parameters, at the state x."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        table, j, x = arguments
        double = ir.DoubleType()
        pointer, word = double.as_pointer(), ir.IntType(64)
        state, direction = (cgutils.alloca_once(builder, double, size=6) for _ in range(2))
        for i in range(6):
            builder.store(builder.extract_value(x, i), cgutils.gep_inbounds(builder, state, i))
            builder.store(ir.Constant(double, 0.0), cgutils.gep_inbounds(builder, direction, i))
        entry = builder.gep(builder.inttoptr(table, word.as_pointer()), [builder.mul(j, ir.Constant(word, 2))])
        address, numbers = builder.load(entry), builder.load(builder.gep(entry, [ir.Constant(word, 1)]))
        function = builder.inttoptr(address, ir.FunctionType(double, [pointer] * 3).as_pointer())
        need = builder.call(function, [builder.inttoptr(numbers, pointer), state, direction])
        parts = [builder.load(cgutils.gep_inbounds(builder, direction, i)) for i in range(6)]
        return context.make_tuple(builder, signature.return_type, [*parts, need])

    result = types.UniTuple(types.float64, 7)
    return result(types.int64, types.int64, types.UniTuple(types.float64, 6)), generate


@njit(**BORROWING)
def half_space(m: FilterModel, code: int, x: RowState) -> _Half:
    """Return the direction d and the need of a further constraint at a state, d.x >= need where it is met.

    The part of d for positions has unit length, or where d has no such part that for velocities.
    """
    h: _Half = _call(m.kernels, code - FURTHER, x)  # type: ignore[call-arg]
    size = math.sqrt(h[0] * h[0] + h[1] * h[1] + h[2] * h[2])
    if size == 0.0:
        size = math.sqrt(h[3] * h[3] + h[4] * h[4] + h[5] * h[5])
    return h[0] / size, h[1] / size, h[2] / size, h[3] / size, h[4] / size, h[5] / size, h[6] / size


@njit(**BORROWING)
def along(h: _Half, x: RowState) -> float:
    """Return d.x."""
    return h[0] * x[0] + h[1] * x[1] + h[2] * x[2] + h[3] * x[3] + h[4] * x[4] + h[5] * x[5]


@njit(**BORROWING)
def sizes(h: _Half) -> tuple[float, float]:
    """Return the lengths of d for positions and for velocities."""
    return math.sqrt(h[0] * h[0] + h[1] * h[1] + h[2] * h[2]), math.sqrt(h[3] * h[3] + h[4] * h[4] + h[5] * h[5])


@njit(**BORROWING)
def needed(h: _Half, margins: Margins) -> float:
    """Return the need with margins of positions [m] and velocities [m/s]."""
    position, velocity = sizes(h)
    return h[6] + position * margins.length + velocity * margins.speed


@njit(**BORROWING)
def further_slack(m: FilterModel, code: int, x: RowState) -> float:
    """Return how far a further constraint is from broken, in metres; speeds count as the range of a motion so fast."""
    h = half_space(m, code, x)
    position, velocity = sizes(h)
    return (along(h, x) - h[6]) / (position + velocity / m.n)


@njit(**BORROWING)
def further_broken(m: FilterModel, x: RowState, margins: Margins) -> int:
    """Return the code of a further constraint that is not met at a state with those margins; SAFE if all are."""
    for code in range(FURTHER, FURTHER + m.further):
        h = half_space(m, code, x)
        if not along(h, x) >= needed(h, margins):
            return code
    return SAFE


@njit(**BORROWING)
def further_uncertain(m: FilterModel, cell: ArcCell, margins: Margins) -> int:
    """Return the code of a further constraint that a cell's ends cannot certify; SAFE if all are."""
    a, b = cell.a.state, cell.b.state
    ax, ay, az = cell.acceleration_a
    bx, by, bz = cell.acceleration_b
    eighth, k, reach = cell.eighth, cell.k, cell.reach
    middle = (
        0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1]), 0.5 * (a[2] + b[2]),
        0.5 * (a[3] + b[3]), 0.5 * (a[4] + b[4]), 0.5 * (a[5] + b[5]),
    )  # fmt: skip
    for code in range(FURTHER, FURTHER + m.further):
        h = half_space(m, code, middle)
        position, velocity = sizes(h)
        curve = max(h[0] * ax + h[1] * ay + h[2] * az, h[0] * bx + h[1] * by + h[2] * bz)
        dip = max(0.0, eighth * curve + 6.0 * k * k * reach * position / m.n + 3.0 * k * reach * velocity)
        if not lowest(along(h, a), along(h, b), dip) >= needed(h, margins):
            return code
    return SAFE


@njit(**BORROWING)
def further_closed_motion(m: FilterModel, x: RowState, margins: Margins) -> int:
    """Return a further constraint that the drift-free motion from x breaks within an orbit, or SAFE.

    With the bounds of `closed_motion`: in the angle of the orbit the second derivative of the position is
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
            middle = (
                0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1]), 0.5 * (a[2] + b[2]),
                0.5 * (a[3] + b[3]), 0.5 * (a[4] + b[4]), 0.5 * (a[5] + b[5]),
            )  # fmt: skip
            h = half_space(m, code, middle)
            position, velocity = sizes(h)
            k = 0.125 * ((end - place) * (2.0 * math.pi / FINEST)) ** 2
            lower = min(h[0] * a[0] + h[1] * a[1] + h[2] * a[2], h[0] * b[0] + h[1] * b[1] + h[2] * b[2])
            dip = max(0.0, k * (h[1] * centre - lower) + k * rho * (k * position + m.n * velocity))
            if lowest(along(h, a), along(h, b), dip) >= needed(h, margins):
                a, place, span = b, end, min(2 * span, FINEST // ORBIT_CELLS)
            elif span > 1:
                span //= 2
            else:
                return code
    return SAFE
