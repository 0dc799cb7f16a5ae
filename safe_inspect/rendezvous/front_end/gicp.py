"""Registration of two point clouds by generalised ICP (small_gicp)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from safe_inspect.rendezvous.front_end.registration import Registration
from safe_inspect.rendezvous.libraries import require
from safe_inspect.rendezvous.poses import adjoint, orthonormal
from safe_inspect.types import FloatArray


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


@dataclass(frozen=True)
class GicpRegistration:
    """Registers prepared clouds, first with far correspondences, then with near ones.

    Attributes:
        voxel: Edge of the grid [m].
        neighbours: Points that a surface is estimated from.
        reach: Largest distances of correspondences, one after the other [m].
        view_turn: Standard deviation of the error that two views have however many points they are of, rotation [rad].
        view_shift: The same of the translation [m].
    """

    voxel: float = 0.012
    neighbours: int = 12
    reach: tuple[float, ...] = (0.06, 0.03)
    view_turn: float = np.deg2rad(0.5)
    view_shift: float = 4e-3

    def prepare(self, points: FloatArray) -> PreparedCloud:
        """Return points [m], shape (n, 3), ready for registration."""
        library = require("small_gicp")
        cloud, tree = library.preprocess_points(
            np.ascontiguousarray(points, np.float64), self.voxel, self.neighbours, num_threads=1
        )
        return PreparedCloud(np.asarray(cloud.points())[:, :3], cloud, tree)

    def __call__(self, target: PreparedCloud, source: PreparedCloud, start: FloatArray) -> Registration:
        """Return the pose that takes `source` to `target`.

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
        for reach in self.reach:
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
        systematic = carry @ np.diag(np.repeat([self.view_turn, self.view_shift], 3) ** 2) @ carry.T
        inliers = found / max(len(source), 1)
        return Registration(pose, np.asarray(result.H), float(np.sqrt(error)), inliers, error, systematic)


def _at(point: FloatArray) -> FloatArray:
    moved = np.eye(4)
    moved[:3, 3] = point
    return moved
