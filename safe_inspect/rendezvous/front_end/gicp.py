"""Registration of two point clouds by generalised ICP (small_gicp)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from safe_inspect.rendezvous.front_end.registration import Registration
from safe_inspect.rendezvous.libraries import require
from safe_inspect.rendezvous.poses import adjoint, orthonormal
from safe_inspect.types import FloatArray

#: Edge of the grid that thins a cloud [m], and points that a surface is estimated from.
_VOXEL, _NEIGHBOURS = 0.012, 12
#: Largest distances of correspondences, one after the other [m].
_REACH = (0.06, 0.03)
#: Standard deviations of the error that two views have however many points they are of [rad, m].
_VIEW = (np.deg2rad(0.5), 4e-3)


@dataclass(frozen=True, eq=False)
class PreparedCloud:
    """Points thinned to a grid, with their surfaces' covariances and a tree.

    Attributes:
        points: Positions [m], shape (n, 3).
        cloud: The cloud of small_gicp.
        tree: Its tree.
    """

    points: FloatArray
    cloud: Any
    tree: Any

    def __len__(self) -> int:
        return len(self.points)


def prepared_cloud(points: FloatArray) -> PreparedCloud:
    """Return points [m], shape (n, 3), ready for registration."""
    library = require("small_gicp")
    cloud, tree = library.preprocess_points(
        np.ascontiguousarray(points, np.float64), _VOXEL, _NEIGHBOURS, num_threads=1
    )
    return PreparedCloud(np.asarray(cloud.points())[:, :3], cloud, tree)


def register(target: PreparedCloud, source: PreparedCloud, start: FloatArray) -> Registration:
    """Return the pose that takes `source` to `target`, first by far correspondences, then by near ones.

    The score is the root mean square of the residuals, each over the width of the surface that it is measured
    from; the inliers are the share of the source's points with a correspondence.

    Args:
        target: The cloud that stays.
        source: The cloud that moves.
        start: Pose to start from, shape (4, 4).
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
    # Two views sample different points: their common error turns the cloud about its own middle.
    middle = source.points.mean(axis=0) if len(source) else np.zeros(3)
    carry = adjoint(_at(middle))
    systematic = carry @ np.diag(np.repeat(_VIEW, 3) ** 2) @ carry.T
    inliers = found / max(len(source), 1)
    return Registration(pose, np.asarray(result.H), float(np.sqrt(error)), inliers, error, systematic)


def _at(point: FloatArray) -> FloatArray:
    moved = np.eye(4)
    moved[:3, 3] = point
    return moved
