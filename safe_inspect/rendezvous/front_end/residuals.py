"""Residuals of a depth frame against a known surface.

Tangents (rotation, translation) act on T_MB from the right. A point p in B is at ``x = R p + t`` in M, and the residual
along a direction n of M has the derivative ``[p x g, g]`` with ``g = R^T n``. Normal equations are the sum of the
weighted products of rows ``[p x g, g, residual]``, shape (7, 7): hessian, gradient and weighted squares.

The sums are computed one term after the other: a point next to an edge is as near to one face as to the other, so that
the last bit of a pose decides, and the order of a sum must not depend on the machine.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from safe_inspect.compiling import njit
from safe_inspect.rendezvous.depth_camera import DepthCamera
from safe_inspect.rendezvous.front_end.cleaning import Cloud
from safe_inspect.rendezvous.target.surface import MeshSurface, SurfacePoints
from safe_inspect.types import BoolArray, FloatArray, IntArray

#: Limit of the distance of a point in the score [m].
FAR = 0.05
#: Minimum cosine of incidence at which points count: points on a surface seen at a flatter angle are flying pixels next
#: to an edge.
_LEAST_COSINE = 0.12
#: Minimum fraction of the points that a patch must have: a few points on one are flying pixels, or belong to details
#: that the model lacks, and would alone determine how the shape may slide along the other visible patches.
_LEAST_SHARE = 0.005
#: Width of the image border that is not compared with the silhouette, and size of the cells in which parts that are
#: too close, or seen at too flat an angle, hide others [px].
_BORDER, _CELL, _FLAT_CELL = 2.0, 16, 8
#: Minimum cosine of incidence at which a point of the shape should be visible.
_VISIBLE_COSINE = 0.25
#: Standard deviation of the silhouette [px], and distance to it at which Huber's weights begin to decrease [m].
_OUTLINE, _OUTLINE_CUT = 1.5, 0.02
#: Number of standard deviations of the range by which a point must be in front of all depths measured at its pixel and
#: the neighbouring ones to count as seen through.
_SEEN_THROUGH = 1.0

#: Three components.
_Vector = tuple[float, float, float]


class RangeNoise(NamedTuple):
    """Error model of the camera, and the treatment of outliers in a registration.

    Attributes:
        sigma0: Constant part of the standard deviation of a range [m].
        k: Coefficient of the part that grows with ``r^2 / cos(incidence)`` [1/m].
        lateral: Standard deviation perpendicular to a ray, relative to the range.
        cut: Distance from the surface at which Tukey's weights reach zero [m].
    """

    sigma0: float
    k: float
    lateral: float
    cut: float


def add_surface(
    sums: FloatArray,
    surface: MeshSurface,
    samples: SurfacePoints,
    transform: FloatArray,
    cloud: Cloud,
    noise: RangeNoise,
) -> tuple[float, int]:
    """Add the normal equations of measured points against the triangles that look to the camera.

    Points on a triangle that is seen at too flat an angle, or on a patch that has too few points, do not count. The
    residuals are the height above the plane of the nearest triangle and, at an occluding boundary, the distance beyond
    its sharp edges. Elsewhere the surface continues beyond an edge, for instance on a body that overlaps this one. The
    variance along a unit vector n is ``sigma^2 (n.d)^2 + (lateral r)^2 (1 - (n.d)^2)`` with d the ray.

    Args:
        sums: The normal equations, shape (7, 7); changed.
        surface: The known surface.
        samples: Points on the triangles that look to the camera.
        transform: T_MB, shape (4, 4).
        cloud: The measured points.
        noise: Error model of the camera.

    Returns:
        The sum of the distances of all points to the surface, each at most `FAR` [m], and the number of points within
        the cut.
    """
    if not len(samples.points):
        return FAR * len(cloud), 0
    x, y, z = cloud.points.T
    # Without BLAS, whose rounding depends on the processor.
    positions = transform[:3, :1] * x + transform[:3, 1:2] * y + transform[:3, 2:3] * z + transform[:3, 3:]
    triangles, height, beyond = surface.nearest(samples, positions)
    points = (cloud.points, cloud.rays, cloud.ranges, cloud.at_boundary)
    return _add_surface(sums, points, transform, surface.normals, surface.patches, triangles, height, beyond, noise)


@njit(error_model="numpy")
def _add_surface(
    sums: FloatArray,
    measured: tuple[FloatArray, FloatArray, FloatArray, BoolArray],
    transform: FloatArray,
    normals: FloatArray,
    patches: IntArray,
    triangles: IntArray,
    height: FloatArray,
    beyond: FloatArray,
    noise: tuple[float, float, float, float],
) -> tuple[float, int]:
    points, rays, ranges, at_boundary = measured
    sigma0, growth, lateral, cut = noise
    number, limit = len(triangles), cut * cut
    past, square, counts = np.empty(number), np.empty(number), np.zeros(patches.max() + 1)
    distance, inliers = 0.0, 0
    for k in range(number):
        past[k] = math.sqrt(beyond[0, k] ** 2 + beyond[1, k] ** 2 + beyond[2, k] ** 2)
        square[k] = height[k] * height[k] + past[k] * past[k]
        distance += min(math.sqrt(square[k]), FAR)
        if square[k] < limit:
            inliers += 1
            counts[patches[triangles[k]]] += 1
    row = np.empty(7)
    for sides in range(2):  # the heights, then the distances beyond sharp edges
        for k in range(number):
            many = counts[patches[triangles[k]]] >= _LEAST_SHARE * number
            if not many or square[k] >= limit or (sides == 1 and (past[k] == 0.0 or not at_boundary[k])):
                continue
            ray = rays[k, 0], rays[k, 1], rays[k, 2]
            of = triangles[k]
            direction = _turned(transform, normals[of, 0], normals[of, 1], normals[of, 2])
            incidence = abs(_dot(direction, ray))
            if incidence < _LEAST_COSINE:
                continue
            value = height[k]
            if sides == 1:
                value = past[k]
                direction = _turned(transform, beyond[0, k] / value, beyond[1, k] / value, beyond[2, k] / value)
            along = _dot(direction, ray)
            sigma = sigma0 + growth * ranges[k] * ranges[k] / incidence
            variance = sigma**2 * along**2 + (lateral * ranges[k]) ** 2 * (1.0 - along**2)
            weight = (1.0 - square[k] / limit) ** 2 / variance
            _add(sums, row, weight, (points[k, 0], points[k, 1], points[k, 2]), direction, value)
    return distance, inliers


def add_silhouette(
    sums: FloatArray,
    samples: SurfacePoints,
    transform: FloatArray,
    cloud: Cloud,
    camera: DepthCamera,
    mount: FloatArray,
    noise: RangeNoise,
) -> tuple[float, int]:
    """Add the normal equations of points that should be visible outside the silhouette.

    The residual of such a point is its distance to the border of the silhouette, perpendicular to the ray and along the
    normal of the border: if a border crosses the whole image, the shape may slide along it. Points that are too close
    to be measured are left out, and so are points next to them in the image, which may be behind them. Points behind a
    surface that is seen at too flat an angle to be measured do not count in the score; without their residuals, the
    shape could slide along such a surface. A point in front of the depth measured at its pixel has no residual, but its
    distance counts in the score: a pose is wrong if the camera sees through the shape.

    Args:
        sums: The normal equations, shape (7, 7); changed.
        samples: Points on the surface in M that look to the camera.
        transform: T_MB, shape (4, 4).
        cloud: The measured silhouette and depths.
        camera: Geometry of the camera.
        mount: T_BC, shape (4, 4).
        noise: Error model of the camera.

    Returns:
        The sum of the distances of the points in view, 0 within the silhouette and not in front of the depths and at
        most `FAR` [m], and the number of these points.
    """
    image = (cloud.silhouette, cloud.outwards, cloud.nearest)
    ranges = (camera.least_range + FAR, camera.largest_range - FAR)
    shape = (samples.points, samples.normals)
    return _add_silhouette(sums, shape, transform, mount, image, camera.intrinsics, ranges, noise)


@njit(error_model="numpy")
def _add_silhouette(
    sums: FloatArray,
    samples: tuple[FloatArray, FloatArray],
    transform: FloatArray,
    mount: FloatArray,
    image: tuple[IntArray, FloatArray, FloatArray],
    intrinsics: tuple[float, float, float, float],
    ranges: tuple[float, float],
    noise: tuple[float, float, float, float],
) -> tuple[float, int]:
    places, normals = samples
    silhouette, outwards, nearest = image
    height, width = nearest.shape
    fx, fy, cx, cy = intrinsics
    points, pixels, kept = np.empty((len(places), 3)), np.empty((len(places), 4)), np.empty(len(places), np.bool_)
    hidden = np.zeros((height // _CELL + 3, width // _CELL + 3), np.bool_)
    # Depth of the nearest surface, in a cell or next to it, that is seen at too flat an angle.
    flat = np.full((height // _FLAT_CELL + 3, width // _FLAT_CELL + 3), np.inf)
    for k in range(len(places)):
        x, y, z = places[k, 0] - transform[0, 3], places[k, 1] - transform[1, 3], places[k, 2] - transform[2, 3]
        point = _turned(transform, x, y, z)
        from_camera = point[0] - mount[0, 3], point[1] - mount[1, 3], point[2] - mount[2, 3]
        distance = math.sqrt(_dot(from_camera, from_camera))
        normal = _turned(transform, normals[k, 0], normals[k, 1], normals[k, 2])
        cosine = -_dot(from_camera, normal) / distance
        right, down, depth = _turned(mount, from_camera[0], from_camera[1], from_camera[2])
        column, row = fx * right / depth + cx + 0.5, fy * down / depth + cy + 0.5
        # At the border of the image, half of a pixel's neighbourhood is not visible.
        inside = _BORDER <= column < width - _BORDER and _BORDER <= row < height - _BORDER
        if inside and depth > 0.0 and cosine < _LEAST_COSINE:
            i, j = int(row) // _FLAT_CELL, int(column) // _FLAT_CELL
            flat[i : i + 3, j : j + 3] = np.minimum(flat[i : i + 3, j : j + 3], depth)
        kept[k] = cosine >= _VISIBLE_COSINE and depth > 0.0 and inside
        if kept[k] and (distance < ranges[0] or distance > ranges[1]):
            kept[k] = False
            i, j = int(row) // _CELL, int(column) // _CELL
            hidden[i : i + 3, j : j + 3] = True
        points[k, 0], points[k, 1], points[k, 2] = point
        pixels[k, 0], pixels[k, 1], pixels[k, 2], pixels[k, 3] = column, row, depth, cosine
    far, number, terms = 0.0, 0, np.empty(7)
    for k in range(len(places)):
        column, row, depth, cosine = pixels[k, 0], pixels[k, 1], pixels[k, 2], pixels[k, 3]
        if not kept[k] or hidden[int(row) // _CELL + 1, int(column) // _CELL + 1]:
            continue
        i, j = int(row), int(column)
        counts = depth <= flat[i // _FLAT_CELL + 1, j // _FLAT_CELL + 1] + FAR
        number += counts
        near_i, near_j = silhouette[0, i, j], silhouette[1, i, j]
        u, v = column - (near_j + 0.5), row - (near_i + 0.5)
        u = math.copysign(max(abs(u) - 0.5, 0.0), u) * (depth / fx)
        v = math.copysign(max(abs(v) - 0.5, 0.0), v) * depth / fy
        up, across = outwards[0, near_i, near_j], outwards[1, near_i, near_j]
        residual = across * u + up * v
        if residual <= 0.0:
            through = nearest[i, j] - depth - _SEEN_THROUGH * (noise[0] + noise[1] * depth * depth / cosine)
            far += min(max(through, 0.0), FAR) if counts and math.isfinite(through) else 0.0
            continue
        far += min(residual, FAR) if counts else 0.0
        weight = min(1.0, _OUTLINE_CUT / residual) / (_OUTLINE * (depth / fx)) ** 2
        right, down = (column - cx - 0.5) / fx, (row - cy - 0.5) / fy
        direction = (
            -(across * (mount[0, 0] - right * mount[0, 2]) + up * (mount[0, 1] - down * mount[0, 2])),
            -(across * (mount[1, 0] - right * mount[1, 2]) + up * (mount[1, 1] - down * mount[1, 2])),
            -(across * (mount[2, 0] - right * mount[2, 2]) + up * (mount[2, 1] - down * mount[2, 2])),
        )
        _add(sums, terms, weight, (points[k, 0], points[k, 1], points[k, 2]), direction, residual)
    return far, number


@njit
def _turned(rotation: FloatArray, x: float, y: float, z: float) -> _Vector:
    """Return ``R^T v``."""
    return (
        rotation[0, 0] * x + rotation[1, 0] * y + rotation[2, 0] * z,
        rotation[0, 1] * x + rotation[1, 1] * y + rotation[2, 1] * z,
        rotation[0, 2] * x + rotation[1, 2] * y + rotation[2, 2] * z,
    )


@njit
def _dot(first: _Vector, second: _Vector) -> float:
    return first[0] * second[0] + first[1] * second[1] + first[2] * second[2]


@njit
def _add(sums: FloatArray, row: FloatArray, weight: float, p: _Vector, g: _Vector, value: float) -> None:
    """Add the weighted products of the row ``[p x g, g, value]``, which is written to `row`."""
    row[0], row[1], row[2] = p[1] * g[2] - p[2] * g[1], p[2] * g[0] - p[0] * g[2], p[0] * g[1] - p[1] * g[0]
    row[3], row[4], row[5], row[6] = g[0], g[1], g[2], value
    for i in range(7):
        for j in range(7):
            sums[i, j] += weight * row[i] * row[j]
