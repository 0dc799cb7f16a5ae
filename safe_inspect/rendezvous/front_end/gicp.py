"""Generalised ICP (small_gicp) of two clouds, whose covariance grows where their surface does not show a motion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from safe_inspect.rendezvous.front_end.base import Registration
from safe_inspect.rendezvous.libraries import require
from safe_inspect.rendezvous.poses import adjoint, difference, orthonormal, perturbed, pose
from safe_inspect.types import FloatArray

#: Voxel size for downsampling a cloud [m], and numbers of points from which a surface and its normal are estimated:
#: normals of few points scatter so much that a plane seems to show how it turns about its own normal.
_VOXEL, _NEIGHBOURS, _NORMAL_NEIGHBOURS = 0.012, 12, 40
#: Maximum distances of correspondences in consecutive passes [m].
_REACH = (0.06, 0.03)
#: Standard deviations of the error between two views that does not decrease with the number of points [rad, m].
_VIEW = (np.deg2rad(0.5), 4e-3)
#: Standard deviations about the middle of a cloud of the prediction of its pose, and of a pose without one [rad, m];
#: and that of the height of a point above the surface, of which neighbours have similar errors [m].
_PREDICTION, _UNPREDICTED, _HEIGHT = (np.deg2rad(2.0), 0.02), (np.deg2rad(10.0), 0.05), 0.01


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
    library.estimate_normals(cloud, tree, num_neighbors=_NORMAL_NEIGHBOURS, num_threads=1)
    return PreparedCloud(np.asarray(cloud.points())[:, :3], cloud, tree)


def _about_middle(cloud: PreparedCloud, sigmas: tuple[float, float]) -> FloatArray:
    """Return the covariance of a tangent that turns and moves a cloud about its middle [rad, m], shape (6, 6)."""
    middle = cloud.points.mean(axis=0) if len(cloud) else np.zeros(3)
    carry = adjoint(pose(np.eye(3), middle))
    return np.asarray(carry @ np.diag(np.repeat(sigmas, 3) ** 2) @ carry.T)


def register(
    target: PreparedCloud, source: PreparedCloud, start: FloatArray, *, is_predicted: bool = False
) -> Registration:
    """Return the pose that maps `source` to `target`, first with distant correspondences, then with close ones.

    The score is the root mean square of the residuals, each divided by the width of the surface that it is measured
    from. The inliers are the fraction of the source's points that have a correspondence.

    Args:
        target: The fixed cloud.
        source: The moving cloud.
        start: Initial pose, shape (4, 4).
        is_predicted: Whether the initial pose holds in the directions that the surface does not show, such as the turn
            of a plane about its normal.
    """
    library = require("small_gicp")
    placed = start
    result: Any = None
    for reach in _REACH:
        result = library.align(
            target.cloud,
            source.cloud,
            target.tree,
            init_T_target_source=placed,
            registration_type="GICP",
            max_correspondence_distance=reach,
            num_threads=1,
            max_iterations=30,
            rotation_epsilon=1e-4,
            translation_epsilon=1e-5,
        )
        placed = orthonormal(np.asarray(result.T_target_source))
    found = max(int(result.num_inliers), 1)
    error = max(2.0 * float(result.error) / found, 1e-9)
    normals = np.asarray(source.cloud.normals())[:, :3]
    heights = np.hstack([np.cross(source.points, normals), normals])  # derivatives by the tangent from the right
    prior = np.linalg.inv(_about_middle(source, _PREDICTION if is_predicted else _UNPREDICTED))
    unshown = np.linalg.inv(heights.T @ heights / _HEIGHT**2 + prior)
    if is_predicted:
        placed = perturbed(placed, unshown @ prior @ difference(placed, start))
    # Two views sample different points: their common error rotates the cloud about its mean.
    systematic = _about_middle(source, _VIEW) + unshown
    inliers = found / max(len(source), 1)
    return Registration(placed, np.asarray(result.H), float(np.sqrt(error)), inliers, error, systematic)
