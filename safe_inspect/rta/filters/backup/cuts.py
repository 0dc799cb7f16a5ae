"""Compiled half-spaces of controls that approximate the constraints near a control.

The state of a hold is affine in the control, so the supporting direction d of a constraint at one moment gives a
half-space d.(free motion + input u) >= need. For a speed or the largest range, it contains every safe control; for the
range, the sun cone and passive safety, all of its controls are safe at that moment.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from safe_inspect.compiling import BORROWING, njit
from safe_inspect.dynamics.cwh import RowState
from safe_inspect.rta.constraints.certified import CERTIFIED, COLLISION, PSM
from safe_inspect.rta.constraints.rows import Margins, Node, SunAngle, direction, node
from safe_inspect.rta.filters.backup.arcs import held, turned
from safe_inspect.rta.filters.backup.half_spaces import half_space, needed
from safe_inspect.rta.filters.backup.holds import coasted
from safe_inspect.rta.filters.backup.model import FURTHER, HOLD_PIECES, FilterModel
from safe_inspect.rta.filters.backup.sequences import support_of
from safe_inspect.rta.filters.backup.workspace import Workspace, as_bool, as_int
from safe_inspect.types import FloatArray

#: Bits of the constraints whose half-spaces contain every safe control, and of further constraints, for which they may.
CONVEX = -1 << FURTHER
for _code, _constraint in enumerate(CERTIFIED):
    if _constraint.kernels is not None and _constraint.kernels.convex:
        CONVEX |= 1 << _code


class Refusal(NamedTuple):
    """Code of the constraint that rejected a hold, and the piece of the hold where it did."""

    code: int
    piece: int


@njit(**BORROWING)
def support(m: FilterModel, code: int, at: Node, margins: Margins, d: FloatArray) -> float:
    """Write the direction d of a constraint at a state, shape (6,), and return the need: safe where d.state >= need.

    Passive safety has none; see `cut_near`.
    """
    if code >= FURTHER:
        half = half_space(m, code, at.state)
        for j in range(6):
            d[j] = half[j]
        return float(needed(half, margins))
    for j in range(6):
        d[j] = 0.0
    return float(support_of(m.constraints, code, at, margins, d))


@njit(**BORROWING)
def add(m: FilterModel, need: float, b: RowState, u: FloatArray, k: int, s: Workspace, count: int) -> int:
    """Append the half-space d.state(k) >= need for d in `s.d`, given the state b reached with the thrust u.

    Returns:
        The new count.
    """
    if count >= s.bounds.shape[0]:
        return count
    value = need
    for j in range(6):
        value -= s.d[j] * b[j]
    for axis in range(3):
        total = 0.0
        for j in range(6):
            total += s.d[j] * m.hold_gamma[k, j, axis]
        s.rows[count, axis] = total
        value += total * u[axis]
    s.bounds[count] = value
    return count + 1


@njit(**BORROWING)
def cut_near(
    m: FilterModel, x: RowState, u: FloatArray, own_side: bool, always: bool, margins: Margins, s: Workspace,
    count: int,
) -> int:  # fmt: skip
    """Append a half-space that avoids the chief at the worst sample of coasting from the hold's middle and end.

    Its direction is that of the closest approach, to pass the chief, or that of the present position, to stay on this
    side of it. It is appended if a sample is too near, or unconditionally if `always`.
    """
    near = m.constraints[COLLISION].closed_near
    if not near > 0.0:
        return count
    sx, sy, sz = direction(x[0], x[1], x[2])
    worst, at_k, at_j = math.inf, as_int(0), as_int(0)
    last = m.coast.shape[0] if m.near_psm > 0.0 else 1
    for k in (HOLD_PIECES // 2, HOLD_PIECES):
        for j in range(0, last, 4):
            px, py, pz = coasted(m, x, u, k, j)
            reach = sx * px + sy * py + sz * pz if own_side else math.sqrt(px * px + py * py + pz * pz)
            if reach < worst:
                worst, at_k, at_j = reach, k, j
    if worst >= near + margins.coasting and not always:
        return count
    if not own_side:
        sx, sy, sz = coasted(m, x, u, at_k, at_j)
        sx, sy, sz = direction(sx, sy, sz)
    for i in range(6):
        s.d[i] = sx * m.coast[at_j, 0, i] + sy * m.coast[at_j, 1, i] + sz * m.coast[at_j, 2, i]
    return int(add(m, near + margins.coasting, held(m, x, u, at_k), u, at_k, s, count))


@njit(**BORROWING)
def cut_hold(
    m: FilterModel, x: RowState, sun: SunAngle, u: FloatArray, refusal: Refusal, own_side: bool, margins: Margins,
    s: Workspace, count: int,
) -> int:  # fmt: skip
    """Append the half-space of the constraint that rejected a hold, at the moment of the violation."""
    code, k = refusal
    if code in (PSM, COLLISION):
        return int(cut_near(m, x, u, own_side, as_bool(True), margins, s, count))
    b, sun_b = held(m, x, u, k), turned(sun, m.hold_sun[k, 0], m.hold_sun[k, 1])
    need = support(m, code, node(b, sun_b), margins, s.d)
    return int(add(m, need, b, u, k, s, count))


@njit(**BORROWING)
def cut_end(
    m: FilterModel, x: RowState, sun: SunAngle, u: FloatArray, codes: int, margins: Margins, s: Workspace, count: int
) -> tuple[int, int]:  # fmt: skip
    """Append the half-spaces of the constraints of the bits `codes` that are violated at the end of a hold.

    Returns:
        The new count, and the bits of the constraints that are violated.
    """
    k, bits = as_int(HOLD_PIECES), 0
    b, sun_b = held(m, x, u, k), turned(sun, m.hold_sun[k, 0], m.hold_sun[k, 1])
    end, d = node(b, sun_b), s.d
    for code in range(FURTHER + m.further):
        if not (m.active & codes) >> code & 1:
            continue
        need = support(m, code, end, margins, d)
        value = d[0] * b[0] + d[1] * b[1] + d[2] * b[2] + d[3] * b[3] + d[4] * b[4] + d[5] * b[5]
        if value < need:
            count = add(m, need, b, u, k, s, count)
            bits |= 1 << code
    return count, bits


@njit(**BORROWING)
def cut_broken(
    m: FilterModel, x: RowState, sun: SunAngle, u: FloatArray, own_side: bool, margins: Margins, s: Workspace,
    count: int,
) -> tuple[int, int]:  # fmt: skip
    """Append the half-spaces of all constraints violated at the end of a hold; return the count and their bits."""
    count, bits = cut_end(m, x, sun, u, as_int(~(1 << COLLISION)), margins, s, count)
    b = held(m, x, u, HOLD_PIECES)
    near = m.constraints[COLLISION].near
    if near > 0.0 and b[0] * b[0] + b[1] * b[1] + b[2] * b[2] < (near + margins.length) ** 2:
        bits |= 1 << COLLISION
    before = count
    count = cut_near(m, x, u, own_side, as_bool(False), margins, s, count)
    if m.near_psm > 0.0 and count > before:
        bits |= 1 << PSM
    return count, bits
