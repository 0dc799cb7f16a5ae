"""What of a depth frame is used: the target's points, without those at the edges of the depth image."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from safe_inspect.rendezvous.poses import move
from safe_inspect.rendezvous.sensors.tof import DepthCamera, DepthFrame
from safe_inspect.types import BoolArray, FloatArray, IntArray

#: Edge of the voxels whose neighbours are taken as one cluster [m].
_LINK = 0.08
#: Least size of a cluster relative to the largest: parts of one body may seem apart, what flies is small.
_LEAST_CLUSTER = 0.25
#: Width over which the border of a silhouette is averaged for its direction [px], and its least slope [1/px].
_BLUR, _LEAST_SLOPE = 3.0, 1e-3


@dataclass(frozen=True, eq=False)
class Cloud:
    """The cleaned points of one frame, in the chaser's frame B.

    Attributes:
        points: Positions [m], shape (n, 3).
        rays: Unit directions from the camera, shape (n, 3).
        ranges: Distances from the camera [m], shape (n,).
        silhouette: Row and column of the nearest pixel that sees anything, shape (2, height, width).
        outwards: Direction along rows and columns out of the silhouette at each pixel, a unit vector near its border,
            shape (2, height, width).
        nearest: Least depth at a pixel and its neighbours, infinite where they see nothing [m], shape (height, width).
    """

    points: FloatArray
    rays: FloatArray
    ranges: FloatArray
    silhouette: IntArray
    outwards: FloatArray
    nearest: FloatArray

    def __len__(self) -> int:
        return len(self.points)

    def thinned(self, count: int) -> Cloud:
        """Return at most `count` of the points, evenly spread over their order."""
        if len(self) <= count:
            return self
        kept = np.linspace(0, len(self) - 1, count).astype(int)
        return replace(self, points=self.points[kept], rays=self.rays[kept], ranges=self.ranges[kept])


@dataclass(frozen=True)
class Cleaning:
    """Cleans frames.

    Attributes:
        camera: Geometry of the camera.
        edge: Difference of depth to a neighbour from which a pixel counts as the edge of a body [m].
    """

    camera: DepthCamera
    edge: float = 0.03

    def __call__(self, frame: DepthFrame, T_BC: FloatArray) -> Cloud:  # noqa: N803
        """Return the cleaned points of a frame.

        A pixel is dropped when it does not belong to a large cluster, or when one of its eight neighbours that see
        something differs by more than `edge`: there pixels fly.

        Args:
            frame: The frame.
            T_BC: Pose of the camera in B, shape (4, 4).
        """
        from scipy import ndimage  # slow to import

        directions = self.camera.directions
        used = frame.valid
        # A part that seems apart from the rest, behind an edge for instance, is no place where nothing is seen.
        seen = used | ndimage.binary_closing(used)
        used = _large_clusters(directions, frame.depth, used)
        inner = used & ~_depth_edges(frame.depth, used, self.edge)
        rays = directions[inner]
        ranges = frame.depth[inner] / rays[:, 2]
        silhouette, outwards = np.zeros((2, *used.shape), np.int64), np.zeros((2, *used.shape))
        if used.any():
            silhouette = ndimage.distance_transform_edt(~seen, return_distances=False, return_indices=True)
            outwards = _outwards(seen)
        return Cloud(
            move(T_BC, rays * ranges[:, None]),
            rays @ T_BC[:3, :3].T,
            ranges,
            silhouette.astype(np.int64, copy=False),
            outwards,
            _least_depth(frame.depth, used),
        )


def _outwards(seen: BoolArray) -> FloatArray:
    """Return the directions in which a blurred mask falls, shape (2, height, width); 0 far from its border."""
    from scipy import ndimage  # slow to import

    blurred = ndimage.gaussian_filter(seen.astype(np.float64), _BLUR, mode="nearest")
    slope = -np.stack(np.gradient(blurred))
    length = np.sqrt((slope**2).sum(axis=0))
    return np.asarray(np.where(length > _LEAST_SLOPE, slope / np.maximum(length, _LEAST_SLOPE), 0.0))


def _depth_edges(depth: FloatArray, used: BoolArray, edge: float) -> BoolArray:
    """Return the pixels with a used neighbour whose depth differs by more than `edge` [m]."""
    from scipy import ndimage  # slow to import

    # What is not used never differs: the largest and the least of the neighbours are taken over the used ones alone.
    largest = ndimage.maximum_filter(np.where(used, depth, -np.inf), size=3)
    return np.asarray((largest - depth > edge) | (depth - _least_depth(depth, used) > edge))


def _least_depth(depth: FloatArray, used: BoolArray) -> FloatArray:
    """Return the least depth of the used ones of a pixel and its neighbours, infinite without any [m]."""
    from scipy import ndimage  # slow to import

    return np.asarray(ndimage.minimum_filter(np.where(used, depth, np.inf), size=3))


def _large_clusters(directions: FloatArray, depth: FloatArray, used: BoolArray) -> BoolArray:
    """Return the used pixels of the largest groups of voxels that touch each other."""
    from scipy import ndimage  # slow to import

    rays = directions[used]
    if len(rays) == 0:
        return used
    points = rays * (depth[used] / rays[:, 2])[:, None]
    cells = np.floor((points - points.min(axis=0)) / _LINK).astype(np.int64)
    grid = np.zeros(cells.max(axis=0) + 1, np.bool_)
    grid[tuple(cells.T)] = True
    labels, count = ndimage.label(grid, structure=np.ones((3, 3, 3)))
    if count <= 1:
        return used
    label = labels[tuple(cells.T)]
    kept = used.copy()
    size = np.bincount(label)
    kept[used] = (size >= _LEAST_CLUSTER * size.max())[label]
    return kept
