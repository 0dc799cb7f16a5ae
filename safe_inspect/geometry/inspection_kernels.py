"""Kernels for the points that deputies see from their positions in the state: `visibility` and `clusters`, fused."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from safe_inspect.compiling import njit
from safe_inspect.geometry.clusters import KMeansRule, RowDraws, cluster_row, require_centres
from safe_inspect.geometry.visibility import Credit, Surface, inspect_points, light_row, point_axes
from safe_inspect.types import BoolArray, FloatArray, IntArray


class Scores(NamedTuple):
    """Weights of the inspected points of N environments.

    Attributes:
        weights: Weight of each point [-], shape (N, P).
        team: Total weight of the inspected points [-], shape (N,).
        own: Total weight of the points that each deputy was the first to inspect [-], shape (N, D).
    """

    weights: FloatArray
    team: FloatArray
    own: FloatArray


@njit
def inspect_body(
    position: FloatArray,
    body: int,
    sun: FloatArray,
    surface: Surface,
    cos_half_fov: float,
    active: BoolArray,
    credit: Credit,
    scores: Scores,
) -> None:
    """Apply `inspect_points` to the state's positions, and update the sums of weights where points are inspected.

    Args:
        position: Positions of the bodies, the deputies first [m], shape (N, B, 3).
        body: Index of the body that carries the points.
        sun: Unit vectors to the sun [-], shape (N, 3).
        surface: The points of the body, relative to its centre.
        cos_half_fov: Cosine of half the field of view about the direction to the body [-]; -1 means no limit.
        active: Whether a deputy's sensor is working, shape (N, D).
        credit: Inspected points and their inspectors; read and written.
        scores: Weights of the inspected points; read and written.
    """
    environments, deputies = credit.own_count.shape
    before = credit.team_count.copy()
    viewer = np.empty((environments, deputies, 3))
    for n in range(environments):
        for d in range(deputies):
            for axis in range(3):
                viewer[n, d, axis] = position[n, d, axis] - position[n, body, axis]
    inspect_points(viewer, sun, surface, cos_half_fov, active, credit)
    for n in range(environments):
        if credit.team_count[n] != before[n]:
            sum_scores(n, credit, scores)


@njit
def sum_scores(row: int, credit: Credit, scores: Scores) -> None:
    """Recompute the sums of the weights of the inspected points of one environment.

    Args:
        row: The environment.
        credit: Inspected points and their inspectors.
        scores: Weights of the inspected points; read and written.
    """
    scores.team[row] = 0.0
    scores.own[row] = 0.0
    for p in range(credit.inspector.shape[1]):
        who = credit.inspector[row, p]
        if who >= 0:
            scores.team[row] += scores.weights[row, p]
            scores.own[row, who] += scores.weights[row, p]


@njit
def cluster_candidates(
    position: FloatArray,
    body: int,
    deputies: tuple[int, int],
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
    """Apply `cluster` to the points that are lit, as seen by each deputy of a group, and have no inspector.

    Args:
        position: Positions of the bodies, the deputies first [m], shape (N, B, 3).
        body: Index of the body that carries the points.
        deputies: Index of the group's first deputy, and their number, G; R = N * G rows.
        sun: Unit vectors to the sun [-], shape (N, 3).
        surface: The points of the body, relative to its centre.
        inspector: Index of the inspector of each point, -1 for none, shape (N, P).
        centres: See `Clusters`, with R rows; read and written.
        num_centres: See `Clusters`; read and written.
        previous: The candidates of the last call; read and written.
        settled: See `Clusters`; read and written.
        draws: Source of the random draws of each environment, N rows.
        rule: Sizes of the clusters, and the limit of the iterations.

    Raises:
        ValueError: As for `cluster`.
    """
    points, radius, light, (first, size) = surface.points, surface.radius, surface.light, deputies
    key, step = draws.key, draws.step
    require_centres(points, centres, rule)
    total = points.shape[0]
    chosen, own = np.empty(total + 1, dtype=np.int64), np.empty((3, total))
    axes, viewer = point_axes(points), np.empty(3)
    wanted = np.empty(total, dtype=np.bool_)
    for n in range(position.shape[0]):
        for g in range(size):
            row = n * size + g
            for axis in range(3):
                viewer[axis] = position[n, first + g, axis] - position[n, body, axis]
            light_row(viewer, sun[n], axes, radius, light, wanted)
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
