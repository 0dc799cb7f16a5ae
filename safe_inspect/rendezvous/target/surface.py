"""The known surface of a target: its triangles, the patches that they form, and points on them."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from safe_inspect.compiling import njit
from safe_inspect.rendezvous.target.model import TriangleMesh
from safe_inspect.types import BoolArray, FloatArray, IntArray

#: Angle between the normals of neighbouring triangles above which their common edge is sharp [rad].
_SHARP = np.deg2rad(30.0)
#: Corners of triangles, their normals, sides, outward normals of the sides, squared lengths and sharp edges.
_Shape = tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, BoolArray]


class SurfacePoints(NamedTuple):
    """Points on a surface, in the model's frame M.

    Attributes:
        points: Positions [m], shape (n, 3).
        normals: Outward normals, shape (n, 3).
        triangles: Indices of the triangles, shape (n,).
    """

    points: FloatArray
    normals: FloatArray
    triangles: IntArray

    def facing(self, position: FloatArray) -> SurfacePoints:
        """Return the points whose outer side looks to a position [m], shape (3,)."""
        faces = dot(self.normals.T, (position - self.points).T) > 0.0
        return SurfacePoints(self.points[faces], self.normals[faces], self.triangles[faces])

    def thinned(self, cell: float) -> SurfacePoints:
        """Return one of the points in each cube of a side [m] whose normals are alike."""
        cubes = np.column_stack([np.floor(self.points / cell), np.round(self.normals)])
        kept = np.sort(np.unique(cubes, axis=0, return_index=True)[1])
        return SurfacePoints(self.points[kept], self.normals[kept], self.triangles[kept])


class Offsets(NamedTuple):
    """Positions relative to the triangles nearest to them.

    Attributes:
        triangles: Indices of the triangles, shape (n,).
        height: Signed height above the triangle's plane [m], shape (n,).
        beyond: Vector from the triangle's nearest sharp edge along its plane [m], 0 within it, shape (3, n).
    """

    triangles: IntArray
    height: FloatArray
    beyond: FloatArray


class MeshSurface:
    """A surface of triangles in the model's frame M.

    Triangles whose normals differ by less than 30 degrees from those of their neighbours form a patch: the face of a
    box, or the side of a cylinder. An edge between two patches is sharp.

    Args:
        mesh: The triangles.

    Attributes:
        corners: Corners of the triangles [m], shape (F, 3, 3).
        normals: Their outward normals, shape (F, 3).
        patches: Number of the patch of each triangle, shape (F,).
        sharp: Whether each edge, from a corner to the next one, is sharp, shape (F, 3).
    """

    def __init__(self, mesh: TriangleMesh) -> None:
        corners = mesh.corners
        sides = np.roll(corners, -1, axis=1) - corners
        area = np.cross(sides[:, 0], sides[:, 1])
        solid = np.linalg.norm(area, axis=1) > 1e-12 * np.square(corners).max()
        self.corners: FloatArray = corners[solid]
        self.normals: FloatArray = area[solid] / np.linalg.norm(area[solid], axis=1, keepdims=True)
        self.patches, self.sharp, self._neighbours = _patches(mesh.faces[solid], self.normals)
        sides = sides[solid]
        self._squares = np.square(sides).sum(axis=2)
        self._tree: Any = None
        outwards = np.cross(sides, self.normals[:, None])
        self._shape: _Shape = (self.corners, self.normals, sides, outwards, self._squares, self.sharp)

    @property
    def sharp_edges(self) -> FloatArray:
        """The ends of each sharp edge [m], shape (E, 2, 3)."""
        ends = np.stack((self.corners, np.roll(self.corners, -1, axis=1)), axis=2)[self.sharp]
        swapped = np.array([tuple(first) > tuple(last) for first, last in ends.tolist()], dtype=np.bool_)
        ends[swapped] = ends[swapped, ::-1]
        return np.asarray(np.unique(ends, axis=0))

    def sample(self, radius: float) -> SurfacePoints:
        """Return grids of points on the triangles, with their borders.

        Each place of a triangle is within `radius` [m] of a point of its grid, and each place of a side within `radius`
        of a point on that side.
        """
        points, triangles = [], []
        # A grid cell of sides up to a lies within a / sqrt(3) of its corners.
        steps = np.ceil(np.sqrt(self._squares.max(axis=1) / 3.0) / radius).astype(int)
        for index, (count, corners) in enumerate(zip(steps, self.corners, strict=True)):
            i, j = np.nonzero(np.add.outer(np.arange(count + 1), np.arange(count + 1)) <= count)
            points.append(np.stack([count - i - j, i, j], axis=1) / count @ corners)
            triangles.append(np.full(len(i), index))
        of = np.concatenate(triangles)
        return SurfacePoints(np.concatenate(points), self.normals[of], of)

    def nearest(self, samples: SurfacePoints, positions: FloatArray) -> Offsets:
        """Return positions relative to the nearest of the triangles that carry samples.

        The nearest sample gives a triangle, which is compared with its neighbours.

        Args:
            samples: Points on the triangles that count; at least one.
            positions: Positions in M [m], shape (3, n).
        """
        # Successive calls often have the same samples.
        if self._tree is None or not np.array_equal(self._tree.data, samples.points):
            from scipy.spatial import cKDTree  # slow to import

            self._tree = cKDTree(samples.points)
        first = samples.triangles[self._tree.query(positions.T)[1]]
        counts = np.zeros(len(self.corners), np.bool_)
        counts[samples.triangles] = True
        candidates = np.column_stack([first, self._neighbours[first]])
        found = Offsets(first.copy(), np.empty(len(first)), np.empty((3, len(first))))
        _nearest(candidates, counts, positions, self._shape, found.triangles, found.height, found.beyond)
        return found


@njit
def _nearest(
    candidates: IntArray,
    counts: BoolArray,
    positions: FloatArray,
    shape: _Shape,
    triangles: IntArray,
    height: FloatArray,
    beyond: FloatArray,
) -> None:
    """Write the nearest of the candidates of each position, shape (n, c), and the position relative to it."""
    corners, normals, sides, outwards, squares, sharp = shape
    offset = np.empty(3)
    for index in range(len(candidates)):
        smallest = np.inf
        for triangle in candidates[index]:
            if not counts[triangle]:
                continue
            nx, ny, nz = normals[triangle, 0], normals[triangle, 1], normals[triangle, 2]
            outside, is_sharp, least, above = False, False, np.inf, 0.0
            for edge in range(3):
                cx, cy, cz = _at(corners, triangle, edge)
                sx, sy, sz = _at(sides, triangle, edge)
                ox, oy, oz = _at(outwards, triangle, edge)
                px, py, pz = positions[0, index] - cx, positions[1, index] - cy, positions[2, index] - cz
                if edge == 0:
                    above = px * nx + py * ny + pz * nz
                outside = outside or px * ox + py * oy + pz * oz > 0.0
                along = min(max((px * sx + py * sy + pz * sz) / squares[triangle, edge], 0.0), 1.0)
                dx, dy, dz = px - along * sx - above * nx, py - along * sy - above * ny, pz - along * sz - above * nz
                square = dx * dx + dy * dy + dz * dz
                # Beyond a corner, two edges are equally near; the corner is sharp if one of them is.
                if abs(square - least) <= 1e-9 * square:
                    is_sharp = is_sharp or sharp[triangle, edge]
                elif square < least:
                    is_sharp, least = sharp[triangle, edge], square
                    offset[0], offset[1], offset[2] = dx, dy, dz
            square = above * above + (least if outside else 0.0)
            if square < smallest:
                smallest, triangles[index], height[index] = square, triangle, above
                for axis in range(3):
                    beyond[axis, index] = offset[axis] if outside and is_sharp else 0.0


@njit
def _at(vectors: FloatArray, triangle: int, edge: int) -> tuple[float, float, float]:
    return vectors[triangle, edge, 0], vectors[triangle, edge, 1], vectors[triangle, edge, 2]


def dot(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return the dot products of vectors, shape (3, ...), without BLAS, whose rounding depends on the processor."""
    return np.asarray(first[0] * second[0] + first[1] * second[1] + first[2] * second[2])


