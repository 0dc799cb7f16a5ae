"""What pictures of scenes are drawn from, by formulas of plane geometry."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from safe_inspect.geometry.picture import FRONT, VIEW, Camera, circle, pieces, ring, sun_arrow


@pytest.mark.parametrize(("elevation", "azimuth"), [(0.0, 0.0), (22.0, -52.0), (-35.0, 140.0), (89.0, 10.0)])
def test_a_camera_is_upright_and_looks_at_the_origin(elevation: float, azimuth: float) -> None:
    camera = Camera.at(elevation, azimuth)
    whole = Rotation.from_euler("ZY", [azimuth, -elevation], degrees=True).as_matrix()
    np.testing.assert_allclose(camera.sight, whole @ [1.0, 0.0, 0.0], atol=1e-15)
    np.testing.assert_allclose(camera.right, whole @ [0.0, 1.0, 0.0], atol=1e-14)
    np.testing.assert_allclose(camera.up, whole @ [0.0, 0.0, 1.0], atol=1e-14)
    along = Camera.along(camera.sight)
    np.testing.assert_array_equal([along.right, along.up, along.sight], [camera.right, camera.up, camera.sight])


def test_scenes_are_seen_from_above_and_one_side() -> None:
    front = Camera.at(22.0, -52.0)
    assert VIEW == {"elev": 22.0, "azim": -52.0}
    np.testing.assert_array_equal([FRONT.right, FRONT.up, FRONT.sight], [front.right, front.up, front.sight])


def test_points_lie_flat_in_the_picture_of_the_camera_and_of_one_in_another_frame() -> None:
    camera, points = Camera.at(30.0, 70.0), np.random.default_rng(0).normal(size=(4, 50, 3))
    flat = camera.flat(points)
    np.testing.assert_allclose(flat[..., 0], np.einsum("...i,i", points, camera.right), atol=1e-14)
    np.testing.assert_allclose(flat[..., 1], np.einsum("...i,i", points, camera.up), atol=1e-14)
    rotation = Rotation.random(random_state=1).as_matrix()
    np.testing.assert_allclose(camera.turned(rotation).flat(points), camera.flat(points @ rotation.T), atol=1e-14)
    np.testing.assert_allclose(camera.turned(rotation).sight, rotation.T @ camera.sight, atol=1e-15)


@pytest.mark.parametrize(
    ("point", "hidden"),
    [
        ((-5.0, 0.0, 0.0), True),
        ((5.0, 0.0, 0.0), False),
        ((0.0, 1.0, 0.0), False),  # next to the sphere's centre: not behind
        ((-5.0, 1.9, 0.0), True),
        ((-5.0, 0.0, 2.0), False),  # on the outline
        ((-5.0, 1.5, -1.5), False),
        ((-5.0, 1.4, -1.4), True),
    ],
)
def test_a_sphere_hides_what_is_behind_it(point: tuple[float, ...], hidden: bool) -> None:
    assert Camera.at(0.0, 0.0).hidden(np.array([point]), 2.0).tolist() == [hidden]


def test_a_ring_and_a_circle_have_equal_steps_and_are_closed() -> None:
    outline = circle(3.0)
    assert outline.shape == (91, 2)
    assert circle(3.0, 5).round(12).tolist() == [[3, 0], [0, 3], [-3, 0], [0, -3], [3, 0]]
    angle = np.unwrap(np.arctan2(outline[:, 1], outline[:, 0]))
    np.testing.assert_allclose(np.diff(angle), np.full(90, np.radians(4.0)))
    np.testing.assert_allclose(np.linalg.norm(outline, axis=1), 3.0)
    flat = ring(5.0)
    assert flat.shape == (181, 3)
    np.testing.assert_array_equal(flat[:, :2], circle(5.0, 181))
    np.testing.assert_array_equal(flat[:, 2], 0.0)


def test_an_arrow_ends_at_the_radius_with_barbs_to_both_sides() -> None:
    tail, tip, left, again, right = sun_arrow(np.array([0.6, 0.8, 0.0]), 10.0)
    np.testing.assert_allclose([tail, tip, again], [[4.2, 5.6, 0.0], [6.0, 8.0, 0.0], [6.0, 8.0, 0.0]])
    np.testing.assert_allclose(left, [6.0 - 0.54 - 0.4, 8.0 - 0.72 + 0.3, 0.0])
    np.testing.assert_allclose(right, [6.0 - 0.54 + 0.4, 8.0 - 0.72 - 0.3, 0.0])


def test_shown_pieces_continue_to_the_next_point() -> None:
    way, shown = np.arange(12.0).reshape(6, 2), np.array([True, False, False, True, True, False])
    found = pieces(way, shown[:, None])
    assert np.isnan(found[:, 0]).tolist() == [False, False, True, False, False, False]
    np.testing.assert_array_equal(found[[0, 1, 3, 4, 5]], way[[0, 1, 3, 4, 5]])
    assert shown.tolist() == [True, False, False, True, True, False]


@pytest.mark.parametrize(
    ("sun", "share"),
    [
        ((1.0, 0.0, 0.0), 1.0),
        ((0.0, 1.0, 0.0), 0.5),
        ((0.6, 0.0, 0.8), 0.8),
        ((-0.6, 0.8, 0.0), 0.2),
        ((-1.0, 0, 0), 0),
    ],
)
def test_the_day_side_is_the_share_of_the_disc_that_is_lit(sun: tuple[float, ...], share: float) -> None:
    """Lit is half of the disc and half of it times the cosine of the sun's angle from the camera."""
    outline = Camera.at(0.0, 0.0).day(np.array(sun, np.float64), 2.0, corners=400)
    assert outline.shape == (800, 2)
    x, y = outline.T
    area = 0.5 * abs((x * np.roll(y, -1) - np.roll(x, -1) * y).sum())
    assert area == pytest.approx(4.0 * np.pi * share, abs=1e-3)
    assert np.linalg.norm(outline, axis=1).max() == pytest.approx(2.0, rel=1e-12)
    middle = np.array(sun[1:])
    if np.linalg.norm(middle) > 0.0:
        assert outline.mean(axis=0) @ middle >= 0.0
        np.testing.assert_allclose(outline[199:201].mean(axis=0), 2.0 * middle / np.linalg.norm(middle), atol=1e-4)
    assert Camera.at(0.0, 0.0).day(np.array(sun, np.float64), 2.0).shape == (48, 2)
