"""Constraint that keeps the sun out of the camera: `SunKeepOut`, below its row kernels for the compiled filters."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, ClassVar, NamedTuple

from safe_inspect.compiling import njit
from safe_inspect.rta.constraints.base import Constraint, ConstraintValues, RelativeState
from safe_inspect.rta.constraints.parameters import DEFAULTS
from safe_inspect.rta.constraints.rows import (
    INLINED,
    LENGTH_FLOOR,
    ArcCell,
    ClosedCell,
    Margins,
    Node,
    RowKernels,
    StateArrays,
    SunAngle,
    braking_speed,
    direction,
    lowest,
    sun_axes,
)
from safe_inspect.types import FloatArray
from safe_inspect.units import ConeAngle, PositiveAcceleration, PositiveAngularRate


class SunNumbers(NamedTuple):
    """Numbers of the sun cone: whether it is forbidden, cosine and sine of its half angle, mean motion [1/s]."""

    on: bool
    cos_b: float
    sin_b: float
    n: float


@njit(**INLINED)
def _distance(p: SunNumbers, along: float, across: float, z: float) -> float:
    """Return the signed distance from the cone [m]; not negative outside it."""
    return p.cos_b * math.sqrt(across * across + z * z) - p.sin_b * along


@njit(**INLINED)
def _broken(p: SunNumbers, at: Any, margins: Margins) -> bool:
    return bool(p.on and _distance(p, at.along, at.across, at.state[2]) < margins.length)


@njit(**INLINED)
def _slack(p: SunNumbers, at: Node) -> float:
    return _distance(p, at.along, at.across, at.state[2]) if p.on else math.inf


@njit(**INLINED)
def _uncertain(p: SunNumbers, cell: ArcCell, margins: Margins) -> bool:
    if not p.on:
        return False
    a, b, n, sin_b = cell.a, cell.b, p.n, p.sin_b
    za, zb = a.state[2], b.state[2]
    ek, ez = a.across + b.across, za + zb
    size = math.sqrt(ek * ek + ez * ez)
    if size > 0.0:
        ek, ez = ek / size, ez / size
    else:
        ek, ez = 0.0, 1.0
    nk, nz = p.cos_b * ek, p.cos_b * ez
    ga, gb = nk * a.across + nz * za - sin_b * a.along, nk * b.across + nz * zb - sin_b * b.along
    # Accelerations in the frame that rotates with the sun.
    (ax, ay, az), (bx, by, bz) = cell.acceleration_a, cell.acceleration_b
    (ca, sa), (cb, sb) = a.sun, b.sun
    vca, vka = sun_axes(a.sun, a.state[3], a.state[4])
    vcb, vkb = sun_axes(b.sun, b.state[3], b.state[4])
    aca, aka = sa * ay - ca * ax - n * (2.0 * vka + n * a.along), -sa * ax - ca * ay + n * (2.0 * vca - n * a.across)
    acb, akb = sb * by - cb * bx - n * (2.0 * vkb + n * b.along), -sb * bx - cb * by + n * (2.0 * vcb - n * b.across)
    curve = max(nk * aka + nz * az - sin_b * aca, nk * akb + nz * bz - sin_b * acb)
    dip = max(0.0, cell.eighth * curve + cell.k * cell.k * (24.0 * cell.reach / n + cell.farthest))
    return bool(lowest(ga, gb, dip) < margins.length)


@njit(**INLINED)
def _closed_uncertain(p: SunNumbers, cell: ClosedCell, margins: Margins) -> bool:
    if not p.on:
        return False
    a, b, k, rho = cell.a, cell.b, cell.k, cell.rho
    za, zb = a.state[2], b.state[2]
    ek, ez = a.across + b.across, za + zb
    size = math.sqrt(ek * ek + ez * ez)
    if size > 0.0:
        size = p.cos_b / size
        ek, ez = size * ek, size * ez
    else:
        ek, ez = 0.0, p.cos_b
    ga, gb = ek * a.across + ez * za - p.sin_b * a.along, ek * b.across + ez * zb - p.sin_b * b.along
    # In the rotating frame, the second derivative is at most 3 rho + r, and the fourth at most 15 rho + r.
    if min(ga, gb) - k * (3.0 * rho + cell.farthest) >= margins.length:
        return False
    curve = max(_bend(p, a, cell.centre, ek, ez), _bend(p, b, cell.centre, ek, ez))
    dip = max(0.0, k * curve + k * k * (15.0 * rho + cell.farthest))
    return bool(lowest(ga, gb, dip) < margins.length)


@njit(**INLINED)
def _bend(p: SunNumbers, at: Node, centre: float, nk: float, nz: float) -> float:
    """Return the second derivative of N.q at a node, where q is the position in the frame that rotates with the sun."""
    ox, oy = at.state[0], at.state[1] - centre
    ca, sa = at.sun
    vc, vk = sun_axes(at.sun, 0.5 * oy, -2.0 * ox)
    bend_c, bend_k = ca * ox - sa * oy - 2.0 * vk - at.along, sa * ox + ca * oy + 2.0 * vc - at.across
    return float(nk * bend_k - nz * at.state[2] - p.sin_b * bend_c)


@njit(**INLINED)
def _support(p: SunNumbers, at: Node, margins: Margins, d: FloatArray) -> float:
    ca, sa = at.sun
    _, ek, ez = direction((0.0, at.across, at.state[2]))
    if ek == 0.0 and ez == 0.0:
        ez = 1.0
    ek, ez = p.cos_b * ek, p.cos_b * ez
    d[0], d[1], d[2] = p.sin_b * ca - ek * sa, -p.sin_b * sa - ek * ca, ez
    return margins.length


@njit(**INLINED)
def _turn(p: SunNumbers, sun: SunAngle, d: FloatArray) -> None:
    """Write into d[0] and d[1] how the cone's normal, a direction d of velocities, rotates with the sun."""
    ca, sa = sun
    along, across = sun_axes(sun, d[3], d[4])
    d[0], d[1] = p.n * (along * sa - across * ca), p.n * (along * ca + across * sa)


