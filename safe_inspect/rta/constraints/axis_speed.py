"""Bound the speed along each axis."""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar, Self

from safe_inspect.rta.constraints.base import Constraint, Evaluation, RelativeState, compiled
from safe_inspect.rta.constraints.fields import PositiveSpeed
from safe_inspect.rta.constraints.parameters import DEFAULTS, ConstraintParameters


class AxisSpeed(Constraint):
    """Bound the speed along one axis of Hill's frame: h = v_lim^2 - v_i^2 [m^2/s^2], phi = v_lim - |v_i| [m/s].

    The gradient is zero at v_i = 0, where every control is allowed.

    Attributes:
        vel_limit: Largest speed v_lim along the axis [m/s].
    """

    unit: ClassVar[str] = "m/s"

    vel_limit: PositiveSpeed = DEFAULTS.vel_limit
    alpha_linear: float = 0.1
    alpha_cubic: float = 0.01
    bias: float = -1e-3

    @property
    @abstractmethod
    def axis(self) -> int:
        """Index of the axis: 0 radial, 1 along track, 2 cross track."""

    @classmethod
    def from_parameters(cls, parameters: ConstraintParameters) -> Self:
        """Return the constraint for a task's parameters."""
        return cls(vel_limit=parameters.vel_limit)

    def evaluate(self, state: RelativeState) -> Evaluation:
        """Return phi [m/s], h [m^2/s^2] and the derivatives of h."""
        out = Evaluation.zeros(len(state))
        compiled("kernels").axis_speed(state.velocity, self.axis, self.vel_limit, out.phi, out.h, out.gradient)
        return out


class RadialSpeed(AxisSpeed, name="x_vel"):
    """Bound the radial speed; see `AxisSpeed`."""

    @property
    def axis(self) -> int:
        """The radial axis."""
        return 0


class AlongTrackSpeed(AxisSpeed, name="y_vel"):
    """Bound the along-track speed; see `AxisSpeed`."""

    @property
    def axis(self) -> int:
        """The along-track axis."""
        return 1


class CrossTrackSpeed(AxisSpeed, name="z_vel"):
    """Bound the cross-track speed; see `AxisSpeed`."""

    @property
    def axis(self) -> int:
        """The cross-track axis."""
        return 2
