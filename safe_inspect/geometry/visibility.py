"""Points of the chief that are seen, lit and therefore inspected: compiled, row by row.

Every row is computed separately and in one fixed order, so its result is bit-identical in a batch of any size.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from safe_inspect.compiling import njit
from safe_inspect.types import BoolArray, FloatArray, IntArray

_Vector = tuple[float, float, float]


class Surface(NamedTuple):
    """Points on a sphere, and where on it sunlight ends.

    Attributes:
        points: Points [m], shape (P, 3).
        radius: Radius of the sphere [m].
        terminator: Height towards the sun above which a point q is lit, ``q . s > terminator`` for the direction s to
            the sun [m]; see `terminator_height`.
    """

    points: FloatArray
    radius: float
    terminator: float


def terminator_height(radius: float, ray_offset: float = 0.0) -> float:
    """Return the height towards the sun above which the ray from a point to the sun does not meet the sphere [m].

    For parallel rays from the surface itself it is 0. A ray that starts `ray_offset` above the surface misses the
    sphere slightly beyond the terminator: the height is ``-R sqrt(1 - (R/(R + ray_offset))^2)``.

    Args:
        radius: Radius R of the sphere [m].
        ray_offset: Height of the start of the ray above the surface [m].
    """
    if ray_offset == 0.0:
        return 0.0
    # 1 - (R/(R + e))^2 = e (2 R + e)/(R + e)^2, which avoids the difference of nearly equal numbers
    return radius * (-math.sqrt(ray_offset * (2.0 * radius + ray_offset)) / (radius + ray_offset))


class Credit(NamedTuple):
    """Inspected points and their inspectors.

    Attributes:
        inspector: Index of the viewer that inspected a point, -1 for none, int8, shape (N, P).
        team_count: Number of inspected points, shape (N,).
        own_count: Number of points that each viewer inspected, shape (N, D).
    """

    inspector: NDArray[np.int8]
    team_count: IntArray
    own_count: IntArray


class Scores(NamedTuple):
    """Weights of the inspected points of N environments.

    Attributes:
        weights: Weight of each point [-], shape (N, P).
        team: Total weight of the inspected points [-], shape (N,).
        own: Total weight of the points that each deputy was the first to inspect [-], shape (N, D).
    """

    weights: FloatArray
    team: FloatArray
    own: FloatArray


@njit
def point_axes(points: FloatArray) -> FloatArray:
    """Return the points with shape (3, P), each axis contiguous; loops over points are then three times as fast."""
    axes = np.empty((3, points.shape[0]))
    for p in range(points.shape[0]):
        for k in range(3):
            axes[k, p] = points[p, k]
    return axes


@njit
def _sees_whole_cap(range_squared: float, radius: float, cos_half_fov: float) -> bool:
    """Return whether a field of view about the direction to the centre contains the sphere's whole outline."""
    # The outline is at asin(R/r) from the boresight: if that is inside, no point needs a separate test.
    return cos_half_fov <= -1.0 or cos_half_fov <= math.sqrt(max(0.0, 1.0 - radius * radius / range_squared))


@njit
def _in_field(vx: float, vy: float, vz: float, qx: float, qy: float, qz: float, cos_half_fov: float) -> bool:
    """Return whether the angle at the viewer v between the point q and the centre is at most the half field of view."""
    dx, dy, dz = qx - vx, qy - vy, qz - vz
    along = -(dx * vx + dy * vy + dz * vz)
    lengths = math.sqrt((dx * dx + dy * dy + dz * dz) * (vx * vx + vy * vy + vz * vz))
    return along >= cos_half_fov * lengths


@njit
def lit(sun: FloatArray, points: FloatArray, terminator: float) -> BoolArray:
    """Return which points are lit, whether a deputy sees them or not.

    Args:
        sun: Unit vectors to the sun [-], shape (R, 3).
        points: Points on the sphere [m], in the same frame, shape (P, 3).
        terminator: See `Surface`.

    Returns:
        Whether a point is lit, shape (R, P).
    """
    bright = np.empty((sun.shape[0], points.shape[0]), dtype=np.bool_)
    axes = point_axes(points)
    for row in range(sun.shape[0]):
        light_row(sun[row], axes, terminator, bright[row])
    return bright


@njit
def light_row(sun: FloatArray, axes: FloatArray, terminator: float, bright: BoolArray) -> None:
    """Write the result of `lit` for one sun, shape (3,); points as from `point_axes`."""
    qx, qy, qz = axes[0], axes[1], axes[2]
    sx, sy, sz = sun[0], sun[1], sun[2]
    for p in range(len(bright)):
        bright[p] = qx[p] * sx + qy[p] * sy + qz[p] * sz > terminator


