"""Alignment of many clouds of one body whose attitudes are known: only their positions are adjusted."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from safe_inspect.types import BoolArray, FloatArray, IntArray

#: Distance along the normal beyond which two points do not count, in each step [m]: the errors decrease.
_CUTS = (0.12, 0.12, 0.08, 0.08, 0.05, 0.05, 0.03, 0.03, 0.03, 0.02, 0.02, 0.02)
#: Minimum standard deviation of such a distance [m], its ratio to the cut while points are farther apart, and number of
#: independent distances between two clouds: neighbouring points have similar errors.
_DISTANCE, _SHARE, _INDEPENDENT = 0.008, 0.3, 30
#: Largest angle between the views of two clouds that are compared, number of clouds that one is compared with, and
#: minimum cosine between the normals of two points.
_LEAST_VIEW, _PARTNERS, _LEAST_ALONG = np.cos(np.deg2rad(50.0)), 14, 0.8
#: Number of points of a cloud that are compared with another one, and minimum number of those that have a counterpart.
_COMPARED, _LEAST_POINTS = 100, 10
#: Standard deviation of the given positions [m], and of the change of their error's rate in one second [m/s].
_POSITION, _CHANGE = 0.3, 3e-4


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

    def rotated(self, rotation: FloatArray) -> OrientedPoints:
        """Return points that are rotated about the origin, by a matrix of shape (3, 3)."""
        return OrientedPoints(self.points @ rotation.T, self.normals @ rotation.T, self.weights)


def aligned_positions(
    clouds: Sequence[OrientedPoints],
    times: FloatArray,
    poses: FloatArray,
    R_GW: FloatArray,  # noqa: N803
    axis: FloatArray,
) -> FloatArray:
    """Return positions of the chaser in G for which clouds of one rigid body coincide, shape (F, 3).

    Each cloud is compared with several others of similar views, also of other turns of the body, and the distances of
    points along the normals of their counterparts are minimised over all positions at once. Directions that no pair of
    clouds shows are known from the given positions, whose errors in the inertial frame change slowly: they come from an
    inertial unit.

    Args:
        clouds: The points in B of each frame.
        times: Times of the frames [s], ascending, shape (F,).
        poses: Initial T_GB, whose attitudes are kept, shape (F, 4, 4).
        R_GW: Rotations from the inertial frame to G, shape (F, 3, 3).
        axis: Optical axis of the camera in B, shape (3,).
    """
    from scipy.spatial import cKDTree  # slow to import

    count, rotations, start = len(clouds), poses[:, :3, :3], poses[:, :3, 3]
    turned = [cloud.rotated(rotation) for cloud, rotation in zip(clouds, rotations, strict=True)]
    trees = [cKDTree(cloud.points) for cloud in turned]
    pairs = list(_pairs(rotations @ axis))
    prior = _slow_errors(times, R_GW)
    positions = start.copy()
    for cut in _CUTS:
        hessian = prior.copy()
        gradient = (prior @ (positions - start).ravel()).reshape(count, 3)
        blocks = hessian.reshape(count, 3, count, 3)
        for i, j in pairs:
            between = positions[i] - positions[j]
            found = _compare(turned[i], turned[j], trees[j], between, cut)
            if found is None:
                continue
            normals, pull = found
            blocks[i, :, i] += normals
            blocks[j, :, j] += normals
            blocks[i, :, j] -= normals
            blocks[j, :, i] -= normals
            gradient[i] += pull
            gradient[j] -= pull
        positions = positions - np.linalg.solve(hessian, gradient.ravel()).reshape(count, 3)
    return positions


def _pairs(views: FloatArray) -> Iterator[tuple[int, int]]:
    """Yield pairs of frames that see the body from similar sides, and consecutive ones, given their views, (F, 3)."""
    similar: BoolArray = views @ views.T > _LEAST_VIEW
    np.fill_diagonal(similar, val=False)
    for i, row in enumerate(similar):
        others: IntArray = np.flatnonzero(row)
        if len(others) > _PARTNERS:
            others = others[np.linspace(0, len(others) - 1, _PARTNERS).astype(int)]
        after = {i + 1} if i + 1 < len(views) else set()
        yield from ((i, j) for j in sorted({*others.tolist(), *after}))


def _compare(
    first: OrientedPoints, second: OrientedPoints, tree: Any, between: FloatArray, cut: float
) -> tuple[FloatArray, FloatArray] | None:
    """Return the normal equations of the position of a cloud relative to another one, (3, 3) and (3,), if they overlap.

    Args:
        first: The cloud.
        second: The other cloud, whose points and normals are the counterparts.
        tree: Search tree of its points.
        between: The position [m], shape (3,).
        cut: Distance along the normal beyond which points do not count [m].
    """
    chosen = np.linspace(0, len(first.points) - 1, min(_COMPARED, len(first.points))).astype(int)
    moved = first.points[chosen] + between
    distance, index = tree.query(moved, distance_upper_bound=2.0 * cut)
    seen = np.isfinite(distance)
    moved, index, chosen = moved[seen], index[seen], chosen[seen]
    normals = second.normals[index]
    heights = ((moved - second.points[index]) * normals).sum(axis=1)
    used = ((normals * first.normals[chosen]).sum(axis=1) > _LEAST_ALONG) & (np.abs(heights) < cut)
    if used.sum() < _LEAST_POINTS:
        return None
    normals, heights = normals[used], heights[used]
    # Tukey's biweight
    sigma = max(_DISTANCE, _SHARE * cut)
    weights = _INDEPENDENT / _COMPARED * (1.0 - (heights / cut) ** 2) ** 2 / sigma**2
    weighted = weights[:, None] * normals
    return weighted.T @ normals, weighted.T @ heights


def _slow_errors(times: FloatArray, R_GW: FloatArray) -> FloatArray:  # noqa: N803
    """Return the information matrix of the errors of positions, which change slowly in the inertial frame.

    Args:
        times: Times [s], ascending, shape (F,).
        R_GW: Rotations from the inertial frame to the one of the positions, shape (F, 3, 3).
    """
    count, elapsed = len(times), np.diff(times)[:, None]
    rates = np.diff(np.eye(count), axis=0) / elapsed
    changes = np.diff(rates, axis=0) / (_CHANGE * np.sqrt(0.5 * (elapsed[1:] + elapsed[:-1])))
    inertial = changes.T @ changes + np.eye(count) / _POSITION**2
    return np.asarray(np.einsum("aik,ab,bjk->aibj", R_GW, inertial, R_GW)).reshape(3 * count, 3 * count)
