"""Stay near the chief."""

from __future__ import annotations

from typing import ClassVar, Self

from safe_inspect.rta.constraints.base import Constraint, Evaluation, RelativeState, compiled
from safe_inspect.rta.constraints.fields import PositiveAcceleration
from safe_inspect.rta.constraints.parameters import DEFAULTS, ConstraintParameters
from safe_inspect.units import PositiveLength


class MaximumRange(Constraint, name="r_max"):
    """Stay able to stop before the largest range: h = sqrt(2 a (r_max - r)) - p.v / r, phi = r_max - r.

    Beyond the largest range the root is -sqrt(2 a |r_max - r|). The singular places are treated as those of
    `ChiefCollision`. The promised deceleration a does not count the centrifugal acceleration |v_across|^2 / r.

    Attributes:
        r_max: Largest allowed range [m].
        max_acceleration: Deceleration a that the thrusters can promise [m/s^2].
    """

    unit: ClassVar[str] = "m"

    r_max: PositiveLength = DEFAULTS.r_max
    max_acceleration: PositiveAcceleration = DEFAULTS.max_acceleration
    bias: float = -1e-3

    @classmethod
    def from_parameters(cls, parameters: ConstraintParameters) -> Self:
        """Return the constraint for a task's parameters."""
        return cls(r_max=parameters.r_max, max_acceleration=parameters.max_acceleration)

    def evaluate(self, state: RelativeState) -> Evaluation:
        """Return phi [m], h [m/s] and the derivatives of h."""
        out = Evaluation.zeros(len(state))
        compiled("kernels").range_limit(
            state.position, state.velocity, self.r_max, self.max_acceleration, -1.0,
            out.phi, out.h, out.gradient,
        )  # fmt: skip
        return out
