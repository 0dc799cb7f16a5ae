"""Map of an unknown target: oriented points of depth frames, fused to a surface of triangles and a solid."""

from __future__ import annotations

import numpy as np

from safe_inspect.compiling import njit
from safe_inspect.rendezvous.depth_camera import DepthCamera, DepthFrame
from safe_inspect.rendezvous.estimation.alignment import OrientedPoints, aligned_poses
from safe_inspect.rendezvous.front_end.cleaning import Cleaning
from safe_inspect.rendezvous.front_end.gicp import prepared_cloud
from safe_inspect.rendezvous.poses import inverse, move, pose, rotation_exp, rotation_log
from safe_inspect.rendezvous.target.model import TriangleMesh
from safe_inspect.rendezvous.target.solid import PointSolid
from safe_inspect.types import BoolArray, FloatArray, IntArray

#: Width of a cell of the map's sheets [m], and largest difference of height between the corners of a triangle [m].
_CELL, _STEP = 0.012, 0.019
#: Largest angle between a point's normal and the direction of its sheet.
_LEAST_ALONG = np.cos(np.deg2rad(40.0))
#: Directions of the sheets: to the faces, edges and corners of a cube.
_DIRECTIONS = np.array([d / np.linalg.norm(d) for d in np.array([*np.ndindex(3, 3, 3)]) - 1.0 if d.any()])
#: Minimum number of points of a frame, and minimum cosine of incidence of a point.
_LEAST_POINTS, _LEAST_COSINE = 150, 0.3
#: Thickness of a layer of points in a cell [m], and minimum number of its points.
_LAYER, _LEAST_IN_LAYER = 0.025, 6
#: Side of a cell of space [m]; distance from the surface within which the space counts as known from the surface [m].
_SPACE, _KNOWN = 0.06, 0.10
#: Number of frames that must see through a cell of space, and width of the window in which a pixel must see nothing.
_LEAST_SEEN, _WINDOW = 2, 5
#: Time between two frames that are aligned [s]; the errors of those between them are interpolated.
_PERIOD = 1.0


