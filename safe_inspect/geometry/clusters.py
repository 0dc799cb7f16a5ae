"""Clusters of the points that are left to inspect: K-means from the previous centres, compiled, row by row.

Every row is computed separately and in one fixed order, so its result is bit-identical in a batch of any size.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from safe_inspect.compiling import njit
from safe_inspect.geometry.visibility import Surface, light_row, point_axes
from safe_inspect.random.splitmix import pick_below
from safe_inspect.types import BoolArray, FloatArray, IntArray

# A centre closer to the origin than this [m] differs from it only by rounding and has no direction.
_AT_ORIGIN = 1e-9


class RowDraws(NamedTuple):
    """Source of the rows' random draws: the key, uint64, and the number of the step of each row, shape (R,)."""

    key: NDArray[np.uint64]
    step: IntArray


class KMeansRule(NamedTuple):
    """Candidates per cluster, at least 1, and the maximum number of Lloyd's iterations in a call."""

    points_per_cluster: int
    max_iterations: int


@njit
def max_clusters(num_points: int, points_per_cluster: int) -> int:
    """Return ceil(num_points / points_per_cluster), the length K of an array of centres."""
    return (num_points + points_per_cluster - 1) // points_per_cluster


@njit
def _gather(points: FloatArray, candidates: BoolArray, chosen: IntArray) -> int:
    """Write the indices of a row's candidates, in order, and return their number."""
    total = 0
    for p in range(points.shape[0]):
        chosen[total] = p
        total += candidates[p]
    return total


