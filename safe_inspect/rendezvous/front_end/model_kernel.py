"""Compiled normal equations of a depth frame against the faces of a known shape.

Tangents (rotation, translation) act on T_MB from the right. A point p in B is at ``x = R p + t`` in M, and the residual
along a direction n of M has the derivative ``[p x g, g]`` with ``g = R^T n``.
"""

from __future__ import annotations

import math

import numpy as np

from safe_inspect.compiling import njit
from safe_inspect.rendezvous.front_end.faces import Faces, FrameView, RangeNoise, SurfacePoints
from safe_inspect.types import BoolArray, FloatArray

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


@njit
def _rotated_back(transform: FloatArray, vector: FloatArray | tuple[float, float, float]) -> tuple[float, float, float]:
    """Return ``R^T v`` for the rotation R of a transform; v is an array or a tuple."""
    x, y, z = vector[0], vector[1], vector[2]
    return (
        transform[0, 0] * x + transform[1, 0] * y + transform[2, 0] * z,
        transform[0, 1] * x + transform[1, 1] * y + transform[2, 1] * z,
        transform[0, 2] * x + transform[1, 2] * y + transform[2, 2] * z,
    )


@njit
def _add_equation(
    row: tuple[float, ...], residual: float, weight: float, hessian: FloatArray, gradient: FloatArray
) -> None:
    """Add the weighted equation of a residual with the derivative `row`, six numbers."""
    for m in range(6):
        gradient[m] += weight * row[m] * residual
        for n in range(6):
            hessian[m, n] += weight * row[m] * row[n]


@njit
def _nearest_face(faces: Faces, visible: BoolArray, x: float, y: float, z: float) -> tuple[int, float, float, float]:
    """Return the visible face nearest to a point, the height above it, and the distances beyond its two pairs of sides.

    The last two are signed, and 0 within the rectangle. The face is -1 if none is visible.

    Args:
        faces: The faces.
        visible: Mask of the faces that look to the camera, shape (F,).
        x: First coordinate of the point in M [m].
        y: Second coordinate [m].
        z: Third coordinate [m].
    """
    best, least = -1, math.inf
    height, first, second = 0.0, 0.0, 0.0
    for f in range(faces.centre.shape[0]):
        if not visible[f]:
            continue
        dx, dy, dz = x - faces.centre[f, 0], y - faces.centre[f, 1], z - faces.centre[f, 2]
        axes = faces.axes[f]
        h = axes[0, 0] * dx + axes[0, 1] * dy + axes[0, 2] * dz
        if h * h >= least:
            continue
        a = axes[1, 0] * dx + axes[1, 1] * dy + axes[1, 2] * dz
        b = axes[2, 0] * dx + axes[2, 1] * dy + axes[2, 2] * dz
        a = math.copysign(max(abs(a) - faces.half_size[f, 0], 0.0), a)
        b = math.copysign(max(abs(b) - faces.half_size[f, 1], 0.0), b)
        square = h * h + a * a + b * b
        if square < least:
            best, least, height, first, second = f, square, h, a, b
    return best, height, first, second