def _patches(faces: IntArray, normals: FloatArray) -> tuple[IntArray, BoolArray, IntArray]:
    """Return the patches, the sharp edges and the neighbours of triangles.

    Returns:
        The patch of each triangle, shape (F,); whether each of its edges is sharp, shape (F, 3); and the triangles
        beyond them, the triangle itself where there is none, shape (F, 3).
    """
    from scipy.sparse import coo_array  # slow to import
    from scipy.sparse.csgraph import connected_components

    edges = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2), axis=2).reshape(-1, 2)
    _, edge = np.unique(edges, axis=0, return_inverse=True)
    order = np.argsort(edge, kind="stable")
    pairs = np.stack([order[:-1], order[1:]])[:, edge[order[:-1]] == edge[order[1:]]]
    neighbours = np.repeat(np.arange(len(faces)), 3)
    neighbours[pairs] = pairs[::-1] // 3
    smooth = (normals[pairs // 3].prod(axis=0)).sum(axis=1) > np.cos(_SHARP)
    sharp = np.ones(edge.size, np.bool_)
    sharp[pairs[:, smooth]] = False
    links = coo_array((np.ones(smooth.sum()), pairs[:, smooth] // 3), shape=(len(faces), len(faces)))
    return connected_components(links, directed=False)[1], sharp.reshape(-1, 3), neighbours.reshape(-1, 3)
