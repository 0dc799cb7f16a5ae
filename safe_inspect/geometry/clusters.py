"""Clusters of the points that are left to inspect: K-means from the previous centres, compiled, row by row.

Every row is computed by itself and in one fixed order, so its result is the same to the bit in a batch of any size.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from safe_inspect.compiling import njit
from safe_inspect.random.integers import pick_below
from safe_inspect.types import BoolArray, FloatArray, IntArray

__all__ = ["Clusters", "KMeansRule", "RowDraws", "cluster", "cluster_sklearn", "start_centres"]


class Clusters(NamedTuple):
    """What is kept of R rows between two calls; read and written.

    Attributes:
        centres: Centres [m], shape (R, K, 3). See `start_centres`.
        num_centres: How many centres a row has, shape (R,). Set to 0 to start anew.
        candidates: Candidates of the last call, shape (R, P).
        settled: Whether the last call converged, shape (R,). Set to False to start anew.
    """

    centres: FloatArray
    num_centres: IntArray
    candidates: BoolArray
    settled: BoolArray


class RowDraws(NamedTuple):
    """Where the random draws of rows come from: the key, uint64, and the number of the step of each, shape (R,)."""

    key: NDArray[np.uint64]
    step: IntArray


class KMeansRule(NamedTuple):
    """Candidates per cluster, at least 1, and most of Lloyd's iterations in a call."""

    points_per_cluster: int
    max_iterations: int


@njit
def max_clusters(num_points: int, points_per_cluster: int) -> int:
    """Return ceil(num_points / points_per_cluster), the length K of an array of centres."""
    if points_per_cluster < 1:
        raise ValueError("points_per_cluster must be at least 1")
    return (num_points + points_per_cluster - 1) // points_per_cluster


@njit
def _gather(points: FloatArray, candidates: BoolArray, chosen: IntArray) -> int:
    """Write the indices of a row's candidates, in order, and return how many there are."""
    total = 0
    for p in range(points.shape[0]):
        chosen[total] = p
        total += candidates[p]
    return total


@njit
def _start(
    points: FloatArray, chosen: IntArray, centres: FloatArray, have: int, want: int, key: np.uint64, step: int
) -> None:
    """Cut or grow a row's centres from `have` to `want`; see `start_centres`."""
    for j in range(want, centres.shape[0]):
        for k in range(3):
            centres[j, k] = 0.0
    if have >= want:
        return
    # The first steps of a Fisher-Yates shuffle give distinct candidates with one draw each.
    deck = chosen.copy()
    for pick in range(want - have):
        other = pick + pick_below(key, step, pick, len(deck) - pick)
        deck[pick], deck[other] = deck[other], deck[pick]
        for k in range(3):
            centres[have + pick, k] = points[deck[pick], k]


@njit
def start_centres(
    points: FloatArray,
    candidates: BoolArray,
    centres: FloatArray,
    count: IntArray,
    key: NDArray[np.uint64],
    step: IntArray,
    points_per_cluster: int,
) -> None:
    """Bring each row's centres to one for every `points_per_cluster` candidates, rounded up.

    Centres in excess are dropped from the end; missing ones are candidates drawn at random, distinct among
    those added. The draw is a pure function of (key, step, how many were drawn before it).

    Args:
        points: Points on the chief [m], shape (P, 3).
        candidates: Points to cluster, shape (N, P).
        centres: Centres [m], shape (N, K, 3) with K at least ceil(P / points_per_cluster); read and written.
            Those beyond the count are set to 0.
        count: How many centres a row has, shape (N,); read and written.
        key: Key of a row's random draws, shape (N,).
        step: Number of a row's step, shape (N,).
        points_per_cluster: Candidates per cluster, at least 1.

    Raises:
        ValueError: If `centres` is too small or `points_per_cluster` is not positive.
    """
    if centres.shape[1] < max_clusters(points.shape[0], points_per_cluster):
        raise ValueError("centres has less than ceil(P / points_per_cluster) places")
    chosen = np.empty(points.shape[0] + 1, dtype=np.int64)
    for row in range(candidates.shape[0]):
        total = _gather(points, candidates[row], chosen)
        want = max_clusters(total, points_per_cluster)
        _start(points, chosen[:total], centres[row], count[row], want, key[row], step[row])
        count[row] = want