class SurfaceMap:
    """Frames of a target, from which its surface and the space that it may occupy are computed.

    Args:
        camera: Geometry of the camera.
        T_BC: Pose of the camera in B, shape (4, 4).
        noise: Standard deviation of a range: its constant part [m], and the part that grows with the square of the
            range [1/m].
    """

    def __init__(self, camera: DepthCamera, T_BC: FloatArray, noise: tuple[float, float]) -> None:  # noqa: N803
        self._camera, self._T_BC, self._noise = camera, T_BC, noise
        self._cleaning = Cleaning(camera)
        self._frames: list[DepthFrame] = []
        self._points: list[OrientedPoints | None] = []

    def add(self, frame: DepthFrame) -> int:
        """Add the next frame and return its number, from 0."""
        self._frames.append(frame)
        points = self._cleaning(frame, self._T_BC).points if len(frame.points) else frame.points
        self._points.append(self._oriented(points) if len(points) >= _LEAST_POINTS else None)
        return len(self._frames) - 1

    def _oriented(self, points: FloatArray) -> OrientedPoints:
        cloud = prepared_cloud(points)
        normals = np.asarray(cloud.cloud.normals())[:, :3]
        away = self._T_BC[:3, 3] - cloud.points
        distance = np.linalg.norm(away, axis=1)
        cosine = (normals * away).sum(axis=1) / distance
        normals = np.where(cosine[:, None] < 0.0, -normals, normals)
        seen = np.abs(cosine) > _LEAST_COSINE
        sigma = self._noise[0] + self._noise[1] * distance**2 / np.maximum(np.abs(cosine), _LEAST_COSINE)
        return OrientedPoints(cloud.points[seen], normals[seen], sigma[seen] ** -2)

    def aligned(
        self, poses: dict[int, FloatArray], centre: FloatArray, attitudes: dict[int, FloatArray]
    ) -> dict[int, FloatArray]:
        """Return the poses for which the points of the frames coincide; see `aligned_poses`.

        Args:
            poses: T_GB by the number of the frame, in ascending order, shape (4, 4) each.
            centre: Centre of mass in G [m], shape (3,).
            attitudes: R_GW at these frames, shape (3, 3) each.
        """
        numbers, times = list(poses), np.array([self._frames[number].time for number in poses])
        R_GW = np.stack([attitudes[number] for number in poses])  # noqa: N806
        chosen: list[int] = []
        clouds: list[OrientedPoints] = []
        for index, number in enumerate(numbers):
            points = self._points[number]
            if points is not None and (not chosen or times[index] >= times[chosen[-1]] + _PERIOD - 1e-6):
                chosen.append(index)
                clouds.append(points)
        stacked = pose(np.eye(3), -centre) @ np.stack(list(poses.values()))
        found = aligned_poses(clouds, times[chosen], stacked[chosen], R_GW[chosen], self._T_BC[:3, 2])
        # The errors of the frames between those are interpolated in W.
        corrections = [new @ inverse(old) for new, old in zip(found, stacked[chosen], strict=True)]
        errors = np.stack([[rotation_log(one[:3, :3]), one[:3, 3]] for one in corrections]) @ R_GW[chosen]
        columns = errors.reshape(len(chosen), 6).T
        between = np.stack([np.interp(times, times[chosen], column) for column in columns], axis=1)
        errors = between.reshape(-1, 2, 3) @ R_GW.transpose(0, 2, 1)
        back = pose(np.eye(3), centre)
        return {
            number: back @ pose(rotation_exp(turn), shift) @ stacked[k]
            for k, (number, (turn, shift)) in enumerate(zip(numbers, errors, strict=True))
        }

    def mesh(self, poses: dict[int, FloatArray]) -> TriangleMesh:
        """Return the surface in the frame G of the poses.

        Points are sorted by the directions of their normals into 26 sheets, each with a square grid across its
        direction. The height of a cell is the mean of its outermost layer of points, which at least two frames must
        show. Neighbouring cells form triangles. Where normals belong to several sheets, these overlap.

        Args:
            poses: T_GB by the number of the frame, shape (4, 4) each.
        """
        shown = [(number, one) for number in poses if (one := self._points[number]) is not None]
        points = np.concatenate([move(poses[number], one.points) for number, one in shown])
        normals = np.concatenate([one.normals @ poses[number][:3, :3].T for number, one in shown])
        weights = np.concatenate([one.weights for _, one in shown])
        frames = np.repeat([number for number, _ in shown], [len(one.points) for _, one in shown])
        vertices, faces, count = [], [], 0
        for direction in _DIRECTIONS:
            along = normals @ direction > _LEAST_ALONG
            if along.sum() < _LEAST_POINTS:
                continue
            corners, triangles = _sheet(points[along], weights[along], frames[along], direction)
            vertices.append(corners)
            faces.append(triangles + count)
            count += len(corners)
        used, indices = np.unique(np.concatenate(faces), return_inverse=True)
        return TriangleMesh(np.concatenate(vertices)[used], indices.reshape(-1, 3))

    def solid(
        self, poses: dict[int, FloatArray], surface: TriangleMesh, model: FloatArray, origin: FloatArray
    ) -> PointSolid:
        """Return the space that the target may occupy, in the axes of M about a point.

        It contains the surface, and the cells of space that less than two frames have seen through, except next to the
        surface, whose outer side is free.

        Args:
            poses: T_GB by the number of the frame, shape (4, 4) each.
            surface: The surface in M.
            model: T_GM, shape (4, 4).
            origin: The point in M [m], shape (3,).
        """
        from scipy.spatial import cKDTree  # slow to import

        vertices = surface.vertices - origin
        radius = float(np.linalg.norm(vertices, axis=1).max())
        steps = np.arange(-radius, radius + _SPACE, _SPACE)
        cells = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1).reshape(-1, 3)
        cells = cells[np.linalg.norm(cells, axis=1) <= radius]
        places = move(model, cells + origin)
        seen = np.zeros(len(cells), np.int64)
        for number, T_GB in poses.items():  # noqa: N806
            seen += self._sees_through(self._frames[number], move(inverse(T_GB @ self._T_BC), places))
        unseen = cells[(seen < _LEAST_SEEN) & (cKDTree(vertices).query(cells)[0] > _KNOWN)]
        # Every place of the surface is within 9 mm of a vertex along it, 0.2 mm at the distance of a chaser's centre.
        parts = (vertices, 0.0), (unseen, 0.5 * np.sqrt(3.0) * _SPACE)
        return PointSolid(parts if len(unseen) else parts[:1])

    def _sees_through(self, frame: DepthFrame, places: FloatArray) -> BoolArray:
        """Return which places in C are in front of what a frame sees, or where it sees nothing, shape (n,)."""
        from scipy import ndimage  # slow to import

        if not frame.depth.size:
            return np.zeros(len(places), np.bool_)
        fx, fy, cx, cy = self._camera.intrinsics
        depth = np.where(frame.valid, frame.depth, np.inf)
        nearest = ndimage.minimum_filter(depth, size=_WINDOW)
        z = np.maximum(places[:, 2], 1e-6)
        column, row = np.rint(places[:, 0] / z * fx + cx), np.rint(places[:, 1] / z * fy + cy)
        inside = (column >= 0) & (column < self._camera.width) & (row >= 0) & (row < self._camera.height)
        inside &= (places[:, 2] > self._camera.least_range) & (places[:, 2] < self._camera.largest_range)
        at = nearest[np.where(inside, row, 0).astype(int), np.where(inside, column, 0).astype(int)]
        return np.asarray(inside & (places[:, 2] + _SPACE < at))


