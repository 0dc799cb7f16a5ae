"""Nearest deputies and distances of pairs against a sort by NumPy, on a grid where distances are often equal."""

from __future__ import annotations

import numpy as np
import pytest

from safe_inspect.geometry.clusters import direction_to_nearest
from safe_inspect.geometry.neighbours import (
    nearest_positions,
    nearest_velocities,
    pair_distances,
)
from safe_inspect.geometry.oriented_boxes import BoxArrays, OrientedBoxes, box_distance

DEPUTIES, BODIES, PLACES = 6, 8, 7


def grid(seed: int) -> np.ndarray:
    """Return positions of whole metres, the last two of bodies that are no deputies."""
    return np.random.default_rng(seed).integers(-3, 4, (BODIES, 3)).astype(np.float64)


@pytest.mark.parametrize("max_range", [1.0, 3.0, 5.0, 100.0])
@pytest.mark.parametrize("seed", range(12))
def test_the_nearest_are_those_of_a_sort_by_distance_and_index(seed: int, max_range: float) -> None:
    position, velocity = grid(seed), np.random.default_rng(seed).normal(size=(BODIES, 3))
    for own in range(DEPUTIES):
        squared = ((position - position[own]) ** 2).sum(axis=1)
        near = [k for k in range(DEPUTIES) if k != own and squared[k] <= max_range**2]
        near.sort(key=lambda k: (squared[k], k))
        missing = PLACES - len(near)
        length = np.linalg.norm(position[own])
        out = position[own] * (max_range / length) if length else np.array([max_range, 0.0, 0.0])
        relative, speeds = np.full(3 * PLACES, np.nan), np.full(3 * PLACES, np.nan)
        nearest_positions(DEPUTIES, max_range, own, position, relative)
        nearest_velocities(DEPUTIES, max_range, own, position, velocity, speeds)
        ways = [*(position[near] - position[own]), *[out] * missing]
        np.testing.assert_allclose(relative.reshape(PLACES, 3), ways, rtol=1e-15)
        np.testing.assert_array_equal(
            speeds.reshape(PLACES, 3), [*(velocity[near] - velocity[own]), *np.zeros((missing, 3))]
        )


@pytest.mark.parametrize(("x", "direction"), [(0.9e-9, (50.0, 0.0, 0.0)), (1.2e-9, (0.0, 0.0, 50.0))])
def test_a_deputy_within_rounding_of_the_origin_has_no_direction(x: float, direction: tuple[float, ...]) -> None:
    relative = np.empty(3)
    nearest_positions(1, 50.0, 0, np.array([[0.0, 0.0, x]]), relative)
    np.testing.assert_allclose(relative, direction, atol=1e-12)


@pytest.mark.parametrize(("x", "direction"), [(0.9e-9, (0.0, 0.0, 0.0)), (1.2e-9, (0.0, 0.0, 1.0))])
def test_a_cluster_within_rounding_of_the_centre_has_no_direction(x: float, direction: tuple[float, ...]) -> None:
    found = np.full(3, np.nan)
    direction_to_nearest(np.array([1.0, 2.0, 3.0]), np.zeros(3), np.array([[0.0, 0.0, x]]), 1, found)
    np.testing.assert_allclose(found, direction, atol=1e-12)


@pytest.mark.parametrize("seed", range(12))
def test_the_nearest_cluster_is_the_first_of_equals(seed: int) -> None:
    centres, generator = grid(seed), np.random.default_rng(seed)
    viewer, body = generator.integers(-3, 4, (2, 3)).astype(np.float64)
    for count in range(BODIES + 1):
        found = np.full(3, np.nan)
        direction_to_nearest(viewer, body, centres, count, found)
        if count == 0:
            np.testing.assert_array_equal(found, 0.0)
            continue
        nearest = centres[((viewer - body - centres[:count]) ** 2).sum(axis=1).argmin()]
        np.testing.assert_allclose(found, nearest / max(float(np.linalg.norm(nearest)), 1e-300), rtol=1e-15)


