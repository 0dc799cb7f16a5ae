"""What the deputies see from where the state has them: the kernels of `visibility` and `clusters`, fused row by row."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from safe_inspect.compiling import njit
from safe_inspect.geometry.clusters import cluster_row, max_clusters
from safe_inspect.geometry.light import Light
from safe_inspect.geometry.visibility import inspect_points, light_row, point_axes
from safe_inspect.types import BoolArray, FloatArray, IntArray


@njit
def inspect_body(
    position: FloatArray,
    body: int,
    sun: FloatArray,
    points: FloatArray,
    radius: float,
    cos_half_fov: float,
    light: Light,
    active: BoolArray,
    inspector: NDArray[np.int8],
    team_count: IntArray,
    own_count: IntArray,
) -> None:
    """Do `inspect_points` from the state's positions.

    Args:
        position: Positions of the bodies, the deputies first [m], shape (N, B, 3).
        body: Index of the body that carries the points.
        sun: As in `inspect_points`, like the rest.
        points: As there.
        radius: As there.
        cos_half_fov: As there.
        light: As there.
        active: As there.
        inspector: As there.
        team_count: As there.
        own_count: As there.
    """
    environments, deputies = own_count.shape
    viewer = np.empty((environments, deputies, 3))
    for n in range(environments):
        for d in range(deputies):
            for axis in range(3):
                viewer[n, d, axis] = position[n, d, axis] - position[n, body, axis]
    inspect_points(viewer, sun, points, radius, cos_half_fov, light, active, inspector, team_count, own_count)


@njit
def cluster_candidates(
    position: FloatArray,
    body: int,
    first: int,
    size: int,
    sun: FloatArray,
    points: FloatArray,
    radius: float,
    light: Light,
    inspector: NDArray[np.int8],
    centres: FloatArray,
    count: IntArray,
    key: NDArray[np.uint64],
    step: IntArray,
    points_per_cluster: int,
    max_iterations: int,
    previous: BoolArray,
    settled: BoolArray,
) -> None:
    """Do `cluster` of the points that are lit, as each deputy of a group sees them, and have no inspector.

    Args:
        position: Positions of the bodies, the deputies first [m], shape (N, B, 3).
        body: Index of the body that carries the points.
        first: Index of the group's first deputy.
        size: Number of the group's deputies, G; R = N * G rows.
        sun: Unit vectors to the sun [-], shape (N, 3).
        points: Points on the body [m], shape (P, 3).
        radius: Radius of the sphere [m].
        light: The rule of light.
        inspector: Who inspected each point, -1 for nobody, shape (N, P).
        centres: As in `cluster`, like the rest, with R rows.
        count: As there.
        key: As there, but shape (N,).
        step: As there, but shape (N,).
        points_per_cluster: As there.
        max_iterations: As there.
        previous: As there.
        settled: As there.

    Raises:
        ValueError: As `cluster`.
    """
    total = points.shape[0]
    if centres.shape[1] < max_clusters(total, points_per_cluster):
        raise ValueError("centres has less than ceil(P / points_per_cluster) places")
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
                count[row], settled[row] = cluster_row(
                    points, wanted, centres[row], count[row], key[n], step[n], points_per_cluster, max_iterations,
                    chosen, own,
                )  # fmt: skip
                previous[row] = wanted
