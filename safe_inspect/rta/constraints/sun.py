"""Constraint that keeps the sun out of the camera."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, ClassVar, Self

from safe_inspect.compiling import njit
from safe_inspect.rta.constraints.base import Constraint, ConstraintValues, RelativeState
from safe_inspect.rta.constraints.parameters import DEFAULTS, ConstraintParameters
from safe_inspect.rta.constraints.range_limit import LENGTH_FLOOR, braking_speed
from safe_inspect.rta.constraints.rows import RowKernels
from safe_inspect.rta.constraints.sun_rows import SUN_KERNELS, SunNumbers
from safe_inspect.rta.fields import ConeAngle, PositiveAcceleration
from safe_inspect.types import FloatArray
from safe_inspect.units import PositiveAngularRate


@njit
def _values(
    state: tuple[FloatArray, FloatArray, FloatArray], half_angle: float, acceleration: float, n: float,
    phi: FloatArray, h: FloatArray, gradient: FloatArray, rate: FloatArray,
) -> None:  # fmt: skip
    """Write phi, h, the gradient and the rate of h for every row.

    All quantities are in the right-handed axes (c, k, z): c points away from the sun, and k is in the orbital plane.
    The angular velocity of these axes is (0, 0, -n), and w x (a, b, .) = (n b, -n a, 0).
    """
    position, velocity, sun_angle = state
    cos_b, sin_b = math.cos(half_angle), math.sin(half_angle)
    for i in range(position.shape[0]):
        cos_s, sin_s = math.cos(sun_angle[i]), math.sin(sun_angle[i])
        x, y, z = position[i]
        vx, vy, vz = velocity[i]
        pc, pk = sin_s * y - cos_s * x, -sin_s * x - cos_s * y
        vc, vk = sin_s * vy - cos_s * vx, -sin_s * vx - cos_s * vy
        off_axis = math.sqrt(pk * pk + z * z)
        ek, ez, turning = 0.0, 1.0, 0.0
        if not off_axis < LENGTH_FLOOR:
            ek, ez, turning = pk / off_axis, z / off_axis, cos_b / off_axis
        # The outward normal of the cone near the position, and the distance along it.
        nc, nk, nz = -sin_b, cos_b * ek, cos_b * ez
        gap = cos_b * off_axis - sin_b * pc
        # The velocity relative to the rotating cone.
        uc, uk = vc - n * pk, vk + n * pc
        around = turning * (ek * vz - ez * uk)
        root, slope = braking_speed(gap, acceleration)
        phi[i] = math.atan2(off_axis, pc) - half_angle
        h[i] = root + nc * uc + nk * uk + nz * vz
        gc = slope * nc + n * nk
        gk = slope * nk - around * ez - n * nc
        gradient[i, 0] = -cos_s * gc - sin_s * gk
        gradient[i, 1] = sin_s * gc - cos_s * gk
        gradient[i, 2] = slope * nz + around * ek
        gradient[i, 3] = -cos_s * nc - sin_s * nk
        gradient[i, 4] = sin_s * nc - cos_s * nk
        gradient[i, 5] = nz
        # Rotating the position, the velocity and the sun together does not change h.
        rate[i] = -n * (gc * pk - gk * pc + nc * vk - nk * vc)


class SunKeepOut(Constraint, name="sun"):
    """Constraint that keeps the deputy out of the cone from which the chief is seen against the sun.

    Seen from the chief, the sun is in the direction s = (cos theta, -sin theta, 0). The deputy at p looks along -p,
    towards the chief. The sun is in a camera of full field of view `fov` when -p is within beta = fov / 2 of s, that
    is, when p is within beta of c = -s. The forbidden cone therefore has its apex at the chief, opens away from the sun
    and lies entirely in the half space p.s < 0: the night side, where the chief is between the deputy and the sun. On
    the day side, p.s > 0, the sun is behind the deputy and every position is allowed.

    phi = angle(p, c) - beta [rad].

    h = sqrt(2 a d) + d', where d is the signed distance from the cone's nearer generator, and d' is the rate at which
    the deputy leaves the cone, which rotates with the sun at w = (0, 0, -n):

        d = r sin(angle(p, c) - beta),   d' = N.(v - w x p),   N = (p - q) / d,

    where q is the foot of the perpendicular on the generator (w x q gives the same d', because N is parallel to p - q).
    Inside the cone, d is negative and the root is -sqrt(2 a |d|). Where angle(p, c) > beta + 90 deg, the generator is
    extended beyond the apex: there, d is less than the distance from the cone, and zero only at the chief.

    Within 1e-6 m of the cone's axis, in front of or behind the chief, the nearest generator is not unique; the one
    towards +z is used. At the chief's centre, phi = -beta. The slope of the root at d = 0 is the slope at 1e-6 m.

    Attributes:
        fov: Full opening angle of the cone, 2 beta [rad].
        max_acceleration: Deceleration a that the thrusters guarantee [m/s^2].
        mean_motion: Rate n of the sun angle theta [rad/s].
    """

    unit: ClassVar[str] = "rad"
    kernels: ClassVar[RowKernels | None] = SUN_KERNELS
    uncertified: ClassVar[frozenset[str]] = Constraint.uncertified | {"mean_motion"}

    fov: ConeAngle = math.pi / 3.0
    max_acceleration: PositiveAcceleration = DEFAULTS.max_acceleration
    mean_motion: PositiveAngularRate = DEFAULTS.n
    alpha_linear: float = 0.001
    alpha_cubic: float = 0.0001
    bias: float = -1e-3

    @classmethod
    def from_parameters(cls, parameters: ConstraintParameters) -> Self:
        """Build the constraint from a task's parameters."""
        return cls(fov=parameters.fov, max_acceleration=parameters.max_acceleration, mean_motion=parameters.n)

    @classmethod
    def row_numbers(cls, n: float, chosen: Mapping[str, Any]) -> SunNumbers:
        """Return whether the cone is forbidden, cosine and sine of its half angle, and the mean motion."""
        half = 0.5 * chosen["sun"].fov if "sun" in chosen else 0.0
        return SunNumbers("sun" in chosen, math.cos(half), math.sin(half), n)

    def evaluate(self, state: RelativeState) -> ConstraintValues:
        """Return phi [rad], h [m/s] and the derivatives of h."""
        out = ConstraintValues.zeros(len(state))
        _values(
            (state.position, state.velocity, state.sun_angle), 0.5 * self.fov, self.max_acceleration, self.mean_motion,
            out.phi, out.h, out.gradient, out.rate,
        )  # fmt: skip
        return out
