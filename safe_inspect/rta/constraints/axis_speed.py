"""Constraints that limit the speed along each axis."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar, NamedTuple, Self

from safe_inspect.compiling import njit
from safe_inspect.rta.constraints.base import Constraint, ConstraintValues, RelativeState
from safe_inspect.rta.constraints.parameters import DEFAULTS, ConstraintParameters
from safe_inspect.rta.constraints.rows import INLINED, ArcCell, Margins, Node, RowKernels, Triple, lowest
from safe_inspect.types import FloatArray
from safe_inspect.units import PositiveSpeed


class AxisSpeedNumbers(NamedTuple):
    """Largest speed [m/s] (infinity where there is no limit), index of the axis, and mean motion [1/s]."""

    limit: float
    axis: int
    n: float


@njit(**INLINED)
def _broken(p: AxisSpeedNumbers, at: Node, margins: Margins) -> bool:
    return bool(abs(at.state[3 + p.axis]) > p.limit - margins.speed)


@njit(**INLINED)
def _uncertain(p: AxisSpeedNumbers, cell: ArcCell, margins: Margins) -> bool:
    a, b = cell.a.state[3 + p.axis], cell.b.state[3 + p.axis]
    return bool(lowest(-abs(a), -abs(b), cell.slack) < margins.speed - p.limit)


@njit(**INLINED)
def _amplitude(p: AxisSpeedNumbers, speeds: Triple, margins: Margins) -> bool:
    return bool(speeds[p.axis] > p.limit - margins.speed)


@njit(**INLINED)
def _slack(p: AxisSpeedNumbers, at: Node) -> float:
    return (p.limit - abs(at.state[3 + p.axis])) / p.n


@njit(**INLINED)
def _support(p: AxisSpeedNumbers, at: Node, margins: Margins, d: FloatArray) -> float:
    d[3 + p.axis] = -1.0 if at.state[3 + p.axis] > 0.0 else 1.0
    return margins.speed - p.limit


@njit(**INLINED)
def _allowed_speed(p: AxisSpeedNumbers, at: Node) -> float:
    return p.limit


@njit
def _values(
    velocity: FloatArray, axis: int, limit: float, phi: FloatArray, h: FloatArray, gradient: FloatArray
) -> None:  # fmt: skip
    """Write phi, h and the one nonzero entry of the gradient of h for every row."""
    for i in range(velocity.shape[0]):
        speed = velocity[i, axis]
        phi[i] = limit - abs(speed)
        h[i] = limit * limit - speed * speed
        gradient[i, 3 + axis] = -2.0 * speed


class AxisSpeed(Constraint):
    """Limit on the speed along one axis of Hill's frame: h = v_lim^2 - v_i^2 [m^2/s^2], phi = v_lim - |v_i| [m/s].

    The gradient is zero at v_i = 0, where every control is allowed.

    Attributes:
        vel_limit: Largest speed v_lim along the axis [m/s].
    """

    unit: ClassVar[str] = "m/s"
    kernels: ClassVar[RowKernels | None] = RowKernels(
        broken=_broken, uncertain=_uncertain, slack=_slack, support=_support, amplitude=_amplitude,
        allowed_speed=_allowed_speed, convex=True,
    )  # fmt: skip

    vel_limit: PositiveSpeed = DEFAULTS.vel_limit
    alpha_linear: float = 0.1
    alpha_cubic: float = 0.01
    bias: float = -1e-3

    @classmethod
    @abstractmethod
    def axis_index(cls) -> int:
        """Return the index of the axis: 0 radial, 1 along track, 2 cross track."""

    @property
    def axis(self) -> int:
        """Index of the axis."""
        return self.axis_index()

    @classmethod
    def from_parameters(cls, parameters: ConstraintParameters) -> Self:
        """Build the constraint from a task's parameters."""
        return cls(vel_limit=parameters.vel_limit)

    @classmethod
    def row_numbers(cls, n: float, chosen: Mapping[str, Any]) -> AxisSpeedNumbers:
        """Return the largest speed along the axis, the index of the axis, and the mean motion."""
        name = cls.registered_name
        limit = float(chosen[name].vel_limit) if name in chosen else math.inf
        return AxisSpeedNumbers(limit, cls.axis_index(), n)

    def evaluate(self, state: RelativeState) -> ConstraintValues:
        """Return phi [m/s], h [m^2/s^2] and the derivatives of h."""
        out = ConstraintValues.zeros(len(state))
        _values(state.velocity, self.axis, self.vel_limit, out.phi, out.h, out.gradient)
        return out


class RadialSpeed(AxisSpeed, name="x_vel"):
    """Limit on the radial speed; see `AxisSpeed`."""

    @classmethod
    def axis_index(cls) -> int:
        """Return the index of the radial axis."""
        return 0


class AlongTrackSpeed(AxisSpeed, name="y_vel"):
    """Limit on the along-track speed; see `AxisSpeed`."""

    @classmethod
    def axis_index(cls) -> int:
        """Return the index of the along-track axis."""
        return 1


class CrossTrackSpeed(AxisSpeed, name="z_vel"):
    """Limit on the cross-track speed; see `AxisSpeed`."""

    @classmethod
    def axis_index(cls) -> int:
        """Return the index of the cross-track axis."""
        return 2