@njit
def face_equations(
    faces: Faces,
    visible: BoolArray,
    transform: FloatArray,
    points: FloatArray,
    rays: FloatArray,
    ranges: FloatArray,
    noise: RangeNoise,
    hessian: FloatArray,
    gradient: FloatArray,
) -> tuple[float, float, int]:
    """Set the normal equations of measured points against the visible faces, and return sums over the points.

    Points on a face that is seen at too flat an angle, or that has too few points, do not count. The residuals are the
    height above the plane of the face and the distances beyond its sides. The variance along a unit vector n is
    ``sigma^2 (n.d)^2 + (lateral r)^2 (1 - (n.d)^2)`` with d the ray.

    Args:
        faces: The faces in M.
        visible: Mask of the faces that look to the camera, shape (F,).
        transform: T_MB, shape (4, 4).
        points: Points in B [m], shape (n, 3).
        rays: Unit directions from the camera to the points in B, shape (n, 3).
        ranges: Distances from the camera [m], shape (n,).
        noise: Error model of the camera.
        hessian: Output, shape (6, 6).
        gradient: Output, shape (6,).

    Returns:
        Sum of the weighted squares of the residuals, sum of the distances, each at most `FAR` [m], and number of points
        within the cut.
    """
    hessian[:] = 0.0
    gradient[:] = 0.0
    squares, distance, inliers = 0.0, 0.0, 0
    nearest, counts = np.empty(points.shape[0], np.int64), np.zeros(faces.centre.shape[0], np.int64)
    offsets = np.empty((points.shape[0], 3))
    for i in range(points.shape[0]):
        px, py, pz = points[i, 0], points[i, 1], points[i, 2]
        x = transform[0, 0] * px + transform[0, 1] * py + transform[0, 2] * pz + transform[0, 3]
        y = transform[1, 0] * px + transform[1, 1] * py + transform[1, 2] * pz + transform[1, 3]
        z = transform[2, 0] * px + transform[2, 1] * py + transform[2, 2] * pz + transform[2, 3]
        f, h, a, b = _nearest_face(faces, visible, x, y, z)
        square = h * h + a * a + b * b if f >= 0 else FAR * FAR
        distance += min(math.sqrt(square), FAR)
        is_near = square < noise.cut * noise.cut
        nearest[i], offsets[i, 0], offsets[i, 1], offsets[i, 2] = f if is_near else -1, h, a, b
        if is_near:
            inliers += 1
            counts[f] += 1
    least = _LEAST_SHARE * points.shape[0]
    for i in range(points.shape[0]):
        f = nearest[i]
        if f < 0 or counts[f] < least:
            continue
        px, py, pz = points[i, 0], points[i, 1], points[i, 2]
        square = offsets[i, 0] ** 2 + offsets[i, 1] ** 2 + offsets[i, 2] ** 2
        kept = (1.0 - square / (noise.cut * noise.cut)) ** 2
        across = (noise.lateral * ranges[i]) ** 2
        cosine = 0.0
        for k in range(3):
            residual = offsets[i, k]
            if k > 0 and residual == 0.0:
                continue
            gx, gy, gz = _rotated_back(transform, faces.axes[f, k])
            along = gx * rays[i, 0] + gy * rays[i, 1] + gz * rays[i, 2]
            if k == 0:  # the normal
                cosine = abs(along)
            if cosine < _LEAST_COSINE:
                break
            sigma = noise.sigma0 + noise.k * ranges[i] * ranges[i] / cosine
            along *= along
            weight = kept / (sigma * sigma * along + across * (1.0 - along))
            row = (py * gz - pz * gy, pz * gx - px * gz, px * gy - py * gx, gx, gy, gz)
            _add_equation(row, residual, weight, hessian, gradient)
            squares += weight * residual * residual
    return squares, distance, inliers


@njit
def _seen_at(
    samples: SurfacePoints, i: int, transform: FloatArray, view: FrameView
) -> tuple[float, float, float, float, float, float, float]:
    """Return depth [m], column, row, position in B (x, y, z) [m] and cosine of incidence of a point of the shape.

    The depth is 0 if the point is not in the image or its face is seen at too flat an angle, and negative if the point
    is too close or too far to be measured. Column and row are half-integers at the centre of a pixel.
    """
    height, width = view.silhouette.shape[1], view.silhouette.shape[2]
    fx, fy, cx, cy = view.intrinsics
    mx = samples.points[i, 0] - transform[0, 3]
    my = samples.points[i, 1] - transform[1, 3]
    mz = samples.points[i, 2] - transform[2, 3]
    x, y, z = _rotated_back(transform, (mx, my, mz))
    nx, ny, nz = _rotated_back(transform, samples.normals[i])
    dx, dy, dz = x - view.origin[0], y - view.origin[1], z - view.origin[2]
    distance = math.sqrt(dx * dx + dy * dy + dz * dz)
    right, down, depth = _rotated_back(view.axes, (dx, dy, dz))
    cosine = -(dx * nx + dy * ny + dz * nz) / distance
    if cosine < _VISIBLE_COSINE or depth <= 0.0:
        return 0.0, 0.0, 0.0, x, y, z, cosine
    column, row = fx * right / depth + cx + 0.5, fy * down / depth + cy + 0.5
    # At the border of the image, half of a pixel's neighbourhood is not visible.
    if not (_BORDER <= column < width - _BORDER and _BORDER <= row < height - _BORDER):
        return 0.0, 0.0, 0.0, x, y, z, cosine
    measured = view.nearest <= distance <= view.farthest
    return (depth if measured else -depth), column, row, x, y, z, cosine


