"""What compiled filters ask of a constraint, one state at a time: `RowKernels`, and the numbers that its kernels take.

A filter that certifies a motion cuts it into cells. On a cell of length D let f be a quantity that is smooth in time.
Then f is at most (D^2/8) max(f'', 0) 4 x (1 - x) below the chord of its ends at the fraction x of the cell, and f''
itself is bounded in the same way by its ends and its own second derivative. So the ends of a cell certify all of it,
or the cell is halved. Each constraint is put as such an f:

* range: e.p(t) <= |p(t)| for any unit vector e, here the direction of the cell's middle;
* sun cone: N.q(t) <= the signed distance from the cone, q the position in the frame that turns with the sun and N
  the cone's outward normal beside the cell's middle;
* largest range and speeds: a norm is convex, so that of a smooth vector exceeds the chord of its ends by no more than
  the vector's own departure from its chord.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

from safe_inspect.compiling import BORROWING, Kernel, njit
from safe_inspect.dynamics.cwh_row import RowState

#: Options of functions of a few lines, whose many arguments cost more to pass than their work.
INLINED: dict[str, Any] = {**BORROWING, "forceinline": True}
#: Three numbers along Hill's axes.
Triple = tuple[float, float, float]
#: Cosine and sine of the sun angle.
SunAngle = tuple[float, float]


class Margins(NamedTuple):
    """By how much a constraint must be met: ranges and the sun cone [m], speeds [m/s], ranges of coasting [m]."""

    length: float
    speed: float
    coasting: float


class Node(NamedTuple):
    """A state and what constraints compute from it.

    Attributes:
        state: Position [m] and velocity [m/s], Hill frame.
        sun: Cosine and sine of the sun angle.
        range: Distance from the origin [m].
        speed: Length of the velocity [m/s].
        along: Position along the sun cone's axis, away from the sun [m].
        across: Position across that axis, in the orbital plane [m].
    """

    state: RowState
    sun: SunAngle
    range: float
    speed: float
    along: float
    across: float


class ArcCell(NamedTuple):
    """A cell of an arc under constant thrust.

    Attributes:
        a: Its start.
        b: Its end.
        acceleration_a: Acceleration at the start [m/s^2].
        acceleration_b: Acceleration at the end [m/s^2].
        eighth: Eighth of the squared length [s^2].
        k: The same in units of 1 / n^2 [-].
        reach: Bound of |v| + |a| / n over the cell [m/s].
        bend: Bound of how far the position departs from the chord of its ends [m].
        slack: The same of the velocity [m/s].
        farthest: Bound of the range [m].
        size: Length of the sum of the two positions [m]; where it is 0 the numbers after it are not finite.
        near_a: The first position along the direction of that sum [m].
        near_b: The second [m].
        dip: Bound of how far that component sinks below its chord [m].
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


class ClosedNode(NamedTuple):
    """A point of a closed natural motion; the attributes are those of `Node`."""

    position: Triple
    sun: SunAngle
    range: float
    speed: float
    along: float
    across: float


class ClosedCell(NamedTuple):
    """A cell of a closed natural motion; the attributes that `ArcCell` has too are its.

    Attributes:
        k: Eighth of the squared angle [rad^2].
        centre: Centre of the motion along y [m].
        rho: Bound of all derivatives of the position with respect to the angle [m].
    """

    a: ClosedNode
    b: ClosedNode
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
    """The kernels of a constraint. Each takes first the numbers p of `Constraint.row_numbers`.

    A state that is safe with some margins passes all kernels with margins that are not larger. A constraint that does
    not count has numbers, such as infinity, with which its kernels refuse nothing.

    Attributes:
        broken: (p, node, margins): is it broken at a node of an arc?
        uncertain: (p, cell, margins): do the ends of an `ArcCell` leave open whether it is met in between?
        closed_broken: The same as `broken` for a `ClosedNode`; None where `amplitude` decides.
        closed_uncertain: The same as `uncertain` for a `ClosedCell`; None where `amplitude` decides.
        amplitude: (p, speeds, margins): is it broken somewhere on a closed motion with those largest speeds along the
            axes [m/s]?
        slack: (p, node): how far it is from broken [m]; speeds count as the range of a motion that fast.
        support: (p, node, margins, d): writes a direction d of states, which comes filled with zeros, and returns the
            need: safe where d.state >= need, as far as the constraint is linear.
        gap: (p, node): how far the way back leads inside [m]; None where it heeds the speeds at its end instead.
        turn: (p, sun, d): replaces in a direction d of velocities what turns with the sun; None where nothing does.
        allowed_speed: (p, node): the largest speed [m/s]; None where there is no such limit.
        cost: Constraints of lower cost are asked first about a cell.
        convex: Whether the half-spaces of `support` contain every safe state, or all but few: those of a speed limit
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
    """Return margins that are so many times as large."""
    return Margins(factor * margins.length, factor * margins.speed, factor * margins.coasting)


@njit(**INLINED)
def lowest(fa: float, fb: float, dip: float) -> float:
    """Return the least over 0 <= x <= 1 of the chord from fa to fb less dip 4 x (1 - x), dip >= 0."""
    rise = abs(fb - fa)
    if rise >= 4.0 * dip:
        return min(fa, fb)
    return min(fa, fb) - dip * (1.0 - 0.25 * rise / dip) ** 2


@njit(**INLINED)
def direction(x: float, y: float, z: float) -> Triple:
    """Return the direction of a vector; +x where it is shorter than 1e-9."""
    size = math.sqrt(x * x + y * y + z * z)
    return (x / size, y / size, z / size) if size > 1e-9 else (1.0, 0.0, 0.0)


@njit(**INLINED)
def sun_axes(sun: SunAngle, x: float, y: float) -> tuple[float, float]:
    """Return a vector's parts along the sun cone's axis, away from the sun, and across it in the orbital plane."""
    return sun[1] * y - sun[0] * x, -sun[1] * x - sun[0] * y


@njit(**INLINED)
def node(x: RowState, sun: SunAngle) -> Node:
    """Return a state with what constraints compute from it."""
    along, across = sun_axes(sun, x[0], x[1])
    return Node(
        x, sun, math.sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2]),
        math.sqrt(x[3] * x[3] + x[4] * x[4] + x[5] * x[5]), along, across,
    )  # fmt: skip
