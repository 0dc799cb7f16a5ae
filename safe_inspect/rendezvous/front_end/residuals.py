"""Residuals of a depth frame against the faces of a known shape.

Tangents (rotation, translation) act on T_MB from the right. A point p in B is at ``x = R p + t`` in M, and the residual
along a direction n of M has the derivative ``[p x g, g]`` with ``g = R^T n``.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from safe_inspect.rendezvous.front_end.cleaning import Cloud
from safe_inspect.rendezvous.front_end.faces import Faces, RangeNoise, SurfacePoints
from safe_inspect.rendezvous.sensors.tof import DepthCamera
from safe_inspect.types import BoolArray, FloatArray, IntArray

#: Limit of the distance of a point in the score [m].
FAR = 0.05
#: Minimum cosine of incidence at which the points of a face count: points on a face seen at a flatter angle are flying
#: pixels next to an edge.
_LEAST_COSINE = 0.12
#: Minimum fraction of the points that a face must have: a few points on a face are flying pixels, or belong to details
#: that the model lacks, and would alone determine how the shape may slide along the other visible faces.
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
    """Return ``M^T v`` of vectors, shape (3, ...), without BLAS, whose rounding depends on the processor."""
    x, y, z = vectors
    rows = matrix.reshape(3, 3, *([1] * x.ndim))
    return np.asarray(rows[0] * x + rows[1] * y + rows[2] * z)


def _dot(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return the dot products of vectors, shape (3, ...)."""
    return np.asarray(first[0] * second[0] + first[1] * second[1] + first[2] * second[2])


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


def nearest_faces(faces: Faces, visible: BoolArray, positions: FloatArray) -> tuple[IntArray, FloatArray]:
    """Return the visible face nearest to each position, and the position relative to it.

    Args:
        faces: The faces in M.
        visible: Mask of the faces that look to the camera, shape (F,); at least one.
        positions: Positions in M [m], shape (3, n).

    Returns:
        Indices of the faces, shape (n,), and the height above the face and the signed distances beyond its two pairs of
        sides, 0 within the rectangle [m], shape (3, n).
    """
    shown = np.flatnonzero(visible)
    axes = faces.axes[shown].transpose(2, 1, 0)[..., None]
    x, y, z = positions[:, None] - faces.centre[shown].T[..., None]
    found = axes[0] * x + axes[1] * y + axes[2] * z  # direction, face, position
    beyond = np.maximum(np.abs(found[1:]) - faces.half_size[shown].T[..., None], 0.0)
    found[1:] = np.copysign(beyond, found[1:])
    nearest = _dot(found, found).argmin(axis=0)
    return shown[nearest], found[:, nearest, np.arange(len(nearest))]


def face_residuals(
    faces: Faces, visible: BoolArray, transform: FloatArray, cloud: Cloud, noise: RangeNoise
) -> tuple[Residuals, FloatArray, int]:
    """Return the residuals of measured points against the visible faces.

    Points on a face that is seen at too flat an angle, or that has too few points, do not count. The residuals are the
    height above the plane of the face and the distances beyond its sides. The variance along a unit vector n is
    ``sigma^2 (n.d)^2 + (lateral r)^2 (1 - (n.d)^2)`` with d the ray.

    Args:
        faces: The faces in M.
        visible: Mask of the faces that look to the camera, shape (F,).
        transform: T_MB, shape (4, 4).
        cloud: The measured points.
        noise: Error model of the camera.

    Returns:
        The residuals, the distances of all points to the faces, each at most `FAR` [m], shape (n,), and the number of
        points within the cut.
    """
    if not visible.any():
        nothing = np.zeros((0, 3))
        return Residuals(nothing, nothing, np.zeros(0), np.zeros(0)), np.full(len(cloud), FAR), 0
    rotation = transform[:3, :3]
    face, offset = nearest_faces(faces, visible, _turned(rotation.T, cloud.points.T) + transform[:3, 3:])
    square, limit = _dot(offset, offset), noise.cut * noise.cut
    near = square < limit
    many = np.bincount(face[near], minlength=len(visible)) >= _LEAST_SHARE * len(cloud)
    axes = _turned(rotation, faces.axes.T)[..., face]  # component, direction, point
    along = _dot(axes, cloud.rays.T[:, None])
    used = near & many[face] & (np.abs(along[0]) >= _LEAST_COSINE)
    axes, along, residual, ranges = axes[..., used], along[:, used], offset[:, used], cloud.ranges[used]
    sigma = noise.sigma0 + noise.k * ranges * ranges / np.abs(along[0])
    variance = sigma**2 * along**2 + (noise.lateral * ranges) ** 2 * (1.0 - along**2)
    weight = (1.0 - square[used] / limit) ** 2 / variance
    counted = residual.T != 0.0
    counted[:, 0] = True  # the sides constrain only the points beyond them
    points = np.repeat(cloud.points[used][:, None], 3, axis=1)
    found = Residuals(points[counted], axes.T[counted], residual.T[counted], weight.T[counted])
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
        samples: Points on the faces in M.
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
    distance = np.sqrt(_dot(from_camera, from_camera))
    cosine = -_dot(from_camera, _turned(rotation, samples.normals.T)) / distance
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
