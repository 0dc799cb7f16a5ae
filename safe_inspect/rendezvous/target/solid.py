"""Distances to a mesh, by which clearances are measured."""

from __future__ import annotations

from typing import Any

import numpy as np

from safe_inspect.rendezvous.target.model import TriangleMesh
from safe_inspect.rendezvous.target.surface import MeshSurface
from safe_inspect.types import FloatArray

#: Largest distance of a surface from the points that represent it, relative to the largest distance from the origin.
_SPACING = 0.02


class MeshSolid:
    """Closed bodies of triangles, with a lower bound of the distance to them.

    The bound is ``sqrt(d^2 - s^2)``, where d is the distance to the nearest point of a grid on the triangles and their
    sides, and s the largest distance between a place of a triangle or side and its grid. If q is the place nearest to
    p, on the triangle, side or corner T, then some point g of T's grid has ``|g - q| <= s`` and p - q is perpendicular
    to g - q, so that ``d^2 <= |p - q|^2 + s^2``. The bound is low by at most about ``s^2 / (2 d)``: 1 mm at 0.25 m from
    a target of 1 m.

    Args:
        bodies: The closed bodies, as meshes of trimesh; they may overlap.
    """

    def __init__(self, bodies: list[Any]) -> None:
        from scipy.spatial import cKDTree  # slow to import

        self._bodies = bodies
        self._spacing = _SPACING * float(np.linalg.norm(self.vertices, axis=1).max())
        self._trees = []
        for body in bodies:
            mesh = TriangleMesh(np.asarray(body.vertices, np.float64), np.asarray(body.faces, np.int64))
            self._trees.append(cKDTree(MeshSurface(mesh).sample(self._spacing).points))
        self._depths = [0.5 * float(body.extents.min()) for body in bodies]

    @property
    def vertices(self) -> FloatArray:
        """The vertices of all bodies [m], shape (V, 3)."""
        return np.concatenate([np.asarray(body.vertices, np.float64) for body in self._bodies])

    def in_units_of(self, length: float) -> MeshSolid:
        """Return the bodies with all lengths divided by a length [m]."""
        return MeshSolid([body.copy().apply_scale(1.0 / length) for body in self._bodies])

    def distances(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return lower bounds of the signed distance to each body and its gradient; see `OrientedBoxes.distances`.

        Args:
            points: Points [m], shape (N, 3).

        Returns:
            Distances [m], negative inside, shape (N, B), and unit gradients [-], shape (N, B, 3).
        """
        columns = [
            self._to_body(body, tree, depth, points)
            for body, tree, depth in zip(self._bodies, self._trees, self._depths, strict=True)
        ]
        return np.stack([column[0] for column in columns], axis=1), np.stack([column[1] for column in columns], axis=1)

    def distance(self, points: FloatArray) -> FloatArray:
        """Return a lower bound of the signed distance to the union [m], shape (N,), of points, shape (N, 3)."""
        return np.asarray(self.distances(points)[0].min(axis=1))

    def _to_body(self, body: Any, tree: Any, depth: float, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        length, nearest = tree.query(points)
        gradient = (points - tree.data[nearest]) / np.maximum(length, 1e-12)[:, None]
        sign = np.ones(len(points))
        near = length <= depth + self._spacing  # only such points can be inside
        if near.any():
            sign[near] = np.where(body.contains(points[near]), -1.0, 1.0)
        outside = np.sqrt(np.maximum(length**2 - self._spacing**2, 0.0))
        return np.where(sign > 0.0, outside, -length), sign[:, None] * gradient


class PointSolid:
    """Union of balls of one radius about each point of its parts, for instance of a map.

    Args:
        parts: Points [m], shape (n, 3), and the radius of the balls about them [m], of each part.
    """

    def __init__(self, parts: tuple[tuple[FloatArray, float], ...]) -> None:
        from scipy.spatial import cKDTree  # slow to import

        self._parts = parts
        self._trees = [cKDTree(points) for points, _ in parts]

    @property
    def vertices(self) -> FloatArray:
        """The points of all parts, moved outwards by their radius [m], shape (V, 3)."""
        lengths = [np.maximum(np.linalg.norm(points, axis=1, keepdims=True), 1e-12) for points, _ in self._parts]
        return np.concatenate(
            [points * (1.0 + radius / size) for (points, radius), size in zip(self._parts, lengths, strict=True)]
        )

    def in_units_of(self, length: float) -> PointSolid:
        """Return the solid with all lengths divided by a length [m]."""
        return PointSolid(tuple((points / length, radius / length) for points, radius in self._parts))

    def distances(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the signed distance to each part and its gradient; see `OrientedBoxes.distances`.

        Args:
            points: Points [m], shape (N, 3).

        Returns:
            Distances [m], shape (N, B), and unit gradients [-], shape (N, B, 3).
        """
        found, gradients = [], []
        for (_, radius), tree in zip(self._parts, self._trees, strict=True):
            length, nearest = tree.query(points)
            found.append(length - radius)
            gradients.append((points - tree.data[nearest]) / np.maximum(length, 1e-12)[:, None])
        return np.stack(found, axis=1), np.stack(gradients, axis=1)

    def distance(self, points: FloatArray) -> FloatArray:
        """Return the signed distance to the union [m], shape (N,), of points, shape (N, 3)."""
        return np.asarray(self.distances(points)[0].min(axis=1))