def test_pairs_are_in_the_order_of_a_triangle() -> None:
    position = np.stack([grid(seed) for seed in range(5)])
    first, second = np.triu_indices(DEPUTIES, 1)
    found = np.full((5, len(first)), np.nan)
    pair_distances(position, DEPUTIES, found)
    np.testing.assert_allclose(found, np.linalg.norm(position[:, first] - position[:, second], axis=-1), rtol=1e-15)


def turned_boxes() -> OrientedBoxes:
    """Return boxes of whole sizes, one of them turned by a quarter about each axis in turn."""
    generator = np.random.default_rng(3)
    quarter = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    skew = np.linalg.qr(generator.normal(size=(3, 3)))[0]
    rotation = np.stack((np.eye(3), quarter, skew))
    return OrientedBoxes(np.array([[0.0, 0, 0], [4, 1, 0], [-3, 2, 1]]), np.array([[1.0, 2, 3], [2, 1, 1], [1, 2, 1]]),
                         rotation)  # fmt: skip


def test_the_distance_of_one_point_to_boxes_is_that_of_a_batch_and_of_the_nearest_point() -> None:
    boxes = turned_boxes()
    arrays = BoxArrays(boxes.centre, boxes.half_size, boxes.rotation)
    points = np.array([(x, y, z) for x in range(-6, 8) for y in range(-4, 5) for z in range(-4, 5)], np.float64)
    found = np.array([box_distance(arrays, *point.tolist()) for point in points])
    np.testing.assert_allclose(found, boxes.distance(points), atol=1e-14)
    least = np.full(len(points), np.inf)
    for centre, half, rotation in zip(boxes.centre, boxes.half_size, boxes.rotation, strict=True):
        local = (points - centre) @ rotation
        beyond = np.abs(local) - half
        outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=1)
        least = np.minimum(least, np.where(outside > 0.0, outside, beyond.max(axis=1)))
    np.testing.assert_allclose(found, least, atol=1e-14)
    assert (found < 0.0).sum() > 20
    assert (found == 0.0).sum() > 20


def test_the_corners_of_boxes_are_at_no_distance_and_half_a_diagonal_from_the_centre() -> None:
    boxes = turned_boxes()
    assert len(boxes) == 3
    assert boxes.corners.shape == (3, 8, 3)
    for index, corners in enumerate(boxes.corners):
        distance, _ = boxes.distances(corners)
        np.testing.assert_allclose(distance[:, index], 0.0, atol=1e-14)
        np.testing.assert_allclose(
            np.linalg.norm(corners - boxes.centre[index], axis=1), np.linalg.norm(boxes.half_size[index])
        )
        assert len(np.unique(corners.round(9), axis=0)) == 8


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"centre": np.zeros(3)}, r"boxes: centre must have the shape (B, 3), got (3,)"),
        ({"centre": np.zeros((2, 2))}, r"boxes: centre must have the shape (B, 3), got (2, 2)"),
        ({"half_size": np.ones((3, 3))}, r"boxes: half_size must have the shape (B, 3), got (3, 3)"),
        ({"rotation": np.zeros((2, 3))}, r"boxes: rotation must have the shape (B, 3, 3), got (2, 3)"),
        ({"half_size": np.array([[1.0, 1, 1], [1, 0.0, 1]])}, "boxes: half_size must be positive [m], got 0.0"),
    ],
)
def test_boxes_of_other_shapes_are_refused(given: dict[str, np.ndarray], message: str) -> None:
    arrays = {"centre": np.zeros((2, 3)), "half_size": np.ones((2, 3)), "rotation": np.stack([np.eye(3)] * 2)} | given
    with pytest.raises(ValueError) as refusal:  # noqa: PT011
        OrientedBoxes(**arrays)
    assert str(refusal.value) == message
