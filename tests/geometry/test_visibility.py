"""Which points a viewer sees: by hand, against NumPy, and under rotations."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from safe_inspect.geometry.sphere import sphere_points

from .sight import visible

R = 10.0
NO_LIMIT = -1.0
POINTS = sphere_points("fibonacci", 1000, R)


def viewers(seed: int, rows: int, low: float = 10.5, high: float = 300.0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    viewer = rng.normal(size=(rows, 3))
    return viewer * rng.uniform(low, high, (rows, 1)) / np.linalg.norm(viewer, axis=1, keepdims=True)


def by_angles(viewer: np.ndarray, points: np.ndarray, half_fov: float) -> tuple[np.ndarray, np.ndarray]:
    """Return what is seen, by angles at the centre and at the viewer, and each answer's distance from the limits."""
    distance = np.linalg.norm(viewer, axis=1)
    at_centre = np.arccos(np.clip(points @ viewer.T / R / distance, -1.0, 1.0)).T
    view = points[None] - viewer[:, None]
    along = -(view * viewer[:, None]).sum(-1) / np.linalg.norm(view, axis=-1) / distance[:, None]
    at_viewer = np.arccos(np.clip(along, -1.0, 1.0))
    horizon = np.arccos(R / distance)[:, None]
    margin = np.minimum(abs(at_centre - horizon), abs(at_viewer - half_fov))
    return (at_centre <= horizon) & (at_viewer <= half_fov), margin


def test_six_points_by_hand() -> None:
    axes = R * np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], dtype=float)
    viewer = np.array([[50.0, 0, 0], [0, 0, -50.0], [20.0, 20.0, 0.0], [20.0, 9.99, 0.0], [20.0, 10.0, 0.0]])
    seen = visible(viewer, axes, R, NO_LIMIT)
    assert [np.flatnonzero(row).tolist() for row in seen] == [[0], [5], [0, 2], [0], [0, 2]]


@pytest.mark.parametrize("distance", [10.0, 12.0, 15.0, 20.0, 50.0, 100.0, 800.0])
def test_part_of_the_sphere_in_sight(distance: float) -> None:
    viewer = viewers(1, 40, distance, distance)
    counts = visible(viewer, POINTS, R, NO_LIMIT).sum(axis=1)
    expected = 1000.0 * (1.0 - R / distance) / 2.0
    assert abs(counts.mean() - expected) < 1.0
    assert abs(counts - expected).max() <= 6.0


def test_from_the_pole_the_slices_are_counted_exactly() -> None:
    # Point i lies at z = R (1 - (2 i + 1)/P): from +z at range r those with z >= R^2/r are in sight.
    for distance, expected in ((12.5, 100), (20.0, 250), (40.0, 375), (100.0, 450)):
        seen = visible(np.array([[0.0, 0.0, distance]]), POINTS, R, NO_LIMIT)[0]
        assert np.flatnonzero(seen).tolist() == list(range(expected))


def test_nothing_from_inside_or_from_nowhere() -> None:
    inside = np.array([[0.0, 0.0, 0.0], [9.99, 0.0, 0.0], [0.0, 5.0, 5.0], [np.nan, 0.0, 60.0]])
    assert not visible(inside, POINTS, R, NO_LIMIT).any()
    assert not visible(inside, POINTS, R, math.cos(0.05)).any()


def test_field_of_view_by_hand() -> None:
    # Seen from (60, 0, 0) the point at 45 degrees stands atan(R sin 45/(60 - R cos 45)) off the boresight.
    side = R / math.sqrt(2.0)
    point = np.array([[side, side, 0.0]])
    viewer = np.array([[60.0, 0.0, 0.0]])
    angle = math.atan2(side, 60.0 - side)
    assert visible(viewer, point, R, math.cos(angle + 1e-6))[0, 0]
    assert not visible(viewer, point, R, math.cos(angle - 1e-6))[0, 0]
    assert visible(viewer, R * np.array([[1.0, 0.0, 0.0]]), R, 1.0)[0, 0]


def test_a_field_as_wide_as_the_chief_is_no_limit() -> None:
    viewer = viewers(2, 50)
    free = visible(viewer, POINTS, R, NO_LIMIT)
    for row in range(50):
        half = math.asin(R / np.linalg.norm(viewer[row]))
        assert np.array_equal(visible(viewer[row : row + 1], POINTS, R, math.cos(half + 1e-12))[0], free[row])
        assert np.array_equal(visible(viewer[row : row + 1], POINTS, R, math.cos(half - 1e-12))[0], free[row])


@given(seed=st.integers(0, 2**32 - 1), half_fov=st.floats(0.01, math.pi))
@settings(max_examples=40, deadline=None)
def test_agrees_with_angles(seed: int, half_fov: float) -> None:
    viewer = viewers(seed, 4)
    expected, margin = by_angles(viewer, POINTS, half_fov)
    seen = visible(viewer, POINTS, R, math.cos(half_fov))
    clear = margin > 1e-6
    assert np.array_equal(seen[clear], expected[clear])


@given(seed=st.integers(0, 2**32 - 1), half_fov=st.sampled_from([0.05, 0.1, math.pi]))
@settings(max_examples=30, deadline=None)
def test_rotations_and_permutations_change_nothing(seed: int, half_fov: float) -> None:
    viewer = viewers(seed, 4)
    turn = Rotation.random(rng=np.random.default_rng(seed))
    order = np.random.default_rng(seed).permutation(len(POINTS))
    seen = visible(viewer, POINTS, R, math.cos(half_fov))
    clear = by_angles(viewer, POINTS, half_fov)[1] > 1e-6
    turned = visible(turn.apply(viewer), turn.apply(POINTS), R, math.cos(half_fov))
    assert np.array_equal(turned[clear], seen[clear])
    assert np.array_equal(visible(viewer, POINTS[order], R, math.cos(half_fov)), seen[:, order])


@pytest.mark.parametrize("cos_half_fov", [NO_LIMIT, math.cos(0.1)])
def test_a_row_alone_is_the_same_to_the_bit(cos_half_fov: float) -> None:
    viewer = viewers(5, 65)
    whole = visible(viewer, POINTS, R, cos_half_fov)
    for row in range(65):
        assert np.array_equal(visible(viewer[row : row + 1], POINTS, R, cos_half_fov)[0], whole[row])
