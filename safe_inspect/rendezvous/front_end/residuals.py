"""Residuals of a depth frame against a known surface.

Tangents (rotation, translation) act on T_MB from the right. A point p in B is at ``x = R p + t`` in M, and the residual
along a direction n of M has the derivative ``[p x g, g]`` with ``g = R^T n``.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from safe_inspect.rendezvous.front_end.cleaning import Cloud
from safe_inspect.rendezvous.sensors.tof import DepthCamera
from safe_inspect.rendezvous.target.surface import MeshSurface, SurfacePoints, dot
from safe_inspect.types import FloatArray

#: Limit of the distance of a point in the score [m].
FAR = 0.05
#: Minimum cosine of incidence at which points count: points on a surface seen at a flatter angle are flying pixels next
#: to an edge.
_LEAST_COSINE = 0.12
#: Minimum fraction of the points that a patch must have: a few points on one are flying pixels, or belong to details
#: that the model lacks, and would alone determine how the shape may slide along the other visible patches.
_LEAST_SHARE = 0.005
#: Width of the image border that is not compared with the silhouette, and size of the cells in which parts that are
#: too close hide others [px].
_BORDER, _CELL = 2.0, 16
#: Minimum cosine of incidence at which a point of the shape should be visible.
_VISIBLE_COSINE = 0.25
#: Standard deviation of the silhouette [px], and distance to it at which Huber's weights begin to decrease [m].
_OUTLINE, _OUTLINE_CUT = 1.5, 0.02
#: Number of standard deviations of the range by which a point must be in front of all depths measured at its pixel and
#: the neighbouring ones to count as seen through.
_SEEN_THROUGH = 1.0


def _turned(matrix: FloatArray, vectors: FloatArray) -> FloatArray:
    """Return ``M^T v`` of vectors, shape (3, n), without BLAS, whose rounding depends on the processor."""
    x, y, z = vectors
    return np.asarray(matrix[0][:, None] * x + matrix[1][:, None] * y + matrix[2][:, None] * z)


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


class Residuals(NamedTuple):
    """Residuals of points along directions in B.

    Attributes:
        points: Points p in B [m], shape (n, 3).
        directions: Directions g in B, shape (n, 3); the derivatives are ``[p x g, g]``.
        values: Residuals [m], shape (n,).
        weights: Their weights [1/m^2], shape (n,).
    """

    points: FloatArray
    directions: FloatArray
    values: FloatArray
    weights: FloatArray

    def sums(self, before: FloatArray) -> FloatArray:
        """Return hessian, gradient and weighted squares as one matrix, added to another one, shape (7, 7).

        They are added one after the other: a point next to an edge is as near to one face as to the other, so that the
        last bit of a pose decides, and the order of a sum must not depend on the machine.
        """
        rows = np.column_stack([np.cross(self.points, self.directions), self.directions, self.values])
        terms = (self.weights[:, None] * rows)[:, :, None] * rows[:, None]
        return np.asarray(np.concatenate([before[None], terms]).sum(axis=0))


def surface_residuals(
    surface: MeshSurface,
    samples: SurfacePoints,
    transform: FloatArray,
    cloud: Cloud,
    noise: RangeNoise,
    *,
    coarse: bool = False,
) -> tuple[Residuals, FloatArray, int]:
    """Return the residuals of measured points against the triangles that look to the camera.

    Points on a triangle that is seen at too flat an angle, or on a patch that has too few points, do not count. The
    residuals are the height above the plane of the nearest triangle and the distance beyond its sharp edges. The
    variance along a unit vector n is ``sigma^2 (n.d)^2 + (lateral r)^2 (1 - (n.d)^2)`` with d the ray.

    Args:
        surface: The known surface.
        samples: Points on the triangles that look to the camera.
        transform: T_MB, shape (4, 4).
        cloud: The measured points.
        noise: Error model of the camera.
        coarse: Whether to find the nearest triangle approximately, see `MeshSurface.nearest`.

    Returns:
        The residuals, the distances of all points to the surface, each at most `FAR` [m], shape (n,), and the number of
        points within the cut.
    """
    if not len(samples.points):
        nothing = np.zeros((0, 3))
        return Residuals(nothing, nothing, np.zeros(0), np.zeros(0)), np.full(len(cloud), FAR), 0
    rotation = transform[:3, :3]
    positions = _turned(rotation.T, cloud.points.T) + transform[:3, 3:]
    triangles, height, beyond = surface.nearest(samples, positions, coarse=coarse)
    past = np.sqrt(dot(beyond, beyond))
    square, limit = height * height + past * past, noise.cut * noise.cut
    near, patch = square < limit, surface.patches[triangles]
    many = np.bincount(patch[near], minlength=patch.max() + 1) >= _LEAST_SHARE * len(cloud)
    normals = _turned(rotation, surface.normals[triangles].T)
    incidence = np.abs(dot(normals, cloud.rays.T))
    used = near & many[patch] & (incidence >= _LEAST_COSINE)
    sides = used & (past > 0.0)
    index = np.concatenate([np.flatnonzero(used), np.flatnonzero(sides)])
    directions = np.concatenate([normals[:, used], _turned(rotation, beyond[:, sides] / past[sides])], axis=1)
    values = np.concatenate([height[used], past[sides]])
    ranges, along = cloud.ranges[index], dot(directions, cloud.rays[index].T)
    sigma = noise.sigma0 + noise.k * ranges * ranges / incidence[index]
    variance = sigma**2 * along**2 + (noise.lateral * ranges) ** 2 * (1.0 - along**2)
    weights = (1.0 - square[index] / limit) ** 2 / variance
    found = Residuals(cloud.points[index], directions.T, values, weights)
    return found, np.minimum(np.sqrt(square), FAR), int(near.sum())


def silhouette_residuals(
    samples: SurfacePoints,
    transform: FloatArray,
    cloud: Cloud,
    camera: DepthCamera,
    mount: FloatArray,
    noise: RangeNoise,
) -> tuple[Residuals, FloatArray]:
    """Return the residuals of points that should be visible outside the silhouette, and the distances of all points.

    The residual of such a point is its distance to the border of the silhouette, perpendicular to the ray and along the
    normal of the border: if a border crosses the whole image, the shape may slide along it. Points that are too close
    to be measured are left out, and so are points next to them in the image, which may be behind them. A point in front
    of the depth measured at its pixel has no residual, but its distance counts in the score: a pose is wrong if the
    camera sees through the shape.

    Args:
        samples: Points on the surface in M that look to the camera.
        transform: T_MB, shape (4, 4).
        cloud: The measured silhouette and depths.
        camera: Geometry of the camera.
        mount: T_BC, shape (4, 4).
        noise: Error model of the camera.

    Returns:
        The residuals, and the distance of each point in view: 0 within the silhouette and not in front of the depths,
        at most `FAR` [m], shape (m,).
    """
    fx, fy, cx, cy = camera.intrinsics
    rotation, axes = transform[:3, :3], mount[:3, :3]
    points = _turned(rotation, samples.points.T - transform[:3, 3:])
    from_camera = points - mount[:3, 3:]
    distance = np.sqrt(dot(from_camera, from_camera))
    cosine = -dot(from_camera, _turned(rotation, samples.normals.T)) / distance
    seen = _turned(axes, from_camera)
    kept = np.flatnonzero((cosine >= _VISIBLE_COSINE) & (seen[2] > 0.0))
    right, down, depth = seen[:, kept]
    column, row = fx * right / depth + cx + 0.5, fy * down / depth + cy + 0.5
    # At the border of the image, half of a pixel's neighbourhood is not visible.
    inside = (column >= _BORDER) & (column < camera.width - _BORDER)
    inside &= (row >= _BORDER) & (row < camera.height - _BORDER)
    kept, column, row, depth = kept[inside], column[inside], row[inside], depth[inside]
    lost = (distance[kept] < camera.least_range + FAR) | (distance[kept] > camera.largest_range - FAR)
    hidden = np.zeros((camera.height // _CELL + 3, camera.width // _CELL + 3), np.bool_)
    cells = np.stack([row, column]).astype(np.int64) // _CELL
    for i, j in np.ndindex(3, 3):
        hidden[cells[0, lost] + i, cells[1, lost] + j] = True
    shown = ~lost & ~hidden[cells[0] + 1, cells[1] + 1]
    kept, column, row, depth = kept[shown], column[shown], row[shown], depth[shown]
    pixel, at = depth / fx, (row.astype(np.int64), column.astype(np.int64))
    near = tuple(cloud.silhouette[:, *at])
    u, v = column - (near[1] + 0.5), row - (near[0] + 0.5)
    u = np.copysign(np.maximum(np.abs(u) - 0.5, 0.0), u) * pixel
    v = np.copysign(np.maximum(np.abs(v) - 0.5, 0.0), v) * depth / fy
    up, across = cloud.outwards[:, *near]
    residual = across * u + up * v
    through = cloud.nearest[at] - depth - _SEEN_THROUGH * (noise.sigma0 + noise.k * depth * depth / cosine[kept])
    through = np.where(np.isfinite(through), np.maximum(through, 0.0), 0.0)
    is_out = residual > 0.0
    far = np.minimum(np.where(is_out, residual, through), FAR)
    weight = np.minimum(1.0, _OUTLINE_CUT / residual[is_out]) / (_OUTLINE * pixel[is_out]) ** 2
    right, down = ((column - cx - 0.5) / fx)[is_out], ((row - cy - 0.5) / fy)[is_out]
    normal = across[is_out] * (axes[:, :1] - right * axes[:, 2:]) + up[is_out] * (axes[:, 1:2] - down * axes[:, 2:])
    return Residuals(points[:, kept[is_out]].T, -normal.T, residual[is_out], weight), far