@njit
def _fill_empty(
    own: FloatArray, label: IntArray, distance: FloatArray, total: int, sums: FloatArray, weight: IntArray, k: int
) -> None:
    """Give each empty cluster the point farthest from its centre, taken out of the cluster that had it.

    The points are fixed before the first is moved, one for each empty cluster, farthest first; labels stay. When no
    point lies off its centre there is nothing to gain and nothing moves.
    """
    vacant, far, count = np.empty(k, dtype=np.int64), np.empty(k, dtype=np.int64), 0
    for j in range(k):
        vacant[count] = j
        count += weight[j] == 0
    for i in range(count):
        best = 0
        for m in range(total):
            if distance[m] > distance[best]:
                best = m
        if i == 0 and distance[best] == 0.0:
            return
        far[i] = best
        distance[best] = -1.0
    for i in range(count):
        new, old = vacant[i], label[far[i]]
        for axis in range(3):
            sums[old, axis] -= own[axis, far[i]]
            sums[new, axis] = own[axis, far[i]]
        weight[old] -= 1
        weight[new] = 1


@njit
def _assign(own: FloatArray, total: int, centres: FloatArray, k: int, label: IntArray, distance: FloatArray) -> None:
    """Write each point's nearest centre (the first of equals) and its squared distance."""
    x, y, z = own[0], own[1], own[2]
    for j in range(k):
        cx, cy, cz = centres[j, 0], centres[j, 1], centres[j, 2]
        for m in range(total):  # without a branch, so that the compiler works on several points at once
            squared = (x[m] - cx) ** 2 + (y[m] - cy) ** 2 + (z[m] - cz) ** 2
            nearer = (j == 0) | (squared < distance[m])
            distance[m] = squared if nearer else distance[m]
            label[m] = j if nearer else label[m]


@njit
def _average(own: FloatArray, total: int, label: IntArray, distance: FloatArray, centres: FloatArray, k: int) -> bool:
    """Move each centre to the mean of its points; return whether a cluster was empty."""
    sums, weight = np.empty((k, 3)), np.empty(k, dtype=np.int64)
    for j in range(k):
        weight[j] = 0
        for axis in range(3):
            sums[j, axis] = 0.0
    for m in range(total):
        j = label[m]
        weight[j] += 1
        for axis in range(3):
            sums[j, axis] += own[axis, m]
    vacant = False
    for j in range(k):
        vacant |= weight[j] == 0
    if vacant:
        _fill_empty(own, label, distance, total, sums, weight, k)
    for j in range(k):
        if weight[j] > 0:
            for axis in range(3):
                centres[j, axis] = sums[j, axis] / weight[j]
    if vacant:
        largest = 0
        for j in range(k):
            largest = j if weight[j] > weight[largest] else largest
        for j in range(k):
            if weight[j] == 0:  # a cluster of one that gave its point away waits beside the largest one
                for axis in range(3):
                    centres[j, axis] = centres[largest, axis]
    return vacant


@njit
def _lloyd(own: FloatArray, total: int, centres: FloatArray, k: int, max_iterations: int) -> bool:
    """Run Lloyd's iterations on one row; return whether the centres are a fixed point."""
    label, before = np.empty(total, dtype=np.int64), np.empty(total, dtype=np.int64)
    for m in range(total):
        before[m] = -1
    distance = np.empty(total)
    vacant = False
    for _ in range(max_iterations):
        _assign(own, total, centres, k, label, distance)
        moved = False
        for m in range(total):
            moved |= label[m] != before[m]
        if not (moved or vacant):
            return True
        vacant = _average(own, total, label, distance, centres, k)
        if not moved:
            # The labels repeat, but a cluster was empty: the next run may still move the centres.
            return False
        label, before = before, label
    return False


@njit
def _unchanged(candidates: BoolArray, previous: BoolArray) -> bool:
    """Whether a row's candidates are those of its last call."""
    different = False
    for p in range(len(candidates)):
        different |= candidates[p] != previous[p]
    return not different


