"""Fly slower the nearer the chief."""

from __future__ import annotations

from typing import ClassVar, Self

from pydantic import Field

from safe_inspect.rta.constraints.base import Constraint, Evaluation, RelativeState, compiled
from safe_inspect.rta.constraints.fields import SpeedSlope
from safe_inspect.rta.constraints.parameters import DEFAULTS, ConstraintParameters
from safe_inspect.units import NonNegativeLength, NonNegativeSpeed


class RelativeSpeedLimit(Constraint, name="rel_vel"):
    """Bound the speed by a line over the range: h = v0 + v1 (r - d0) - speed.

    phi is the same with plain norms. In h both norms are sqrt(|.|^2 + smoothing), so that the gradient exists, and
    is zero, at rest and at the chief's centre; it counts a deputy at rest as moving at 3.2 mm/s, and one at 0.2 m/s
    as 0.025 mm/s faster.

    Attributes:
        v0: Speed that is allowed at `v0_distance` [m/s].
        v0_distance: Range d0 at which the speed `v0` is allowed [m].
        v1: Slope of the limit over the range [1/s].
        smoothing: What is added under the square roots of h [m^2 or m^2/s^2].
    """

    unit: ClassVar[str] = "m/s"

    v0: NonNegativeSpeed = DEFAULTS.v0
    v0_distance: NonNegativeLength = DEFAULTS.speed_distance
    v1: SpeedSlope = DEFAULTS.v1
    smoothing: float = Field(default=1e-5, gt=0.0, allow_inf_nan=False)
    alpha_linear: float = 0.05
    alpha_cubic: float = 0.005
    bias: float = -1e-3

    @classmethod
    def from_parameters(cls, parameters: ConstraintParameters) -> Self:
        """Return the constraint for a task's parameters."""
        return cls(v0=parameters.v0, v0_distance=parameters.speed_distance, v1=parameters.v1)

    def evaluate(self, state: RelativeState) -> Evaluation:
        """Return phi [m/s], h [m/s] and the derivatives of h."""
        out = Evaluation.zeros(len(state))
        compiled("kernels").relative_speed(
            state.position, state.velocity, self.v0, self.v0_distance, self.v1, self.smoothing,
            out.phi, out.h, out.gradient,
        )  # fmt: skip
        return out
