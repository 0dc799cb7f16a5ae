"""Keep off the chief."""

from __future__ import annotations

from typing import ClassVar, Self

from safe_inspect.rta.constraints.base import Constraint, Evaluation, RelativeState, compiled
from safe_inspect.rta.constraints.fields import PositiveAcceleration
from safe_inspect.rta.constraints.parameters import DEFAULTS, ConstraintParameters
from safe_inspect.units import PositiveLength


class ChiefCollision(Constraint, name="chief_collision"):
    """Stay able to brake before the chief: h = sqrt(2 a (r - r_c)) + p.v / r, phi = r - r_c.

    h [m/s] compares the speed that can be braked within the gap with the closing speed. Inside the collision radius the
    root is -sqrt(2 a |r - r_c|), so that h keeps its sense there.

    Within 1e-6 m of the chief's centre the direction p / r is taken as +x. Within 1e-6 m of the collision radius
    the root's slope, which is infinite on it, is that at 1e-6 m.

    Attributes:
        collision_radius: Smallest allowed range r_c [m].
        max_acceleration: Deceleration a that the thrusters can promise [m/s^2].
    """

    unit: ClassVar[str] = "m"

    collision_radius: PositiveLength = DEFAULTS.collision_radius
    max_acceleration: PositiveAcceleration = DEFAULTS.max_acceleration

    @classmethod
    def from_parameters(cls, parameters: ConstraintParameters) -> Self:
        """Return the constraint for a task's parameters."""
        return cls(collision_radius=parameters.collision_radius, max_acceleration=parameters.max_acceleration)

    def evaluate(self, state: RelativeState) -> Evaluation:
        """Return phi [m], h [m/s] and the derivatives of h."""
        out = Evaluation.zeros(len(state))
        compiled("kernels").range_limit(
            state.position, state.velocity, self.collision_radius, self.max_acceleration, 1.0,
            out.phi, out.h, out.gradient,
        )  # fmt: skip
        return out