@njit
def add_silhouette_equations(
    samples: SurfacePoints, transform: FloatArray, view: FrameView, hessian: FloatArray, gradient: FloatArray
) -> tuple[float, int]:
    """Add the normal equations of points that should be visible outside the silhouette, and return sums over them.

    The residual of such a point is its distance to the border of the silhouette, perpendicular to the ray and along the
    normal of the border: if a border crosses the whole image, the shape may slide along it. Points that are too close
    to be measured are left out, and so are points next to them in the image, which may be behind them. A point in front
    of the depth measured at its pixel has no equation, but its distance counts in the score: a pose is wrong if the
    camera sees through the shape.

    Args:
        samples: Points on the faces in M.
        transform: T_MB, shape (4, 4).
        view: The camera and its measurements.
        hessian: Matrix to which the equations are added, shape (6, 6).
        gradient: Vector to which the equations are added, shape (6,).

    Returns:
        Sum of the distances, each at most `FAR` [m], and number of points.
    """
    total, seen = 0.0, 0
    height, width = view.silhouette.shape[1], view.silhouette.shape[2]
    axes = view.axes
    fx, fy, cx, cy = view.intrinsics
    hidden = np.zeros((height // _CELL + 3, width // _CELL + 3), np.bool_)
    for i in range(samples.points.shape[0]):
        depth, column, row, x, y, z, cosine = _seen_at(samples, i, transform, view)
        if depth < 0.0:
            first, second = int(row) // _CELL, int(column) // _CELL
            hidden[first : first + 3, second : second + 3] = True
    for i in range(samples.points.shape[0]):
        depth, column, row, x, y, z, cosine = _seen_at(samples, i, transform, view)
        if depth <= 0.0 or hidden[int(row) // _CELL + 1, int(column) // _CELL + 1]:
            continue
        right, down = (column - cx - 0.5) / fx, (row - cy - 0.5) / fy
        seen += 1
        pixel = depth / fx
        near_row, near_column = view.silhouette[0, int(row), int(column)], view.silhouette[1, int(row), int(column)]
        u, v = column - (near_column + 0.5), row - (near_row + 0.5)
        u = math.copysign(max(abs(u) - 0.5, 0.0), u) * pixel
        v = math.copysign(max(abs(v) - 0.5, 0.0), v) * depth / fy
        across, up = view.outwards[1, near_row, near_column], view.outwards[0, near_row, near_column]
        residual = across * u + up * v
        if residual <= 0.0:
            sigma = view.noise.sigma0 + view.noise.k * depth * depth / cosine
            through = view.measured[int(row), int(column)] - depth - _SEEN_THROUGH * sigma
            if through < math.inf:
                total += min(max(through, 0.0), FAR)
            continue
        total += min(residual, FAR)
        weight = min(1.0, _OUTLINE_CUT / residual) / (_OUTLINE * pixel) ** 2
        gx = across * (axes[0, 0] - right * axes[0, 2]) + up * (axes[0, 1] - down * axes[0, 2])
        gy = across * (axes[1, 0] - right * axes[1, 2]) + up * (axes[1, 1] - down * axes[1, 2])
        gz = across * (axes[2, 0] - right * axes[2, 2]) + up * (axes[2, 1] - down * axes[2, 2])
        line = (gy * z - gz * y, gz * x - gx * z, gx * y - gy * x, -gx, -gy, -gz)
        _add_equation(line, residual, weight, hessian, gradient)
    return total, seen
