"""Selection of the points of a depth frame that are used: the target's, without those at edges of the depth image."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from safe_inspect.rendezvous.depth_camera import DepthCamera, DepthFrame
from safe_inspect.rendezvous.poses import move
from safe_inspect.types import BoolArray, FloatArray, IntArray

#: Size of the voxels; occupied voxels that touch belong to one cluster [m].
_LINK = 0.08
#: Minimum size of a cluster relative to the largest: parts of one body may appear separate, flying pixels are few.
_LEAST_CLUSTER = 0.25
#: Width over which the border of a silhouette is averaged to find its direction [px], and its minimum slope [1/px].
_BLUR, _LEAST_SLOPE = 3.0, 1e-3
#: Difference of depth at an occluding boundary [m], and width of the window about a pixel in which it is sought [px].
_JUMP, _WINDOW = 0.03, 5


@dataclass(frozen=True, eq=False)
class Cloud:
    """Cleaned points of one frame, in the chaser's frame B.

    Attributes:
        points: Positions [m], shape (n, 3).
        rays: Unit directions from the camera, shape (n, 3).
        ranges: Distances from the camera [m], shape (n,).
        at_boundary: Whether a point is at an occluding boundary: within two pixels nothing is seen, or something
            farther by more than 3 cm, shape (n,).
        silhouette: Row and column of the nearest pixel with a measurement, shape (2, height, width).
        outwards: Direction along rows and columns out of the silhouette at each pixel, a unit vector near its border,
            shape (2, height, width).
        nearest: Smallest depth of a pixel and its neighbours, infinite if none has a depth [m], shape (height, width).
    """

    points: FloatArray
    rays: FloatArray
    ranges: FloatArray
    at_boundary: BoolArray
    silhouette: IntArray
    outwards: FloatArray
    nearest: FloatArray

    def __len__(self) -> int:
        return len(self.points)

    def thinned(self, count: int) -> Cloud:
        """Return a cloud with at most `count` of the points, at regular intervals of their order."""
        if len(self) <= count:
            return self
        kept = np.linspace(0, len(self) - 1, count).astype(int)
        names = ("points", "rays", "ranges", "at_boundary")
        return replace(self, **{name: getattr(self, name)[kept] for name in names})


@dataclass(frozen=True)
class Cleaning:
    """Function that cleans depth frames.

    Attributes:
        camera: Geometry of the camera.
        edge: Difference of depth to a neighbour beyond which a pixel counts as the edge of a body [m].
    """

    camera: DepthCamera
    edge: float = 0.03

    def __call__(self, frame: DepthFrame, T_BC: FloatArray) -> Cloud:  # noqa: N803
        """Return the cleaned points of a frame.

        A pixel is dropped if it does not belong to a large cluster, or if the depth of one of its eight neighbours
        differs by more than `edge`, because flying pixels occur there. Neighbours without a measurement do not count.

        Args:
            frame: The frame.
            T_BC: Pose of the camera in B, shape (4, 4).
        """
        from scipy import ndimage  # slow to import

        depth, directions = frame.depth, self.camera.directions
        # Close gaps between parts that only appear separate, for instance behind an edge: they are not free space.
        seen = frame.valid | ndimage.binary_closing(frame.valid)
        used = _large_clusters(directions, depth, frame.valid)
        # Pixels that are not used must not count as a difference: take the extremes over the used neighbours only.
        least = ndimage.minimum_filter(np.where(used, depth, np.inf), size=3)
        largest = ndimage.maximum_filter(np.where(used, depth, -np.inf), size=3)
        inner = used & (largest - depth <= self.edge) & (depth - least <= self.edge)
        rays = directions[inner]
        ranges = depth[inner] / rays[:, 2]
        farther = ndimage.maximum_filter(np.where(seen, np.where(used, depth, 0.0), np.inf), size=_WINDOW)
        silhouette, outwards = np.zeros((2, *used.shape), np.int64), np.zeros((2, *used.shape))
        if used.any():
            silhouette = ndimage.distance_transform_edt(~seen, return_distances=False, return_indices=True)
            blurred = ndimage.gaussian_filter(seen.astype(np.float64), _BLUR, mode="nearest")
            slope = -np.stack(np.gradient(blurred))
            length = np.sqrt((slope**2).sum(axis=0))
            outwards = np.where(length > _LEAST_SLOPE, slope / np.maximum(length, _LEAST_SLOPE), 0.0)
        points = move(T_BC, rays * ranges[:, None])
        return Cloud(
            points, rays @ T_BC[:3, :3].T, ranges, (farther - depth > _JUMP)[inner],
            silhouette.astype(np.int64, copy=False), outwards, np.asarray(least),
        )  # fmt: skip


def _large_clusters(directions: FloatArray, depth: FloatArray, used: BoolArray) -> BoolArray:
    """Return the mask of the used pixels that belong to the largest groups of touching voxels."""
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
