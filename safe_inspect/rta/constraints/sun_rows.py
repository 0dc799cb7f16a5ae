"""Row kernels of the sun cone for the compiled filters; see `RowKernels`."""

from __future__ import annotations

import math
from typing import NamedTuple

from safe_inspect.compiling import njit
from safe_inspect.rta.constraints.rows import (
    INLINED,
    ArcCell,
    ClosedCell,
    ClosedNode,
    Margins,
    Node,
    RowKernels,
    SunAngle,
    direction,
    lowest,
    sun_axes,
)
from safe_inspect.types import FloatArray


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
def _broken(p: SunNumbers, at: Node, margins: Margins) -> bool:
    return bool(p.on and _distance(p, at.along, at.across, at.state[2]) < margins.length)


@njit(**INLINED)
def _closed_broken(p: SunNumbers, at: ClosedNode, margins: Margins) -> bool:
    return bool(p.on and _distance(p, at.along, at.across, at.position[2]) < margins.length)


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
    za, zb = a.position[2], b.position[2]
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
def _bend(p: SunNumbers, at: ClosedNode, centre: float, nk: float, nz: float) -> float:
    """Return the second derivative of N.q at a node, where q is the position in the frame that rotates with the sun."""
    ox, oy = at.position[0], at.position[1] - centre
    ca, sa = at.sun
    vc, vk = sun_axes(at.sun, 0.5 * oy, -2.0 * ox)
    bend_c, bend_k = ca * ox - sa * oy - 2.0 * vk - at.along, sa * ox + ca * oy + 2.0 * vc - at.across
    return nk * bend_k - nz * at.position[2] - p.sin_b * bend_c


@njit(**INLINED)
def _support(p: SunNumbers, at: Node, margins: Margins, d: FloatArray) -> float:
    ca, sa = at.sun
    _, ek, ez = direction(0.0, at.across, at.state[2])
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
    closed_broken=_closed_broken, closed_uncertain=_closed_uncertain, cost=2,
)  # fmt: skip