@njit
def _start(
    points: FloatArray, chosen: IntArray, centres: FloatArray, have: int, want: int, key: np.uint64, step: int
) -> None:
    """Remove or add centres of a row to change their number from `have` to `want`.

    Excess centres are removed from the end. Missing ones are candidates drawn at random, distinct among those added.
    The draw depends only on the key, the step and the number of centres drawn before it.
    """
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
def _fill_empty(
    own: FloatArray, label: IntArray, distance: FloatArray, total: int, sums: FloatArray, weight: IntArray, k: int
) -> None:
    """Move to each empty cluster the point that is farthest from its centre, and remove it from its previous cluster.

    The points, one for each empty cluster and farthest first, are chosen before the first is moved; the labels do not
    change. If every point is at its centre, nothing can be improved and nothing is moved.
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
    """Write the nearest centre of each point (the first one in a tie) and its squared distance."""
    x, y, z = own[0], own[1], own[2]
    for j in range(k):
        cx, cy, cz = centres[j, 0], centres[j, 1], centres[j, 2]
        for m in range(total):  # without a branch, so that the compiler can vectorise the loop
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
            if weight[j] == 0:  # a cluster that lost its only point gets the centre of the largest one
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
            # The labels repeat, but a cluster was empty: the next iteration may still move the centres.
            return False
        label, before = before, label
    return False


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
    """Cluster one row's candidates by K-means, starting from the row's previous centres.

    In Lloyd's iterations each candidate is assigned to the nearest centre, and each centre moves to the mean of its
    candidates, until the assignments no longer change. An empty cluster receives the candidate farthest from its
    centre. The number of centres is one for every `points_per_cluster` candidates, rounded up.

    Args:
        points: Points on the chief [m], shape (P, 3).
        candidates: Points to cluster, shape (P,).
        centres: The row's centres [m], shape (K, 3); read and written.
        num_centres: Number of centres.
        key: Key of the row's random draws.
        step: Number of the row's step.
        rule: Sizes of the clusters, and the limit of the iterations.
        chosen: Workspace, shape (P + 1,).
        own: Workspace, shape (3, P).

    Returns:
        The number of centres, and whether the iterations converged.

    Source:
        Lloyd, "Least squares quantization in PCM", 1982.
    """
    total = _gather(points, candidates, chosen)
    want = max_clusters(total, rule.points_per_cluster)
    _start(points, chosen[:total], centres, num_centres, want, key, step)
    for m in range(total):
        for axis in range(3):
            own[axis, m] = points[chosen[m], axis]
    return want, total == 0 or _lloyd(own, total, centres, want, rule.max_iterations)


@njit
def cluster_candidates(
    size: int,
    sun: FloatArray,
    surface: Surface,
    inspector: NDArray[np.int8],
    centres: FloatArray,
    num_centres: IntArray,
    previous: BoolArray,
    settled: BoolArray,
    draws: RowDraws,
    rule: KMeansRule,
) -> None:
    """Cluster the points that are lit and have no inspector, for each deputy of a group; see `cluster_row`.

    A row that had converged and whose candidates are those of its last call is not changed, since the iterations would
    give bit-identical centres.

    Args:
        size: Number of deputies of the group, G; R = N * G rows.
        sun: Unit vectors to the sun [-], shape (N, 3).
        surface: The points of the body, relative to its centre.
        inspector: Index of the inspector of each point, -1 for none, shape (N, P).
        centres: Centres [m], those beyond the number of centres are 0, shape (R, K, 3); read and written.
        num_centres: Number of centres of each row, shape (R,); read and written. Set it to 0 to restart.
        previous: The candidates of the last call, shape (R, P); read and written.
        settled: Whether the last call converged, shape (R,); read and written. Set it to False to restart.
        draws: Source of the random draws of each environment, N rows.
        rule: Sizes of the clusters, and the limit of the iterations.

    Raises:
        ValueError: There are too few places for centres.
    """
    points, key, step = surface.points, draws.key, draws.step
    total = points.shape[0]
    if centres.shape[1] < max_clusters(total, rule.points_per_cluster):
        raise ValueError("centres has fewer than ceil(P / points_per_cluster) places")
    chosen, own = np.empty(total + 1, dtype=np.int64), np.empty((3, total))
    axes, wanted = point_axes(points), np.empty(total, dtype=np.bool_)
    for n in range(sun.shape[0]):
        for g in range(size):
            row = n * size + g
            light_row(sun[n], axes, surface.terminator, wanted)
            different = not settled[row]
            for p in range(total):
                wanted[p] = wanted[p] & (inspector[n, p] < 0)
                different |= wanted[p] != previous[row, p]
            if different:
                num_centres[row], settled[row] = cluster_row(
                    points, wanted, centres[row], num_centres[row], key[n], step[n], rule, chosen, own
                )
                for p in range(total):
                    previous[row, p] = wanted[p]


@njit
def direction_to_nearest(
    viewer: FloatArray, body: FloatArray, centres: FloatArray, count: int, direction: FloatArray
) -> None:
    """Write the direction from a body's centre to the cluster that is nearest to a viewer.

    This is the unit vector c/abs(c) of the centre c with the smallest distance abs(p - c), the first one in a tie;
    zeros if there is no cluster or the nearest centre is the origin.

    Args:
        viewer: Position of the viewer [m], shape (3,).
        body: Position of the body [m], shape (3,); p is the viewer's position relative to it.
        centres: Centres of the clusters relative to the body [m], shape (K, 3).
        count: Number of centres in use.
        direction: Output: the direction [-], shape (3,).
    """
    px, py, pz = viewer[0] - body[0], viewer[1] - body[1], viewer[2] - body[2]
    best, least = -1, math.inf
    for k in range(count):
        squared = (px - centres[k, 0]) ** 2
        squared += (py - centres[k, 1]) ** 2
        squared += (pz - centres[k, 2]) ** 2
        if squared < least:
            best, least = k, squared
    direction[0] = direction[1] = direction[2] = 0.0
    if best < 0:
        return
    x, y, z = centres[best, 0], centres[best, 1], centres[best, 2]
    length = math.sqrt(x * x + y * y + z * z)
    if length > _AT_ORIGIN:
        direction[0], direction[1], direction[2] = x / length, y / length, z / length
