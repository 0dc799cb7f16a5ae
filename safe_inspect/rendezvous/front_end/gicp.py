"""Registration of two point clouds with generalised ICP (small_gicp)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from safe_inspect.rendezvous.front_end.registration import Registration
from safe_inspect.rendezvous.libraries import require
from safe_inspect.rendezvous.poses import adjoint, orthonormal
from safe_inspect.types import FloatArray

#: Voxel size for downsampling a cloud [m], and number of points from which a surface is estimated.
_VOXEL, _NEIGHBOURS = 0.012, 12
#: Maximum distances of correspondences in consecutive passes [m].
_REACH = (0.06, 0.03)
#: Standard deviations of the error between two views that does not decrease with the number of points [rad, m].
_VIEW = (np.deg2rad(0.5), 4e-3)


@dataclass(frozen=True, eq=False)
class PreparedCloud:
    """Downsampled points with the covariances of their surfaces and a search tree.

    Attributes:
        points: Positions [m], shape (n, 3).
        cloud: The cloud of small_gicp.
        tree: The search tree of the cloud.
    """

    points: FloatArray
    cloud: Any
    tree: Any

    def __len__(self) -> int:
        return len(self.points)


def prepared_cloud(points: FloatArray) -> PreparedCloud:
    """Prepare points [m], shape (n, 3), for registration."""
    library = require("small_gicp")
    cloud, tree = library.preprocess_points(
        np.ascontiguousarray(points, np.float64), _VOXEL, _NEIGHBOURS, num_threads=1
    )
    return PreparedCloud(np.asarray(cloud.points())[:, :3], cloud, tree)


def register(target: PreparedCloud, source: PreparedCloud, start: FloatArray) -> Registration:
    """Return the pose that maps `source` to `target`, first with distant correspondences, then with close ones.

    The score is the root mean square of the residuals, each divided by the width of the surface that it is measured
    from. The inliers are the fraction of the source's points that have a correspondence.

    Args:
        target: The fixed cloud.
        source: The moving cloud.
        start: Initial pose, shape (4, 4).
    """
    library = require("small_gicp")
    pose = start
    result: Any = None
    for reach in _REACH:
        result = library.align(
            target.cloud,
            source.cloud,
            target.tree,
            init_T_target_source=pose,
            registration_type="GICP",
            max_correspondence_distance=reach,
            num_threads=1,
            max_iterations=30,
            rotation_epsilon=1e-4,
            translation_epsilon=1e-5,
        )
        pose = orthonormal(np.asarray(result.T_target_source))
    found = max(int(result.num_inliers), 1)
    error = max(2.0 * float(result.error) / found, 1e-9)
    # Two views sample different points: their common error rotates the cloud about its mean.
    middle = source.points.mean(axis=0) if len(source) else np.zeros(3)
    carry = adjoint(_at(middle))
    systematic = carry @ np.diag(np.repeat(_VIEW, 3) ** 2) @ carry.T
    inliers = found / max(len(source), 1)
    return Registration(pose, np.asarray(result.H), float(np.sqrt(error)), inliers, error, systematic)


def _at(point: FloatArray) -> FloatArray:
    moved = np.eye(4)
    moved[:3, 3] = point
    return moved
