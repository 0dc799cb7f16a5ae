"""Registration without a prediction: point features, consistent matches and a robust fit.

Sources:
    Rusu, Blodow and Beetz, "Fast point feature histograms (FPFH) for 3D registration", ICRA 2009.
    Yang, Antonante, Tzoumas and Carlone, "Graduated non-convexity for robust spatial perception", RA-L 2020.
    Horn, "Closed-form solution of absolute orientation using unit quaternions", JOSA A 1987.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from safe_inspect.rendezvous.poses import move, pose
from safe_inspect.types import BoolArray, FloatArray, IntArray

#: Bins of each of the three angles of a feature.
_BINS = 11


@dataclass(frozen=True, eq=False)
class FeatureCloud:
    """Points with their features.

    Attributes:
        points: Positions [m], shape (n, 3).
        features: Histograms that add up to 1 for each angle, shape (n, 33).
    """

    points: FloatArray
    features: FloatArray


def point_features(points: FloatArray, normals: FloatArray, radius: float, neighbours: int = 40) -> FloatArray:
    """Return the fast point feature histogram of each point, shape (n, 33).

    Args:
        points: Positions [m], shape (n, 3).
        normals: Unit normals, all to the side of the camera, shape (n, 3).
        radius: Radius of the neighbourhood [m].
        neighbours: Largest number of neighbours.
    """
    from scipy.spatial import cKDTree  # slow to import

    count = len(points)
    distance, index = cKDTree(points).query(points, k=min(neighbours + 1, count), distance_upper_bound=radius)
    distance, index = distance[:, 1:], index[:, 1:]
    near = np.isfinite(distance) & (distance > 1e-9)
    index = np.where(near, index, 0)
    safe = np.where(near, distance, 1.0)
    u = normals[:, None, :]
    line = (points[index] - points[:, None, :]) / safe[..., None]
    v = np.cross(u, line)
    v = v / np.maximum(np.linalg.norm(v, axis=2, keepdims=True), 1e-9)
    w = np.cross(np.broadcast_to(u, v.shape), v)
    other = normals[index]
    alpha = np.einsum("nki,nki->nk", v, other)
    phi = np.einsum("nki,nki->nk", np.broadcast_to(u, line.shape), line)
    theta = np.arctan2(np.einsum("nki,nki->nk", w, other), np.einsum("nki,nki->nk", np.broadcast_to(u, v.shape), other))
    simple = np.zeros((count, 3, _BINS))
    rows = np.broadcast_to(np.arange(count)[:, None], index.shape)
    for angle, (value, low, high) in enumerate(((alpha, -1.0, 1.0), (phi, -1.0, 1.0), (theta, -np.pi, np.pi))):
        bins = np.clip(((value - low) / (high - low) * _BINS).astype(int), 0, _BINS - 1)
        np.add.at(simple, (rows[near], angle, bins[near]), 1.0)
    simple /= np.maximum(simple.sum(axis=2, keepdims=True), 1.0)
    weight = np.where(near, 1.0 / np.maximum(safe, 1e-3), 0.0)
    mean = np.einsum("nk,nkab->nab", weight, simple[index]) / np.maximum(weight.sum(axis=1), 1e-9)[:, None, None]
    full = simple + mean
    return np.asarray((full / np.maximum(full.sum(axis=2, keepdims=True), 1e-9)).reshape(count, -1))


def match(first: FeatureCloud, second: FeatureCloud) -> IntArray:
    """Return pairs of points that are nearest to each other in the space of features, shape (m, 2)."""
    from scipy.spatial import cKDTree  # slow to import

    if not len(first.points) or not len(second.points):
        return np.zeros((0, 2), np.int64)
    forth = cKDTree(second.features).query(first.features)[1]
    back = cKDTree(first.features).query(second.features)[1]
    rows = np.arange(len(first.points))
    mutual = back[forth] == rows
    return np.stack([rows[mutual], forth[mutual]], axis=1).astype(np.int64)


def consistent(first: FloatArray, second: FloatArray, tolerance: float) -> IntArray:
    """Return a large set of matches whose distances agree pairwise, by a greedy clique.

    Matches i and j agree when ``| |a_i - a_j| - |b_i - b_j| | < 2 tolerance``: a rigid motion keeps distances.

    Args:
        first: Points a [m], shape (m, 3).
        second: Points b [m], shape (m, 3).
        tolerance: Error of a point [m].
    """
    if len(first) == 0:
        return np.zeros(0, np.int64)
    apart = [np.linalg.norm(points[:, None] - points[None], axis=2) for points in (first, second)]
    agree = np.abs(apart[0] - apart[1]) < 2.0 * tolerance
    np.fill_diagonal(agree, val=False)
    best: list[int] = []
    degree = agree.sum(axis=1)
    for seed in np.argsort(-degree, kind="stable")[:20]:
        clique, left = [int(seed)], agree[seed].copy()
        while left.any():
            following = int(np.argmax(np.where(left, (agree & left).sum(axis=1), -1)))
            clique.append(following)
            left &= agree[following]
        best = max(best, clique, key=len)
    return np.array(sorted(best))


def horn(first: FloatArray, second: FloatArray, weights: FloatArray) -> FloatArray:
    """Return the pose T with ``first = T second`` in the sense of weighted least squares, shape (4, 4).

    Args:
        first: Points [m], shape (m, 3).
        second: Points [m], shape (m, 3).
        weights: Not negative, not all zero, shape (m,).
    """
    share = (weights / weights.sum())[:, None]
    a, b = (share * first).sum(axis=0), (share * second).sum(axis=0)
    u, _, vt = np.linalg.svd((share * (first - a)).T @ (second - b))
    sign = np.diag([1.0, 1.0, np.linalg.det(u) * np.linalg.det(vt)])
    rotation = u @ sign @ vt
    return pose(rotation, a - rotation @ b)


def robust_pose(first: FloatArray, second: FloatArray, tolerance: float) -> tuple[FloatArray, BoolArray]:
    """Return the pose that fits most pairs, shape (4, 4), and which pairs it fits, shape (m,).

    Truncated least squares by graduated non-convexity: the cost is convex at first and becomes the truncated one.

    Args:
        first: Points [m], shape (m, 3).
        second: Points [m], shape (m, 3).
        tolerance: Distance within which a pair fits [m].
    """
    weights = np.ones(len(first))
    found = horn(first, second, weights)
    square = ((first - move(found, second)) ** 2).sum(axis=1)
    limit = tolerance**2
    mu = limit / max(2.0 * float(square.max()) - limit, 1e-12)
    for _ in range(60):
        low, high = mu / (mu + 1.0) * limit, (mu + 1.0) / mu * limit
        middle = np.sqrt(limit * mu * (mu + 1.0) / np.maximum(square, 1e-18)) - mu
        weights = np.where(square <= low, 1.0, np.where(square >= high, 0.0, middle))
        if weights.sum() < 1e-9:
            break
        found = horn(first, second, weights)
        square = ((first - move(found, second)) ** 2).sum(axis=1)
        mu *= 1.4
        if mu > 1e6:
            break
    return found, square <= limit