@njit
def inspect_in_view(
    viewer: _Vector, sun: _Vector, axes: FloatArray, horizon: float, terminator: float, owner: int,
    inspector: NDArray[np.int8],
) -> None:  # fmt: skip
    """Assign each point that one viewer sees, and that is lit, to an owner unless it already has one.

    Args:
        viewer: Position relative to the body's centre [m].
        sun: Unit vector to the sun [-].
        axes: The points q [m], as given by `point_axes`.
        horizon: Radius squared: a point is seen when q . viewer is at least this [m^2].
        terminator: A point is lit when q . sun is greater than this [m]; see `Surface`.
        owner: Index of the inspector.
        inspector: Index of the inspector of each point, -1 for none, shape (P,); written.
    """
    qx, qy, qz = axes[0], axes[1], axes[2]
    (vx, vy, vz), (sx, sy, sz) = viewer, sun
    for p in range(len(inspector)):  # without a branch, so that the compiler can vectorise the loop
        faces = qx[p] * vx + qy[p] * vy + qz[p] * vz >= horizon
        shines = qx[p] * sx + qy[p] * sy + qz[p] * sz > terminator
        before = inspector[p]
        inspector[p] = np.int8(owner) if faces & shines & (before < 0) else before


@njit
def count_inspected(row: int, credit: Credit) -> None:
    """Recount the inspected points of one environment.

    Args:
        row: The environment.
        credit: Inspected points and their inspectors; read and written.
    """
    total = 0
    for d in range(credit.own_count.shape[1]):
        own = 0
        for p in range(credit.inspector.shape[1]):
            own += credit.inspector[row, p] == d
        credit.own_count[row, d] = own
        total += own
    credit.team_count[row] = total


@njit
def sum_scores(row: int, credit: Credit, scores: Scores) -> None:
    """Recompute the sums of the weights of the inspected points of one environment.

    Args:
        row: The environment.
        credit: Inspected points and their inspectors.
        scores: Weights of the inspected points; read and written.
    """
    scores.team[row] = 0.0
    scores.own[row] = 0.0
    for p in range(credit.inspector.shape[1]):
        who = credit.inspector[row, p]
        if who >= 0:
            scores.team[row] += scores.weights[row, p]
            scores.own[row, who] += scores.weights[row, p]


@njit
def inspect_body(
    position: FloatArray,
    body: int,
    sun: FloatArray,
    surface: Surface,
    cos_half_fov: float,
    active: BoolArray,
    credit: Credit,
    scores: Scores,
) -> None:
    """Assign each point that is seen and lit permanently to the first deputy that sees it, and count the points.

    A point q is above the horizon of a viewer at p when ``q . p >= R^2``, and in the field of view when the angle at
    the viewer between q and the centre, towards which it points, is at most half the field of view. A viewer inside the
    sphere sees nothing.

    Args:
        position: Positions of the bodies, the deputies first [m], shape (N, B, 3).
        body: Index of the body that carries the points.
        sun: Unit vectors to the sun [-], shape (N, 3).
        surface: The points of the body, relative to its centre.
        cos_half_fov: Cosine of half the field of view about the direction to the body [-]; -1 means no limit.
        active: Whether a deputy's sensor is working, shape (N, D).
        credit: Inspected points and their inspectors; read and written.
        scores: Weights of the inspected points; read and written.
    """
    points, radius, terminator = surface.points, surface.radius, surface.terminator
    inspector, horizon = credit.inspector, radius * radius
    axes, viewer = point_axes(points), np.empty(3)
    qx, qy, qz = axes[0], axes[1], axes[2]
    for row in range(position.shape[0]):
        sx, sy, sz = sun[row, 0], sun[row, 1], sun[row, 2]
        before = credit.team_count[row]
        for d in range(active.shape[1]):
            if not active[row, d]:
                continue
            for axis in range(3):
                viewer[axis] = position[row, d, axis] - position[row, body, axis]
            vx, vy, vz = viewer[0], viewer[1], viewer[2]
            range_squared = vx * vx + vy * vy + vz * vz
            if range_squared < horizon:
                continue
            if _sees_whole_cap(range_squared, radius, cos_half_fov):
                inspect_in_view((vx, vy, vz), (sx, sy, sz), axes, horizon, terminator, d, inspector[row])
                continue
            for p in range(points.shape[0]):
                if inspector[row, p] >= 0 or not qx[p] * vx + qy[p] * vy + qz[p] * vz >= horizon:
                    continue
                if not _in_field(vx, vy, vz, qx[p], qy[p], qz[p], cos_half_fov):
                    continue
                if qx[p] * sx + qy[p] * sy + qz[p] * sz > terminator:
                    inspector[row, p] = d
        count_inspected(row, credit)
        if credit.team_count[row] != before:
            sum_scores(row, credit, scores)


def sight_range(radius: float, field_of_view: float) -> float:
    """Return the range beyond which a camera that points at the centre has a whole sphere in view [m].

    It is ``radius / sin(field_of_view / 2)``; from there on every point above the horizon is in view.

    Args:
        radius: Radius of the sphere [m].
        field_of_view: Full angle of the camera's cone [rad].
    """
    half = field_of_view / 2.0
    return radius if half >= math.pi / 2.0 else radius / math.sin(half)
