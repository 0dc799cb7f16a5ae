"""Alignment of many clouds of one rigid body: their poses are adjusted until they coincide."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from safe_inspect.rendezvous.poses import inverse, move, pose, rotation_exp
from safe_inspect.types import BoolArray, FloatArray, IntArray

#: Distance along the normal beyond which two points do not count, in each step [m]: the errors decrease.
_CUTS = (0.12, 0.08, 0.05, 0.05, 0.03, 0.03, 0.02, 0.02, 0.015, 0.015, *[0.01] * 8)
#: Minimum standard deviation of such a distance [m], its ratio to the cut while points are farther apart, and number of
#: independent distances between two clouds: neighbouring points have similar errors.
_DISTANCE, _SHARE, _INDEPENDENT = 0.003, 0.3, 30
#: Largest angle between the views of two clouds that are compared, number of clouds that one is compared with, and
#: minimum cosine between the normals of two points.
_LEAST_VIEW, _PARTNERS, _LEAST_ALONG = np.cos(np.deg2rad(50.0)), 14, 0.8
#: Number of points of a cloud that are compared with another one, and minimum number of those that have a counterpart.
_COMPARED, _LEAST_POINTS = 100, 10
#: Standard deviations of the given poses, and of the change of their errors' rates in one second, about and along each
#: axis [rad, m].
_GIVEN, _CHANGE = (np.deg2rad(2.0), 0.3), (np.deg2rad(0.005), 3e-4)


class OrientedPoints(NamedTuple):
    """Points on the surface in one frame, in B.

    Attributes:
        points: Positions [m], shape (n, 3).
        normals: Normals towards the camera, shape (n, 3).
        weights: Inverse variances of their ranges [1/m^2], shape (n,).
    """

    points: FloatArray
    normals: FloatArray
    weights: FloatArray

    def moved(self, transform: FloatArray) -> OrientedPoints:
        """Return the points after a rigid motion, shape (4, 4)."""
        return OrientedPoints(move(transform, self.points), self.normals @ transform[:3, :3].T, self.weights)

    def sampled(self, count: int) -> tuple[FloatArray, FloatArray]:
        """Return positions and normals of some of the points, evenly chosen, shape (count, 3) each."""
        chosen = np.linspace(0, len(self.points) - 1, count).astype(int)
        return self.points[chosen], self.normals[chosen]


def aligned_poses(
    clouds: Sequence[OrientedPoints],
    times: FloatArray,
    poses: FloatArray,
    R_GW: FloatArray,  # noqa: N803
    axis: FloatArray,
) -> FloatArray:
    """Return poses T_GB at which the clouds of one rigid body coincide, shape (F, 4, 4).

    Each cloud is compared with several others of similar views, also of other turns of the body, and the distances of
    points along the normals of their counterparts are minimised over all poses at once. Directions that no pair of
    clouds shows are known from the given poses, whose errors in the inertial frame change slowly: attitudes come from a
    fitted motion of the body, and positions from an inertial unit.

    Args:
        clouds: The points in B of each frame.
        times: Times of the frames [s], ascending, shape (F,).
        poses: Initial T_GB, for an origin of G at the centre of mass, shape (F, 4, 4).
        R_GW: Rotations from the inertial frame to G, shape (F, 3, 3).
        axis: Optical axis of the camera in B, shape (3,).
    """
    from scipy.spatial import cKDTree  # slow to import

    count = len(clouds)
    given = [cloud.moved(one) for cloud, one in zip(clouds, poses, strict=True)]
    trees = [cKDTree(cloud.points) for cloud in given]
    sampled = [cloud.sampled(_COMPARED) for cloud in given]
    points, normals = (np.stack(each) for each in zip(*sampled, strict=True))
    partners = _partners(poses[:, :3, :3] @ axis)
    prior = _slow_errors(times, R_GW)
    corrections, total = np.tile(np.eye(4), (count, 1, 1)), np.zeros(6 * count)
    for cut in _CUTS:
        hessian = prior.copy()
        gradient = (prior @ total).reshape(count, 6)
        blocks = hessian.reshape(count, 6, count, 6)
        rotations = corrections[:, :3, :3].transpose(0, 2, 1)
        moved = OrientedPoints(points @ rotations + corrections[:, None, :3, 3], normals @ rotations, np.ones(0))
        for j, others in enumerate(partners):
            if len(others):
                shown, pull = _compare(moved, others, given[j], trees[j], corrections[j], cut)
                blocks[others, :, others] += shown
                blocks[j, :, j] += shown.sum(axis=0)
                blocks[others, :, j] -= shown
                blocks[j, :, others] -= shown
                gradient[others] += pull
                gradient[j] -= pull.sum(axis=0)
        step = -np.asarray(np.linalg.solve(hessian, gradient.ravel()))
        total += step
        steps = [pose(rotation_exp(one[:3]), one[3:]) for one in step.reshape(count, 6)]
        corrections = np.stack(steps) @ corrections
    return corrections @ poses


def _partners(views: FloatArray) -> list[IntArray]:
    """Return for each frame those that are compared with it, given the frames' views, shape (F, 3).

    They see the body from similar sides, or are consecutive.
    """
    similar: BoolArray = views @ views.T > _LEAST_VIEW
    np.fill_diagonal(similar, val=False)
    partners = np.zeros_like(similar)
    for i, row in enumerate(similar):
        others: IntArray = np.flatnonzero(row)
        if len(others) > _PARTNERS:
            others = others[np.linspace(0, len(others) - 1, _PARTNERS).astype(int)]
        partners[others, i] = True
        partners[i + 1 : i + 2, i] = True
    return [np.flatnonzero(row) for row in partners]


def _compare(
    moved: OrientedPoints, others: IntArray, cloud: OrientedPoints, tree: Any, correction: FloatArray, cut: float
) -> tuple[FloatArray, FloatArray]:
    """Return the normal equations of the poses of frames relative to a cloud, shape (n, 6, 6) and (n, 6).

    The tangents are those from the left: rotations about the origin [rad] and translations [m]. The equations are zero
    for frames that do not overlap with the cloud.

    Args:
        moved: Some points of all frames, with their corrections, shape (F, k, 3).
        others: Indices of the frames that are compared, shape (n,).
        cloud: The cloud without its correction, whose points and normals are the counterparts.
        tree: Search tree of its points.
        correction: Its correction, shape (4, 4).
        cut: Distance along the normal beyond which points do not count [m].
    """
    points = moved.points[others]
    there = move(inverse(correction), points.reshape(-1, 3)).reshape(points.shape)
    distance, index = tree.query(there, distance_upper_bound=2.0 * cut)
    near = np.isfinite(distance)
    index = np.where(near, index, 0)
    normals = cloud.normals[index]
    heights = ((there - cloud.points[index]) * normals).sum(axis=-1)
    normals = normals @ correction[:3, :3].T
    used = near & ((normals * moved.normals[others]).sum(axis=-1) > _LEAST_ALONG) & (np.abs(heights) < cut)
    used &= used.sum(axis=1, keepdims=True) >= _LEAST_POINTS
    # Tukey's biweight
    sigma = max(_DISTANCE, _SHARE * cut)
    weights = used * _INDEPENDENT / _COMPARED * (1.0 - np.minimum(heights / cut, 1.0) ** 2) ** 2 / sigma**2
    rows = np.concatenate([np.cross(points, normals), normals], axis=-1)
    weighted = (weights[..., None] * rows).transpose(0, 2, 1)
    return weighted @ rows, (weighted @ heights[..., None])[..., 0]


def _slow_errors(times: FloatArray, R_GW: FloatArray) -> FloatArray:  # noqa: N803
    """Return the information matrix of the errors of poses, which change slowly in the inertial frame.

    Args:
        times: Times [s], ascending, shape (F,).
        R_GW: Rotations from the inertial frame to the one of the poses, shape (F, 3, 3).
    """
    count, elapsed = len(times), np.diff(times)[:, None]
    rates = np.diff(np.eye(count), axis=0) / elapsed
    changes = np.diff(rates, axis=0) / np.sqrt(0.5 * (elapsed[1:] + elapsed[:-1]))
    information = np.zeros((count, 2, 3, count, 2, 3))
    for kind, (given, change) in enumerate(zip(_GIVEN, _CHANGE, strict=True)):
        inertial = changes.T @ changes / change**2 + np.eye(count) / given**2
        information[:, kind, :, :, kind] = np.einsum("aik,ab,bjk->aibj", R_GW, inertial, R_GW)
    return information.reshape(6 * count, 6 * count)