@njit
def cluster(
    points: FloatArray,
    candidates: BoolArray,
    clusters: Clusters,
    draws: RowDraws,
    rule: KMeansRule,
) -> None:
    """Cluster each row's candidates by K-means, from the row's previous centres.

    Lloyd's iterations: each candidate goes to the nearest centre, each centre to the mean of its candidates, until
    the candidates stay where they are. An empty cluster takes the candidate farthest from its centre.
    A row whose candidates are those of its last call, and which had converged, is left as it is: the iterations would
    give the same centres to the bit.

    Args:
        points: Points on the chief [m], shape (P, 3).
        candidates: Points to cluster, shape (R, P).
        clusters: The clusters of each row; read and written.
        draws: Where each row's random draws come from.
        rule: Sizes of the clusters, and the limit of the iterations.

    Raises:
        ValueError: If there are too few centres or `points_per_cluster` is not positive.

    Source:
        Lloyd, "Least squares quantization in PCM", 1982.
    """
    centres, num_centres, previous, settled = clusters  # a tuple of arrays costs in every inner call
    require_centres(points, centres, rule)
    chosen, own = np.empty(points.shape[0] + 1, dtype=np.int64), np.empty((3, points.shape[0]))
    for row in range(candidates.shape[0]):
        if not (settled[row] and _unchanged(candidates[row], previous[row])):
            num_centres[row], settled[row] = cluster_row(
                points, candidates[row], centres[row], num_centres[row], draws.key[row], draws.step[row], rule, chosen,
                own,
            )  # fmt: skip
            for p in range(candidates.shape[1]):
                previous[row, p] = candidates[row, p]


@njit
def require_centres(points: FloatArray, centres: FloatArray, rule: KMeansRule) -> None:
    """Raise ValueError, as `cluster`, where there are too few places for centres."""
    if centres.shape[1] < max_clusters(points.shape[0], rule.points_per_cluster):
        raise ValueError("centres has less than ceil(P / points_per_cluster) places")


@njit
def cluster_row(
    points: FloatArray,
    candidates: BoolArray,
    centres: FloatArray,
    num_centres: int,
    key: np.uint64,
    step: int,
    rule: KMeansRule,
    chosen: IntArray,
    own: FloatArray,
) -> tuple[int, bool]:
    """Cluster one row as `cluster` does; return the number of centres and whether the iterations converged.

    Args:
        points: Points on the chief [m], shape (P, 3).
        candidates: Points to cluster, shape (P,).
        centres: The row's centres [m], shape (K, 3); read and written.
        num_centres: How many there are.
        key: Key of the row's random draws.
        step: Number of the row's step.
        rule: Sizes of the clusters, and the limit of the iterations.
        chosen: Workspace, shape (P + 1,).
        own: Workspace, shape (3, P).
    """
    total = _gather(points, candidates, chosen)
    want = max_clusters(total, rule.points_per_cluster)
    _start(points, chosen[:total], centres, num_centres, want, key, step)
    for m in range(total):
        for axis in range(3):
            own[axis, m] = points[chosen[m], axis]
    return want, total == 0 or _lloyd(own, total, centres, want, rule.max_iterations)


def cluster_sklearn(
    points: FloatArray, candidates: BoolArray, clusters: Clusters, draws: RowDraws, rule: KMeansRule
) -> None:
    """Do what `cluster` does with scikit-learn's K-means, from the same start: the reference, and much slower."""
    import warnings

    from sklearn.cluster import KMeans
    from sklearn.exceptions import ConvergenceWarning

    centres, count, previous, settled = clusters
    for row in np.flatnonzero(~settled | (candidates != previous).any(axis=1)):
        one = slice(row, row + 1)
        key, step = draws.key[one], draws.step[one]
        start_centres(points, candidates[one], centres[one], count[one], key, step, rule.points_per_cluster)
        k = int(count[row])
        converged = True
        if k:
            means = KMeans(k, init=centres[row, :k].copy(), n_init=1, max_iter=rule.max_iterations, tol=0.0)
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", ConvergenceWarning)  # fewer distinct centres than clusters
                means.fit(points[candidates[row]])
            centres[row, :k] = means.cluster_centers_
            converged = means.n_iter_ < rule.max_iterations and len(np.unique(means.labels_)) == k
        settled[row] = converged
        previous[row] = candidates[row]
