"""Interface between a constraint and the compiled filters, one state at a time: `RowKernels` and the types they use.

A filter that certifies a motion divides it into cells. On a cell of length D, let f be a quantity that is smooth in
time. At the fraction x of the cell, f is at most (D^2/8) max(f'', 0) 4 x (1 - x) below the chord between its ends, and
f'' itself is bounded in the same way by its values at the ends and its own second derivative. Therefore the ends of a
cell certify all of it, or the cell is halved. Each constraint is expressed as such an f:

* range: e.p(t) <= |p(t)| for any unit vector e, here the direction of the middle of the cell;
* sun cone: N.q(t) <= the signed distance from the cone, where q is the position in the frame that rotates with the sun
  and N is the cone's outward normal near the middle of the cell;
* largest range and speeds: a norm is convex, so the norm of a smooth vector exceeds the chord between its ends by no
  more than the vector itself departs from its chord.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

from safe_inspect.compiling import BORROWING, Kernel, njit
from safe_inspect.dynamics.cwh import RowState
from safe_inspect.types import FloatArray

#: Options for functions of a few lines, for which passing the many arguments would cost more than their work.
INLINED: dict[str, Any] = {**BORROWING, "forceinline": True}
#: Three numbers along the axes of Hill's frame.
Triple = tuple[float, float, float]
#: Positions (R, 3), velocities (R, 3) and sun angles (R,).
StateArrays = tuple[FloatArray, FloatArray, FloatArray]
#: Cosine and sine of the sun angle.
SunAngle = tuple[float, float]


class Margins(NamedTuple):
    """Margins by which a constraint must be satisfied: ranges and sun cone [m], speeds [m/s], coasting ranges [m]."""

    length: float
    speed: float
    coasting: float


NO_MARGINS = Margins(0.0, 0.0, 0.0)


class Node(NamedTuple):
    """State and the quantities that constraints compute from it.

    Attributes:
        state: Position [m] and velocity [m/s], Hill frame; on a closed motion, the position alone.
        sun: Cosine and sine of the sun angle.
        range: Distance from the origin [m].
        speed: Length of the velocity [m/s].
        along: Position along the axis of the sun cone, away from the sun [m].
        across: Position across that axis, in the orbital plane [m].
    """

    state: Any
    sun: SunAngle
    range: float
    speed: float
    along: float
    across: float


class ArcCell(NamedTuple):
    """Time interval of an arc under constant thrust, with bounds that hold throughout it; h is its length [s].

    Attributes:
        a: Start of the cell.
        b: End of the cell.
        acceleration_a: Acceleration at the start [m/s^2].
        acceleration_b: Acceleration at the end [m/s^2].
        eighth: h^2 / 8 [s^2].
        k: n^2 h^2 / 8 [-], n being the mean motion.
        reach: Bound on |v| + |a| / n over the cell [m/s].
        bend: Upper bound on the distance of the position from the straight line between its ends [m].
        slack: Upper bound on the distance of the velocity from the straight line between its ends [m/s].
        farthest: Upper bound on the range [m].
        size: Length of the sum of the two positions [m]; where it is 0, the attributes below are not finite.
        near_a: Component of the first position along the direction of that sum [m].
        near_b: The same component of the second position [m].
        dip: Upper bound on how far that component falls below the straight line from `near_a` to `near_b` [m].
    """

    a: Node
    b: Node
    acceleration_a: Triple
    acceleration_b: Triple
    eighth: float
    k: float
    reach: float
    bend: float
    slack: float
    farthest: float
    size: float
    near_a: float
    near_b: float
    dip: float


class ClosedCell(NamedTuple):
    """Cell of a closed natural motion; attributes that `ArcCell` also has are described there.

    Attributes:
        k: One eighth of the squared angle of the cell [rad^2].
        centre: Centre of the motion along y [m].
        rho: Bound on all derivatives of the position with respect to the angle [m].
    """

    a: Node
    b: Node
    k: float
    centre: float
    rho: float
    bend: float
    slack: float
    farthest: float
    size: float
    near_a: float
    near_b: float
    dip: float


@dataclass(frozen=True)
class RowKernels:
    """Kernels of a constraint. The first argument of each is the numbers p of `Constraint.row_numbers`.

    A state that is safe with some margins passes all kernels with margins that are not larger. A constraint that does
    not apply has numbers, such as infinity, with which its kernels reject nothing.

    Attributes:
        broken: (p, node, margins): is the constraint violated at a node of an arc?
        uncertain: (p, cell, margins): do the ends of an `ArcCell` leave open whether it is satisfied in between?
        closed_broken: The same as `broken` for a `Node` of a closed motion; None where `amplitude` decides.
        closed_uncertain: The same as `uncertain` for a `ClosedCell`; None where `amplitude` decides.
        amplitude: (p, speeds, margins): is it violated somewhere on a closed motion with those largest speeds along the
            axes [m/s]?
        slack: (p, node): distance from a violation [m]; a speed counts as the range of a motion with that speed.
        support: (p, node, margins, d): writes a direction d of states, which is filled with zeros beforehand, and
            returns the need: safe where d.state >= need, as far as the constraint is linear.
        gap: (p, node): how far inside the constraint a backup plan returns [m]; None where the plan considers the
            speeds at its end instead.
        turn: (p, sun, d): replaces the part of a direction d of velocities that rotates with the sun; None where no
            part does.
        allowed_speed: (p, node): the largest speed [m/s]; None where there is no such limit.
        cost: Constraints of lower cost are checked first for a cell.
        convex: Whether the half-spaces of `support` contain all safe states, or all but a few: those of a speed limit
            that grows with the range are tangent at one state.
    """

    broken: Kernel[..., bool]
    uncertain: Kernel[..., bool]
    slack: Kernel[..., float]
    support: Kernel[..., float]
    closed_broken: Kernel[..., bool] | None = None
    closed_uncertain: Kernel[..., bool] | None = None
    amplitude: Kernel[..., bool] | None = None
    gap: Kernel[..., float] | None = None
    turn: Kernel[..., None] | None = None
    allowed_speed: Kernel[..., float] | None = None
    cost: int = 0
    convex: bool = False


@njit(**INLINED)
def scaled(margins: Margins, factor: float) -> Margins:
    """Return the margins multiplied by a factor."""
    return Margins(factor * margins.length, factor * margins.speed, factor * margins.coasting)


@njit(**INLINED)
def lowest(fa: float, fb: float, dip: float) -> float:
    """Return the least value, over 0 <= x <= 1, of the chord from fa to fb minus dip 4 x (1 - x), with dip >= 0."""
    rise = abs(fb - fa)
    if rise >= 4.0 * dip:
        return min(fa, fb)
    return min(fa, fb) - dip * (1.0 - 0.25 * rise / dip) ** 2


@njit(**INLINED)
def inner(a: Any, b: Any) -> float:
    """Return the inner product of the first three numbers of two vectors."""
    return float(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


@njit(**INLINED)
def size_of(a: Any) -> float:
    """Return the length of the first three numbers of a vector."""
    return float(math.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2]))


@njit(**INLINED)
def direction(a: Any) -> Triple:
    """Return the direction of the first three numbers of a vector; +x where it is shorter than 1e-9."""
    size = size_of(a)
    return (a[0] / size, a[1] / size, a[2] / size) if size > 1e-9 else (1.0, 0.0, 0.0)


@njit(**INLINED)
def sun_axes(sun: SunAngle, x: float, y: float) -> tuple[float, float]:
    """Return a vector's components along the sun cone's axis, away from the sun, and across it in the orbital plane."""
    return sun[1] * y - sun[0] * x, -sun[1] * x - sun[0] * y


@njit(**INLINED)
def node(x: RowState, sun: SunAngle) -> Node:
    """Return a state with the quantities that constraints compute from it."""
    along, across = sun_axes(sun, x[0], x[1])
    return Node(x, sun, size_of(x), size_of(x[3:]), along, across)


#: Below this distance [m], no direction is derived from the position, because it would be rounding noise.
LENGTH_FLOOR = 1e-6
#: Below this distance [m], the slope of the signed square root is the slope at this distance; it is infinite at 0.
ROOT_FLOOR = 1e-6


@njit
def braking_speed(distance: float, acceleration: float) -> tuple[float, float]:
    """Return sign(d) sqrt(2 a |d|), the speed from which one can brake within d, and its slope."""
    size = abs(distance)
    value = math.sqrt(2.0 * acceleration * size)
    slope = acceleration / math.sqrt(2.0 * acceleration * max(size, ROOT_FLOOR))
    return (value if distance >= 0.0 else -value), slope
