"""Faces of a target's boxes as rectangles, the surfaces of a known shape, and a camera's view of them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from safe_inspect.geometry.oriented_boxes import OrientedBoxes
from safe_inspect.types import BoolArray, FloatArray


class RangeNoise(NamedTuple):
    """Error model of the camera, and the treatment of outliers in a registration.

    Attributes:
        sigma0: Constant part of the standard deviation of a range [m].
        k: Coefficient of the part that grows with ``r^2 / cos(incidence)`` [1/m].
        lateral: Standard deviation perpendicular to a ray, relative to the range.
        cut: Distance from a face at which Tukey's weights reach zero [m].
    """

    sigma0: float
    k: float
    lateral: float
    cut: float


class Faces(NamedTuple):
    """Rectangles in the model's frame M.

    Attributes:
        centre: Centres [m], shape (F, 3).
        axes: Outward normal and the two directions along the sides, one per row, shape (F, 3, 3).
        half_size: Half lengths of the two sides [m], shape (F, 2).
    """

    centre: FloatArray
    axes: FloatArray
    half_size: FloatArray

    def looks_to(self, position: FloatArray) -> BoolArray:
        """Return for each face whether a position [m], shape (3,), is on its outer side, shape (F,)."""
        return np.asarray(np.einsum("fi,fi->f", self.axes[:, 0], position - self.centre) > 0.0)


class SurfacePoints(NamedTuple):
    """Points on the faces, in the model's frame M.

    Attributes:
        points: Positions [m], shape (n, 3).
        normals: Outward normals, shape (n, 3).
    """

    points: FloatArray
    normals: FloatArray


def faces_of(boxes: OrientedBoxes) -> Faces:
    """Return the six faces of each box."""
    centres, axes, sizes = [], [], []
    for centre, half, rotation in zip(boxes.centre, boxes.half_size, boxes.rotation, strict=True):
        for axis in range(3):
            first, second = (axis + 1) % 3, (axis + 2) % 3
            for side in (-1.0, 1.0):
                normal = side * rotation[:, axis]
                centres.append(centre + half[axis] * normal)
                axes.append([normal, rotation[:, first], rotation[:, second]])
                sizes.append([half[first], half[second]])
    return Faces(np.array(centres), np.array(axes), np.array(sizes))


def surface_points(faces: Faces, spacing: float) -> SurfacePoints:
    """Return a grid of points on each face, including its border, at most `spacing` [m] apart."""
    points, normals = [], []
    for centre, axes, half in zip(*faces, strict=True):
        count = np.maximum(np.ceil(2.0 * half / spacing).astype(int) + 1, 2)
        u, v = np.meshgrid(*(np.linspace(-size, size, number) for size, number in zip(half, count, strict=True)))
        points.append(centre + u.reshape(-1, 1) * axes[1] + v.reshape(-1, 1) * axes[2])
        normals.append(np.broadcast_to(axes[0], points[-1].shape))
    return SurfacePoints(np.concatenate(points), np.concatenate(normals))
