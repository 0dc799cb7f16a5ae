"""Constraints that limit the speed: `RelativeSpeedLimit` by the range, and one along each axis; see `Constraint`."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar, NamedTuple

from pydantic import Field

from safe_inspect.compiling import njit
from safe_inspect.rta.constraints.base import Constraint, ConstraintValues, RelativeState
from safe_inspect.rta.constraints.parameters import DEFAULTS
from safe_inspect.rta.constraints.rows import (
    INLINED,
    ArcCell,
    Margins,
    Node,
    RowKernels,
    StateArrays,
    Triple,
    direction,
    lowest,
)
from safe_inspect.types import FloatArray
from safe_inspect.units import NonNegativeLength, NonNegativeSpeed, PositiveSpeed, SpeedSlope


class _RelativeSpeedNumbers(NamedTuple):
    """Speed limit v0 [m/s] (infinity where there is none) at the range d0 [m], its slope v1, mean motion n [1/s]."""

    v0: float
    d0: float
    v1: float
    n: float


@njit(**INLINED)
def _relative_limit(p: _RelativeSpeedNumbers, at: Node) -> float:
    return p.v0 + p.v1 * (at.range - p.d0)


@njit(**INLINED)
def _relative_broken(p: _RelativeSpeedNumbers, at: Any, margins: Margins) -> bool:
    return bool(at.speed > _relative_limit(p, at) - margins.speed)


@njit(**INLINED)
def _relative_uncertain(p: _RelativeSpeedNumbers, cell: Any, margins: Margins) -> bool:
    a, b = p.v1 * cell.near_a - cell.a.speed, p.v1 * cell.near_b - cell.b.speed
    return bool(p.v0 - p.v1 * p.d0 + lowest(a, b, p.v1 * cell.dip + cell.slack) < margins.speed)


@njit(**INLINED)
def _relative_slack(p: _RelativeSpeedNumbers, at: Node) -> float:
    return float((_relative_limit(p, at) - at.speed) / p.n)


@njit(**INLINED)
def _relative_support(p: _RelativeSpeedNumbers, at: Node, margins: Margins, d: FloatArray) -> float:
    x = at.state
    ex, ey, ez = direction(x)
    vx, vy, vz = direction(x[3:])
    d[0], d[1], d[2] = p.v1 * ex, p.v1 * ey, p.v1 * ez
    d[3], d[4], d[5] = -vx, -vy, -vz
    return p.v1 * p.d0 - p.v0 + margins.speed


@njit
def _relative_values(
    state: StateArrays, v0: float, v0_distance: float, v1: float, smoothing: float,
    phi: FloatArray, h: FloatArray, gradient: FloatArray, rate: FloatArray,
) -> None:  # fmt: skip
    """Write phi, h and the gradient of h for every row."""
    position, velocity, _ = state
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
    """Speed limit that is a linear function of the range: phi = v0 + v1 (r - d0) - |v|, in Hill's frame.

    phi >= 0 at every moment is what the filters ``backup`` and of a team guarantee, by default |v| <= 0.2 m/s + 2 n
    (r - 10 m) with n = 0.001027 rad/s; `Constraint` has the premises. Fields that are not given come from the
    parameters of the filter (`ConstraintParameters`).

    h, for the filter ``continuous``, is phi with norms sqrt(|.|^2 + smoothing), so that the gradient exists, and is
    zero, at rest and at the chief's centre. As a result, h treats a deputy at rest as moving at 3.2 mm/s, and one at
    0.2 m/s as 0.025 mm/s faster.

    Attributes:
        v0: Speed allowed at `v0_distance` [m/s]; 0.2 by default.
        v0_distance: Range d0 at which the speed `v0` is allowed [m]; by default the radius of the chief, 10.
        v1: Slope of the limit over the range [1/s]; by default the parameters' `v1_coef` n, 2 n with the mean motion n.
        smoothing: Term added under the square roots of h [m^2 or m^2/s^2].
    """

    unit: ClassVar[str] = "m/s"
    from_task: ClassVar[Mapping[str, str]] = {"v0": "v0", "v0_distance": "speed_distance", "v1": "v1"}
    kernels: ClassVar[RowKernels | None] = RowKernels(
        broken=_relative_broken, uncertain=_relative_uncertain, slack=_relative_slack, support=_relative_support,
        allowed_speed=_relative_limit, closed_broken=_relative_broken, closed_uncertain=_relative_uncertain,
        cost=1, convex=True,
    )  # fmt: skip

    v0: NonNegativeSpeed = DEFAULTS.v0
    v0_distance: NonNegativeLength = DEFAULTS.speed_distance
    v1: SpeedSlope = DEFAULTS.v1
    smoothing: float = Field(default=1e-5, gt=0.0, allow_inf_nan=False)
    alpha_linear: float = 0.05
    alpha_cubic: float = 0.005
    bias: float = -1e-3

    @classmethod
    def row_numbers(cls, n: float, chosen: Mapping[str, Any]) -> _RelativeSpeedNumbers:
        """Return the coefficients of the speed limit, and the mean motion."""
        if "rel_vel" not in chosen:
            return _RelativeSpeedNumbers(math.inf, 0.0, 0.0, n)
        line = chosen["rel_vel"]
        return _RelativeSpeedNumbers(float(line.v0), float(line.v0_distance), float(line.v1), n)

    def evaluate(self, state: RelativeState) -> ConstraintValues:
        """Return phi [m/s], h [m/s] and the derivatives of h."""
        return ConstraintValues.computed(_relative_values, state, self.v0, self.v0_distance, self.v1, self.smoothing)


class _AxisSpeedNumbers(NamedTuple):
    """Largest speed [m/s] (infinity where there is no limit), index of the axis, and mean motion [1/s]."""

    limit: float
    axis: int
    n: float


@njit(**INLINED)
def _axis_broken(p: _AxisSpeedNumbers, at: Node, margins: Margins) -> bool:
    return bool(abs(at.state[3 + p.axis]) > p.limit - margins.speed)


@njit(**INLINED)
def _axis_uncertain(p: _AxisSpeedNumbers, cell: ArcCell, margins: Margins) -> bool:
    a, b = cell.a.state[3 + p.axis], cell.b.state[3 + p.axis]
    return bool(lowest(-abs(a), -abs(b), cell.slack) < margins.speed - p.limit)


@njit(**INLINED)
def _amplitude(p: _AxisSpeedNumbers, speeds: Triple, margins: Margins) -> bool:
    return bool(speeds[p.axis] > p.limit - margins.speed)


@njit(**INLINED)
def _axis_slack(p: _AxisSpeedNumbers, at: Node) -> float:
    return float((p.limit - abs(at.state[3 + p.axis])) / p.n)


@njit(**INLINED)
def _axis_support(p: _AxisSpeedNumbers, at: Node, margins: Margins, d: FloatArray) -> float:
    d[3 + p.axis] = -1.0 if at.state[3 + p.axis] > 0.0 else 1.0
    return margins.speed - p.limit


@njit(**INLINED)
def _axis_limit(p: _AxisSpeedNumbers, at: Node) -> float:
    return p.limit


@njit
def _axis_values(
    state: StateArrays, axis: int, limit: float, phi: FloatArray, h: FloatArray, gradient: FloatArray, rate: FloatArray
) -> None:
    """Write phi, h and the one nonzero entry of the gradient of h for every row."""
    velocity = state[1]
    for i in range(velocity.shape[0]):
        speed = velocity[i, axis]
        phi[i] = limit - abs(speed)
        h[i] = limit * limit - speed * speed
        gradient[i, 3 + axis] = -2.0 * speed


class AxisSpeed(Constraint):
    """Limit on the speed along one axis of Hill's frame: h = v_lim^2 - v_i^2 [m^2/s^2], phi = v_lim - |v_i| [m/s].

    The gradient is zero at v_i = 0, where every control is allowed.

    Attributes:
        vel_limit: Largest speed v_lim along the axis [m/s]; 1 by default.
    """

    unit: ClassVar[str] = "m/s"
    from_task: ClassVar[Mapping[str, str]] = {"vel_limit": "vel_limit"}
    kernels: ClassVar[RowKernels | None] = RowKernels(
        broken=_axis_broken, uncertain=_axis_uncertain, slack=_axis_slack, support=_axis_support, amplitude=_amplitude,
        allowed_speed=_axis_limit, convex=True,
    )  # fmt: skip

    vel_limit: PositiveSpeed = DEFAULTS.vel_limit
    alpha_linear: float = 0.1
    alpha_cubic: float = 0.01
    bias: float = -1e-3

    @classmethod
    @abstractmethod
    def axis(cls) -> int:
        """Return the index of the axis: 0 radial, 1 along track, 2 cross track."""

    @classmethod
    def row_numbers(cls, n: float, chosen: Mapping[str, Any]) -> _AxisSpeedNumbers:
        """Return the largest speed along the axis, the index of the axis, and the mean motion."""
        name = cls.registered_name
        limit = float(chosen[name].vel_limit) if name in chosen else math.inf
        return _AxisSpeedNumbers(limit, cls.axis(), n)

    def evaluate(self, state: RelativeState) -> ConstraintValues:
        """Return phi [m/s], h [m^2/s^2] and the derivatives of h."""
        return ConstraintValues.computed(_axis_values, state, self.axis(), self.vel_limit)


class RadialSpeed(AxisSpeed, name="x_vel"):
    """Limit on the radial speed; see `AxisSpeed`."""

    @classmethod
    def axis(cls) -> int:
        """Return the index of the radial axis."""
        return 0


class AlongTrackSpeed(AxisSpeed, name="y_vel"):
    """Limit on the along-track speed; see `AxisSpeed`."""

    @classmethod
    def axis(cls) -> int:
        """Return the index of the along-track axis."""
        return 1


class CrossTrackSpeed(AxisSpeed, name="z_vel"):
    """Limit on the cross-track speed; see `AxisSpeed`."""

    @classmethod
    def axis(cls) -> int:
        """Return the index of the cross-track axis."""
        return 2
