"""Which side of each limit counts, at values that are exact in binary, and the constants that have defaults."""

from __future__ import annotations

import math

import numpy as np
import pytest

from safe_inspect.geometry.pointing import point_camera, shortest_arc
from safe_inspect.geometry.sphere import sphere_points

from .sight import visible

#: The point at (3, 4, 0) of a sphere of 5 m, looked at and lit from far along x; light is right at a limit, or not.
POINT, RADIUS = np.array([[3.0, 4.0, 0.0]]), 5.0


def seen(viewer: tuple[float, float, float], cos_half_fov: float = -1.0, points: np.ndarray = POINT) -> bool:
    """Return whether a viewer sees the point if every point is lit."""
    radius = math.sqrt(float((points**2).sum()))
    return bool(visible(np.array([viewer]), points, radius, cos_half_fov)[0, 0])


def test_a_point_at_the_horizon_is_seen() -> None:
    assert seen((3.0, 4.0, 7.0))
    assert not seen((3.0, 4.0 - 1e-9, 7.0))
    assert seen((3.0, 4.0, 0.0))  # from the point itself
    assert not seen((3.0, 4.0 - 1e-9, 0.0))
    assert not seen((2.0, 4.0, 0.0))


def test_a_point_at_the_edge_of_the_field_of_view_is_seen() -> None:
    """From (10, 0, 0) it is 3 m nearer to the centre and 4 m aside: at the angle whose cosine is 0.6."""
    assert seen((10.0, 0.0, 0.0), 0.6, np.array([[7.0, 4.0, 0.0]]))
    assert not seen((10.0, 0.0, 0.0), 0.6 + 1e-12, np.array([[7.0, 4.0, 0.0]]))


def test_a_field_of_view_that_takes_in_the_outline_sees_all_above_the_horizon() -> None:
    assert seen((0.0, 6.25, 0.0), 0.6)  # the outline is at the angle whose sine is 0.8
    assert seen((0.0, 6.25, 0.0), -1.0)
    far = np.array([[0.0, 6.25, 0.0]])
    points = sphere_points("fibonacci", 500, RADIUS)
    angle = np.array(((far - points) @ far[0]) / np.linalg.norm(far - points, axis=1) / 6.25)
    for cosine in (0.59, 0.61, 0.8):
        expected = (points @ far[0] >= 25.0) & (angle >= cosine)
        np.testing.assert_array_equal(visible(far, points, RADIUS, cosine)[0], expected)


@pytest.mark.parametrize(("distance", "turned"), [(0.9e-6, False), (1.2e-6, True)])
def test_a_camera_keeps_its_attitude_within_a_micrometre_of_its_target(distance: float, turned: bool) -> None:
    found = point_camera(np.eye(3), np.zeros(3), np.array([distance, 0.0, 0.0]))
    np.testing.assert_allclose(found[:, 2], (1.0, 0.0, 0.0) if turned else (0.0, 0.0, 1.0), atol=1e-12)


@pytest.mark.parametrize(("angle", "half_turn"), [(1.2e-6, True), (1.6e-6, False)])
def test_nearly_opposite_directions_are_joined_by_half_a_turn(angle: float, half_turn: bool) -> None:
    """About the given axis z where they are opposite but for 1e-12 of the cosine, else about y, at right angles."""
    last = np.array([-math.cos(angle), 0.0, math.sin(angle)])
    found = shortest_arc(np.array([1.0, 0.0, 0.0]), last, np.array([0.0, 0.0, 1.0]))
    np.testing.assert_allclose(np.diag(found), (-1, -1, 1) if half_turn else (-1, 1, -1), atol=1e-3)
