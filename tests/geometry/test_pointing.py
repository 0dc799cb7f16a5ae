"""The camera points at its target with the least rotation."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from safe_inspect.geometry.pointing import R_BC, point_camera, shortest_arc


def unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


@pytest.fixture
def cameras() -> np.ndarray:
    return Rotation.random(200, random_state=0).as_matrix()


def test_the_camera_looks_along_the_bodys_x_axis_with_y_down():
    np.testing.assert_array_equal(R_BC @ [0.0, 0.0, 1.0], (1.0, 0.0, 0.0))
    np.testing.assert_array_equal(R_BC @ [0.0, 1.0, 0.0], (0.0, 0.0, 1.0))
    assert np.linalg.det(R_BC) == pytest.approx(1.0)


def test_the_camera_ends_on_the_target(cameras):
    generator = np.random.default_rng(1)
    position, target = generator.normal(size=(2, 200, 3))
    turned = point_camera(cameras, position, target)
    np.testing.assert_allclose(turned[..., 2], unit(target - position), atol=1e-14)
    np.testing.assert_allclose(
        np.swapaxes(turned, -1, -2) @ turned, np.broadcast_to(np.eye(3), (200, 3, 3)), atol=1e-14
    )


def test_the_rotation_is_the_least_one(cameras):
    """Its angle is that between the axes, and any roll about the new axis makes it larger."""
    target = np.random.default_rng(2).normal(size=(200, 3))
    turned = point_camera(cameras, np.zeros((200, 3)), target)
    angle = Rotation.from_matrix(turned @ np.swapaxes(cameras, -1, -2)).magnitude()
    between = np.arccos(np.clip((cameras[..., 2] * unit(target)).sum(axis=-1), -1.0, 1.0))
    np.testing.assert_allclose(angle, between, atol=1e-7)
    for roll in (-0.3, 0.01, 1.0):
        rolled = turned @ Rotation.from_euler("z", roll).as_matrix()
        assert np.all(Rotation.from_matrix(rolled @ np.swapaxes(cameras, -1, -2)).magnitude() > angle)


def test_a_target_straight_behind_is_reached_by_half_a_turn(cameras):
    turned = point_camera(cameras, np.zeros((200, 3)), -cameras[..., 2])
    np.testing.assert_allclose(turned[..., 2], -cameras[..., 2], atol=1e-9)
    near = point_camera(cameras, np.zeros((200, 3)), -cameras[..., 2] + 1e-5 * cameras[..., 0])
    assert np.isfinite(near).all()


def test_a_target_at_the_camera_leaves_it_as_it_is(cameras):
    np.testing.assert_allclose(point_camera(cameras, np.ones((200, 3)), np.ones((200, 3))), cameras, atol=1e-14)


def test_rounding_does_not_grow_over_many_steps():
    camera = np.eye(3)
    generator = np.random.default_rng(3)
    for _ in range(2000):
        camera = point_camera(camera, np.zeros(3), generator.normal(size=3))
    np.testing.assert_allclose(camera.T @ camera, np.eye(3), atol=1e-14)


def test_the_shortest_arc_does_not_change_with_the_frame(cameras):
    a, b, c = unit(np.random.default_rng(4).normal(size=(3, 200, 3)))
    about = unit(np.cross(a, c))
    turned = shortest_arc(*((cameras @ v[..., None])[..., 0] for v in (a, b, about)))
    np.testing.assert_allclose(turned, cameras @ shortest_arc(a, b, about) @ np.swapaxes(cameras, -1, -2), atol=1e-11)
