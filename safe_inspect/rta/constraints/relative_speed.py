"""Constraint that limits the speed by the distance from the chief."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, ClassVar, NamedTuple, Self

from pydantic import Field

from safe_inspect.compiling import njit
from safe_inspect.rta.constraints.base import Constraint, ConstraintValues, RelativeState
from safe_inspect.rta.constraints.parameters import DEFAULTS, ConstraintParameters
from safe_inspect.rta.constraints.rows import INLINED, Margins, Node, RowKernels, direction, lowest
from safe_inspect.rta.fields import SpeedSlope
from safe_inspect.types import FloatArray
from safe_inspect.units import NonNegativeLength, NonNegativeSpeed


class RelativeSpeedNumbers(NamedTuple):
    """Speed limit v0 [m/s] (infinity where there is none) at the range d0 [m], its slope v1, mean motion n [1/s]."""

    v0: float
    d0: float
    v1: float
    n: float


@njit(**INLINED)
def _broken(p: RelativeSpeedNumbers, at: Any, margins: Margins) -> bool:
    return bool(at.speed > p.v0 + p.v1 * (at.range - p.d0) - margins.speed)


@njit(**INLINED)
def _uncertain(p: RelativeSpeedNumbers, cell: Any, margins: Margins) -> bool:
    a, b = p.v1 * cell.near_a - cell.a.speed, p.v1 * cell.near_b - cell.b.speed
    return bool(p.v0 - p.v1 * p.d0 + lowest(a, b, p.v1 * cell.dip + cell.slack) < margins.speed)


@njit(**INLINED)
def _slack(p: RelativeSpeedNumbers, at: Node) -> float:
    return (p.v0 + p.v1 * (at.range - p.d0) - at.speed) / p.n


@njit(**INLINED)
def _support(p: RelativeSpeedNumbers, at: Node, margins: Margins, d: FloatArray) -> float:
    x = at.state
    ex, ey, ez = direction(x[0], x[1], x[2])
    vx, vy, vz = direction(x[3], x[4], x[5])
    d[0], d[1], d[2] = p.v1 * ex, p.v1 * ey, p.v1 * ez
    d[3], d[4], d[5] = -vx, -vy, -vz
    return p.v1 * p.d0 - p.v0 + margins.speed


@njit(**INLINED)
def _allowed_speed(p: RelativeSpeedNumbers, at: Node) -> float:
    return p.v0 + p.v1 * (at.range - p.d0)


@njit
def _values(
    state: tuple[FloatArray, FloatArray], v0: float, v0_distance: float, v1: float, smoothing: float,
    phi: FloatArray, h: FloatArray, gradient: FloatArray,
) -> None:  # fmt: skip
    """Write phi, h and the gradient of h for every row."""
    position, velocity = state
    for i in range(position.shape[0]):
        x, y, z = position[i]
        vx, vy, vz = velocity[i]
        r2 = x * x + y * y + z * z
        s2 = vx * vx + vy * vy + vz * vz
        distance, speed = math.sqrt(r2 + smoothing), math.sqrt(s2 + smoothing)
        phi[i] = v0 + v1 * (math.sqrt(r2) - v0_distance) - math.sqrt(s2)
        h[i] = v0 + v1 * (distance - v0_distance) - speed
        gradient[i, 0] = v1 * x / distance
        gradient[i, 1] = v1 * y / distance
        gradient[i, 2] = v1 * z / distance
        gradient[i, 3] = -vx / speed
        gradient[i, 4] = -vy / speed
        gradient[i, 5] = -vz / speed


class RelativeSpeedLimit(Constraint, name="rel_vel"):
    """Speed limit that is a linear function of the range: h = v0 + v1 (r - d0) - speed.

    phi is the same with exact norms. In h, both norms are sqrt(|.|^2 + smoothing), so that the gradient exists, and is
    zero, at rest and at the chief's centre. As a result, h treats a deputy at rest as moving at 3.2 mm/s, and one at
    0.2 m/s as 0.025 mm/s faster.

    Attributes:
        v0: Speed allowed at `v0_distance` [m/s].
        v0_distance: Range d0 at which the speed `v0` is allowed [m].
        v1: Slope of the limit over the range [1/s].
        smoothing: Term added under the square roots of h [m^2 or m^2/s^2].
    """

    unit: ClassVar[str] = "m/s"
    kernels: ClassVar[RowKernels | None] = RowKernels(
        broken=_broken, uncertain=_uncertain, slack=_slack, support=_support, allowed_speed=_allowed_speed,
        closed_broken=_broken, closed_uncertain=_uncertain, cost=1, convex=True,
    )  # fmt: skip

    v0: NonNegativeSpeed = DEFAULTS.v0
    v0_distance: NonNegativeLength = DEFAULTS.speed_distance
    v1: SpeedSlope = DEFAULTS.v1
    smoothing: float = Field(default=1e-5, gt=0.0, allow_inf_nan=False)
    alpha_linear: float = 0.05
    alpha_cubic: float = 0.005
    bias: float = -1e-3

    @classmethod
    def from_parameters(cls, parameters: ConstraintParameters) -> Self:
        """Build the constraint from a task's parameters."""
        return cls(v0=parameters.v0, v0_distance=parameters.speed_distance, v1=parameters.v1)

    @classmethod
    def row_numbers(cls, n: float, chosen: Mapping[str, Any]) -> RelativeSpeedNumbers:
        """Return the coefficients of the speed limit, and the mean motion."""
        if "rel_vel" not in chosen:
            return RelativeSpeedNumbers(math.inf, 0.0, 0.0, n)
        line = chosen["rel_vel"]
        return RelativeSpeedNumbers(float(line.v0), float(line.v0_distance), float(line.v1), n)

    def evaluate(self, state: RelativeState) -> ConstraintValues:
        """Return phi [m/s], h [m/s] and the derivatives of h."""
        out = ConstraintValues.zeros(len(state))
        _values(
            (state.position, state.velocity), self.v0, self.v0_distance, self.v1, self.smoothing,
            out.phi, out.h, out.gradient,
        )  # fmt: skip
        return out
