"""Keep the sun out of the camera."""

from __future__ import annotations

import math
from typing import ClassVar, Self

from safe_inspect.rta.constraints.base import Constraint, Evaluation, RelativeState, compiled
from safe_inspect.rta.constraints.fields import FieldOfView, PositiveAcceleration
from safe_inspect.rta.constraints.parameters import DEFAULTS, ConstraintParameters
from safe_inspect.units import PositiveAngularRate


class SunKeepOut(Constraint, name="sun"):
    """Stay out of the cone from which the chief is seen against the sun.

    The sun stands in the direction s = (cos theta, -sin theta, 0) from the chief. The deputy at p looks along -p,
    at the chief. The sun is in a camera of full field of view `fov` when -p is within beta = fov / 2 of s, that is
    when p is within beta of c = -s. So the forbidden cone has its apex at the chief and opens away from the sun, all
    of it in the half space p.s < 0: the night side, where the chief stands between the deputy and the sun. On the
    day side, p.s > 0, the deputy has the sun behind it and every position is allowed.

    phi = angle(p, c) - beta [rad].

    h = sqrt(2 a d) + d', with d the signed distance from the cone's nearer generator, and d' the rate at which the
    deputy leaves the cone, which turns with the sun at w = (0, 0, -n):

        d = r sin(angle(p, c) - beta),   d' = N.(v - w x p),   N = (p - q) / d,

    q the foot of the perpendicular on the generator (w x q gives the same d', for N is parallel to p - q). Inside,
    d is negative and the root is -sqrt(2 a |d|). Where angle(p, c) > beta + 90 deg the generator is extended beyond
    the apex: there d is less than the distance from the cone, and zero only at the chief.

    On the cone's axis, before and behind the chief (within 1e-6 m), the nearest generator is not unique; the one
    towards +z is taken. At the chief's centre phi = -beta. The root's slope at d = 0 is that at 1e-6 m.

    Attributes:
        fov: Full opening angle of the cone, 2 beta [rad].
        max_acceleration: Deceleration a that the thrusters can promise [m/s^2].
        mean_motion: Rate n of the sun angle theta [rad/s].
    """

    unit: ClassVar[str] = "rad"

    fov: FieldOfView = math.pi / 3.0
    max_acceleration: PositiveAcceleration = DEFAULTS.max_acceleration
    mean_motion: PositiveAngularRate = DEFAULTS.n
    alpha_linear: float = 0.001
    alpha_cubic: float = 0.0001
    bias: float = -1e-3

    @classmethod
    def from_parameters(cls, parameters: ConstraintParameters) -> Self:
        """Return the constraint for a task's parameters."""
        return cls(fov=parameters.fov, max_acceleration=parameters.max_acceleration, mean_motion=parameters.n)

    def evaluate(self, state: RelativeState) -> Evaluation:
        """Return phi [rad], h [m/s] and the derivatives of h."""
        out = Evaluation.zeros(len(state))
        compiled("kernels").sun_cone(
            state.position, state.velocity, state.sun_angle, 0.5 * self.fov, self.max_acceleration, self.mean_motion,
            out.phi, out.h, out.gradient, out.rate,
        )  # fmt: skip
        return out