def _sheet(
    points: FloatArray, weights: FloatArray, frames: IntArray, direction: FloatArray
) -> tuple[FloatArray, IntArray]:
    """Return vertices [m], shape (V, 3), and triangles, shape (F, 3), of the outermost layer along a direction."""
    first = np.cross(direction, np.eye(3)[np.abs(direction).argmin()])
    first /= np.linalg.norm(first)
    second = np.cross(direction, first)
    cells = np.floor(np.stack([points @ first, points @ second], axis=1) / _CELL).astype(np.int64)
    origin = cells.min(axis=0)
    shape = tuple(cells.max(axis=0) - origin + 1)
    key = np.ravel_multi_index((cells - origin).T, shape)
    height = points @ direction
    order = np.lexsort((-height, key))
    heights = np.full(shape, np.nan)
    _layers(key[order], height[order], weights[order], frames[order], heights.reshape(-1))
    heights = _smoothed(heights)
    known = np.isfinite(heights)
    index = np.full(shape, -1)
    index[known] = np.arange(known.sum())
    places = (np.argwhere(known) + origin + 0.5) * _CELL
    vertices = places[:, :1] * first + places[:, 1:] * second + heights[known][:, None] * direction
    corners = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    triangles = []
    for a, b, c in ((0, 1, 3), (1, 2, 3)):
        candidate = np.stack([corners[a].ravel(), corners[b].ravel(), corners[c].ravel()], axis=1)
        candidate = candidate[(candidate >= 0).all(axis=1)]
        apart = np.ptp((vertices @ direction)[candidate], axis=1)
        triangles.append(candidate[apart < _STEP])
    return vertices, np.concatenate(triangles)


def _smoothed(heights: FloatArray) -> FloatArray:
    """Return heights averaged with pairs of opposite neighbours that are near, which keeps the slope of a plane."""
    padded = np.pad(heights, 1, constant_values=np.nan)
    total, count = np.where(np.isfinite(heights), heights, 0.0), np.isfinite(heights).astype(float)
    rows, columns = heights.shape
    for i, j in ((1, 0), (0, 1), (1, 1), (1, -1)):
        ahead = padded[1 + i : 1 + i + rows, 1 + j : 1 + j + columns]
        behind = padded[1 - i : 1 - i + rows, 1 - j : 1 - j + columns]
        near = (np.abs(ahead - heights) < _STEP) & (np.abs(behind - heights) < _STEP)
        total, count = total + np.where(near, ahead + behind, 0.0), count + 2.0 * near
    return np.where(count > 0.0, total / np.maximum(count, 1.0), np.nan)


@njit
def _layers(key: IntArray, height: FloatArray, weights: FloatArray, frames: IntArray, heights: FloatArray) -> None:
    """Write the mean height of the outermost layer of each cell, from points sorted by cell and falling height."""
    start, total = 0, len(key)
    while start < total:
        end = start
        while end < total and key[end] == key[start]:
            end += 1
        # A layer with far fewer points than the largest one consists of flying pixels.
        most, last = 0, start
        for first in range(start, end):
            while last < end and height[first] - height[last] < _LAYER:
                last += 1
            most = max(most, last - first)
        least = max(float(_LEAST_IN_LAYER), 0.25 * most)
        last = start
        for first in range(start, end):
            while last < end and height[first] - height[last] < _LAYER:
                last += 1
            if last - first >= least:
                middle = height[(first + last) // 2]
                above, below, is_seen_twice = 0.0, 0.0, False
                for index in range(first, last):
                    if abs(height[index] - middle) < 0.02:
                        above += weights[index] * height[index]
                        below += weights[index]
                        is_seen_twice = is_seen_twice or frames[index] != frames[first]
                if is_seen_twice:
                    heights[key[start]] = above / below
                break
        start = end