SUN_KERNELS = RowKernels(
    broken=_broken, uncertain=_uncertain, slack=_slack, support=_support, gap=_slack, turn=_turn,
    closed_broken=_broken, closed_uncertain=_closed_uncertain, cost=2,
)  # fmt: skip


@njit
def _values(
    state: StateArrays, half_angle: float, acceleration: float, n: float,
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
        pc, pk = sun_axes((cos_s, sin_s), x, y)
        vc, vk = sun_axes((cos_s, sin_s), vx, vy)
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

    phi = angle(p, c) - beta [rad], at least 0 outside of the cone; `Constraint` says which filters guarantee that.

    h = sqrt(2 a d) + d', where d is the signed distance from the cone's nearer generator, and d' is the rate at which
    the deputy leaves the cone, which rotates with the sun at w = (0, 0, -n):

        d = r sin(angle(p, c) - beta),   d' = N.(v - w x p),   N = (p - q) / d,

    where q is the foot of the perpendicular on the generator (w x q gives the same d', because N is parallel to p - q).
    Inside the cone, d is negative and the root is -sqrt(2 a |d|). Where angle(p, c) > beta + 90 deg, the generator is
    extended beyond the apex: there, d is less than the distance from the cone, and zero only at the chief.

    Within 1e-6 m of the cone's axis, in front of or behind the chief, the nearest generator is not unique; the one
    towards +z is used. At the chief's centre, phi = -beta. The slope of the root at d = 0 is the slope at 1e-6 m.

    Attributes:
        fov: Full opening angle of the cone, 2 beta [rad]; 60 deg by default.
        max_acceleration: Deceleration a that the thrusters can give [m/s^2]; by default 0.0787, that of 1 N and 12 kg
            less the largest tide and Coriolis acceleration (`ConstraintParameters.net_acceleration`).
        mean_motion: Rate n of the sun angle theta [rad/s].
    """

    unit: ClassVar[str] = "rad"
    from_task: ClassVar[Mapping[str, str]] = {
        "fov": "fov", "max_acceleration": "max_acceleration", "mean_motion": "n",
    }  # fmt: skip
    kernels: ClassVar[RowKernels | None] = SUN_KERNELS
    uncertified: ClassVar[frozenset[str]] = Constraint.uncertified | {"mean_motion"}

    fov: ConeAngle = math.pi / 3.0
    max_acceleration: PositiveAcceleration = DEFAULTS.max_acceleration
    mean_motion: PositiveAngularRate = DEFAULTS.n
    alpha_linear: float = 0.001
    alpha_cubic: float = 0.0001
    bias: float = -1e-3

    @classmethod
    def row_numbers(cls, n: float, chosen: Mapping[str, Any]) -> SunNumbers:
        """Return whether the cone is forbidden, cosine and sine of its half angle, and the mean motion."""
        half = 0.5 * chosen["sun"].fov if "sun" in chosen else 0.0
        return SunNumbers("sun" in chosen, math.cos(half), math.sin(half), n)

    def evaluate(self, state: RelativeState) -> ConstraintValues:
        """Return phi [rad], h [m/s] and the derivatives of h."""
        return ConstraintValues.computed(_values, state, 0.5 * self.fov, self.max_acceleration, self.mean_motion)
