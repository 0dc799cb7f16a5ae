"""The relative pose of two frames from matched features."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from safe_inspect.rendezvous.front_end.features import FeatureCloud, consistent, match, point_features, robust_pose
from safe_inspect.rendezvous.libraries import require
from safe_inspect.types import FloatArray


@dataclass(frozen=True, eq=False)
class FeatureFit:
    """A pose from matched features.

    Attributes:
        pose: The pose that takes the second cloud to the first, shape (4, 4).
        matches: Number of pairs of features.
        inliers: Number of pairs that the pose fits.
    """

    pose: FloatArray
    matches: int
    inliers: int


@dataclass(frozen=True)
class FeatureMatching:
    """Matches clouds by features.

    Attributes:
        voxel: Edge of the grid that thins a cloud [m].
        radius: Radius of a feature [m].
        tolerance: Error of a point [m].
        least_inliers: Fewer pairs give no pose.
    """

    voxel: float = 0.02
    radius: float = 0.1
    tolerance: float = 0.015
    least_inliers: int = 6

    def describe(self, points: FloatArray, camera: FloatArray) -> FeatureCloud:
        """Return the features of points [m], shape (n, 3), seen from a camera at a position [m], shape (3,)."""
        cloud, _ = require("small_gicp").preprocess_points(
            np.ascontiguousarray(points, np.float64), self.voxel, 20, num_threads=1
        )
        thinned, normals = np.asarray(cloud.points())[:, :3], np.asarray(cloud.normals())[:, :3]
        sight = np.einsum("ni,ni->n", normals, camera - thinned)
        normals = normals * np.where(sight < 0.0, -1.0, 1.0)[:, None]
        return FeatureCloud(thinned, point_features(thinned, normals, self.radius))

    def __call__(self, first: FeatureCloud, second: FeatureCloud) -> FeatureFit | None:
        """Return the pose that takes `second` to `first`; None when too few pairs agree."""
        pairs = match(first, second)
        a, b = first.points[pairs[:, 0]], second.points[pairs[:, 1]]
        kept = consistent(a, b, self.tolerance)
        if len(kept) < self.least_inliers:
            return None
        found, fits = robust_pose(a[kept], b[kept], 2.0 * self.tolerance)
        if fits.sum() < self.least_inliers:
            return None
        return FeatureFit(found, len(pairs), int(fits.sum()))
