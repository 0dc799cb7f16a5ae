"""Stay safe when the thrusters fail."""

from __future__ import annotations

from typing import ClassVar, Self

from safe_inspect.rta.constraints.base import Constraint, Evaluation, RelativeState, compiled
from safe_inspect.rta.constraints.parameters import DEFAULTS, ConstraintParameters
from safe_inspect.units import PositiveAngularRate, PositiveDuration, PositiveLength


class PassivelySafeManoeuvre(Constraint, name="PSM"):
    """Coast past the chief: h = phi = (least range over the horizon without thrust) - r_c [m].

    The least range is that over all times 0 <= t <= horizon of the closed-form Clohessy-Wiltshire motion: the closest
    approaches are bracketed on a grid of at most 0.1 rad of the orbit and refined by Newton's method, so the horizon
    may be whole orbits. By the envelope theorem the gradient is that of the range at the time of closest approach,

        dh/dx0 = Phi(t*)^T (p(t*) / |p(t*)|, 0).

    Where two approaches are equally close, h has a kink and the gradient is that of the earlier. Where coasting hits
    the chief's centre (within 1e-6 m), the direction is one across the path there: the way to miss.
    A closest approach at t = 0 gives a gradient that thrust cannot change; the deputy is then leaving.

    Attributes:
        collision_radius: Smallest allowed range r_c [m].
        mean_motion: Mean motion n [rad/s].
        horizon: Time of coasting [s].
    """

    unit: ClassVar[str] = "m"

    collision_radius: PositiveLength = DEFAULTS.collision_radius
    mean_motion: PositiveAngularRate = DEFAULTS.n
    horizon: PositiveDuration = DEFAULTS.psm_horizon

    @classmethod
    def from_parameters(cls, parameters: ConstraintParameters) -> Self:
        """Return the constraint for a task's parameters."""
        return cls(
            collision_radius=parameters.collision_radius, mean_motion=parameters.n, horizon=parameters.psm_horizon
        )

    def evaluate(self, state: RelativeState) -> Evaluation:
        """Return phi [m], h [m] and the derivatives of h."""
        out = Evaluation.zeros(len(state))
        coasting = compiled("coasting")
        coasting.passive_safety(
            state.position, state.velocity, coasting.grid(self.mean_motion, self.horizon), self.mean_motion,
            self.collision_radius, out.phi, out.h, out.gradient,
        )  # fmt: skip
        return out
