"""Constraint that keeps a deputy near the chief."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, ClassVar, NamedTuple, Self

from safe_inspect.compiling import njit
from safe_inspect.rta.constraints.base import Constraint, ConstraintValues, RelativeState
from safe_inspect.rta.constraints.parameters import DEFAULTS, ConstraintParameters
from safe_inspect.rta.constraints.range_limit import range_limit
from safe_inspect.rta.constraints.rows import INLINED, Margins, Node, RowKernels, direction, lowest
from safe_inspect.rta.fields import PositiveAcceleration
from safe_inspect.types import FloatArray
from safe_inspect.units import PositiveLength

#: At ranges above this fraction of v / (2 n), v the largest along-track speed, closed motions are too fast to fly:
#: backup plans return to a smaller range.
_CLOSABLE = 0.9


class MaximumRangeNumbers(NamedTuple):
    """Largest range [m], infinity where there is no limit, and the range to which backup plans return [m]."""

    far: float
    inside: float


@njit(**INLINED)
def _broken(p: MaximumRangeNumbers, at: Any, margins: Margins) -> bool:
    return bool(at.range > p.far - margins.length)


@njit(**INLINED)
def _uncertain(p: MaximumRangeNumbers, cell: Any, margins: Margins) -> bool:
    if not cell.farthest > p.far - margins.length:
        return False
    return bool(lowest(-cell.a.range, -cell.b.range, cell.bend) < margins.length - p.far)


@njit(**INLINED)
def _slack(p: MaximumRangeNumbers, at: Node) -> float:
    return p.far - at.range


@njit(**INLINED)
def _gap(p: MaximumRangeNumbers, at: Node) -> float:
    return p.inside - at.range


@njit(**INLINED)
def _support(p: MaximumRangeNumbers, at: Node, margins: Margins, d: FloatArray) -> float:
    ex, ey, ez = direction(at.state[0], at.state[1], at.state[2])
    d[0], d[1], d[2] = -ex, -ey, -ez
    return margins.length - p.far


class MaximumRange(Constraint, name="r_max"):
    """Constraint that the deputy can stop before r_max: h = sqrt(2 a (r_max - r)) - p.v / r, phi = r_max - r.

    Beyond the largest range, the root is -sqrt(2 a |r_max - r|). Singular points are treated as in `ChiefCollision`.
    The guaranteed deceleration a does not include the centrifugal acceleration |v_across|^2 / r.

    Attributes:
        r_max: Largest allowed range [m].
        max_acceleration: Deceleration a that the thrusters guarantee [m/s^2].
    """

    unit: ClassVar[str] = "m"
    kernels: ClassVar[RowKernels | None] = RowKernels(
        broken=_broken, uncertain=_uncertain, slack=_slack, support=_support, gap=_gap,
        closed_broken=_broken, closed_uncertain=_uncertain, convex=True,
    )  # fmt: skip

    r_max: PositiveLength = DEFAULTS.r_max
    max_acceleration: PositiveAcceleration = DEFAULTS.max_acceleration
    bias: float = -1e-3

    @classmethod
    def from_parameters(cls, parameters: ConstraintParameters) -> Self:
        """Build the constraint from a task's parameters."""
        return cls(r_max=parameters.r_max, max_acceleration=parameters.max_acceleration)

    @classmethod
    def row_numbers(cls, n: float, chosen: Mapping[str, Any]) -> MaximumRangeNumbers:
        """Return the largest range, and the largest range of closed motions that the along-track speed limit allows."""
        far = float(chosen["r_max"].r_max) if "r_max" in chosen else math.inf
        fastest = float(chosen["y_vel"].vel_limit) if "y_vel" in chosen else math.inf
        return MaximumRangeNumbers(far, min(far, _CLOSABLE * fastest / (2.0 * n)))

    def evaluate(self, state: RelativeState) -> ConstraintValues:
        """Return phi [m], h [m/s] and the derivatives of h."""
        out = ConstraintValues.zeros(len(state))
        range_limit(
            (state.position, state.velocity), self.r_max, self.max_acceleration, -1.0,
            out.phi, out.h, out.gradient,
        )  # fmt: skip
        return out
