"""Which side of each limit counts, at values that are exact in binary, and the constants that have defaults."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
import pytest

from safe_inspect.geometry.light import Light, binary_light, full_light, phong_light
from safe_inspect.geometry.pointing import point_camera, shortest_arc
from safe_inspect.geometry.sphere import sphere_points
from safe_inspect.geometry.visibility import lit
from safe_inspect.tasks.inspection.points_view import PointsModel

from .sight import visible

NO_COLOUR = (0.0, 0.0, 0.0)
COLOUR = "must be three finite numbers of at least 0"


def test_the_constants_of_each_light() -> None:
    assert phong_light(10.0) == Light(False, 0.0, (0.1, 0.0, 0.0), (0.7, 0.0, 0.0), (1.0, 1.0, 1.0), 25.0, 0.12, 0.8)
    assert full_light() == Light(True, -math.inf, NO_COLOUR, NO_COLOUR, NO_COLOUR, 1.0, 0.0, 1.0)
    assert binary_light(10.0) == Light(True, 0.0, NO_COLOUR, NO_COLOUR, NO_COLOUR, 1.0, 0.0, 1.0)
    given = phong_light(
        3.0, light_ambient=(2, 3, 4), light_diffuse=(5, 6, 7), light_specular=(8, 9, 10),
        chief_ambient=(0.1, 0.2, 0.3),
        chief_diffuse=(0.4, 0.5, 0.6), chief_specular=(0.7, 0.8, 0.9), shininess=6.0, ray_offset=2.0, dark=0.0,
        bright=1.0,
    )  # fmt: skip
    np.testing.assert_allclose(given.ambient, [0.2, 0.6, 1.2])
    np.testing.assert_allclose(given.diffuse, [2.0, 3.0, 4.2])
    np.testing.assert_allclose(given.specular, [5.6, 7.2, 9.0])
    assert given[-3:] == (1.5, 0.0, 1.0)
    assert given.threshold == pytest.approx(-0.8)  # the cosine of the angle whose sine is 3 / 5, beyond a right angle


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"light_ambient": (1.0, -1.0, 0.0)}, f"light_ambient {COLOUR}, got [1.0, -1.0, 0.0]"),
        ({"light_diffuse": (1.0,)}, f"light_diffuse {COLOUR}, got [1.0]"),
        ({"chief_specular": (0.0, math.inf, 0.0)}, f"chief_specular {COLOUR}, got [0.0, inf, 0.0]"),
    ],
)
def test_constants_out_of_their_range_are_refused(given: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError) as refusal:  # noqa: PT011
        phong_light(**{"radius": 10.0, **given})
    assert str(refusal.value) == message


#: The point at (3, 4, 0) of a sphere of 5 m, looked at and lit from far along x; light is right at a limit, or not.
POINT, RADIUS = np.array([[3.0, 4.0, 0.0]]), 5.0


def seen(viewer: tuple[float, float, float], cos_half_fov: float = -1.0, points: np.ndarray = POINT) -> bool:
    """Return whether a viewer sees the point, in a binary light and in one in which the ambient light is enough."""
    radius = math.sqrt(float((points**2).sum()))
    found = visible(np.array([viewer]), points, radius, cos_half_fov)
    light = phong_light(radius, chief_ambient=(0.5, 0.0, 0.0))
    np.testing.assert_array_equal(visible(np.array([viewer]), points, radius, cos_half_fov, light), found)
    return bool(found[0, 0])


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


@pytest.mark.parametrize("sun", [(1.0, 0.0, 0.0), (-1.0, 0.0, 0.0)])
@pytest.mark.parametrize(("level", "bright"), [(0.5, False), (0.75, True)])
def test_a_point_is_washed_out_where_all_of_its_channels_are_above_the_limit(
    sun: tuple[float, float, float], level: float, bright: bool
) -> None:
    viewer, points = np.array([[50.0, 0.0, 0.0]]), np.array([[RADIUS, 0.0, 0.0]])
    for channel in range(3):
        ambient = tuple(level if k == channel else 0.75 for k in range(3))
        light = Light(False, 0.0, ambient, NO_COLOUR, NO_COLOUR, 1.0, 0.25, 0.5)
        assert lit(viewer, np.array([sun]), points, RADIUS, light)[0, 0] != bright


@pytest.mark.parametrize("sun", [(1.0, 0.0, 0.0), (-1.0, 0.0, 0.0)])
def test_a_point_whose_red_is_at_the_limit_can_be_made_out(sun: tuple[float, float, float]) -> None:
    viewer, points = np.array([[50.0, 0.0, 0.0]]), np.array([[RADIUS, 0.0, 0.0]])
    for red, green in itertools.product((0.25, 0.25 - 2.0**-50), (0.0, 0.4)):
        light = Light(False, 0.0, (red, green, green), NO_COLOUR, NO_COLOUR, 1.0, 0.25, 0.5)
        assert lit(viewer, np.array([sun]), points, RADIUS, light)[0, 0] == (red == 0.25)


def test_the_highlight_has_no_direction_at_the_point_and_opposite_to_the_sun() -> None:
    """A viewer at the point sees none; one straight opposite to the sun neither."""
    points, sun = np.array([[RADIUS, 0.0, 0.0]]), np.array([[1.0, 0.0, 0.0]])
    shiny = Light(False, -2.0, NO_COLOUR, NO_COLOUR, (1.0, 0.0, 0.0), 1.0, 0.5, 1.0)
    assert not lit(points.copy(), sun, points, RADIUS, shiny)[0, 0]
    assert not lit(np.array([[-50.0, 0.0, 0.0]]), sun, points, RADIUS, shiny)[0, 0]
    assert lit(np.array([[50.0, 0.0, 0.0]]), sun, points, RADIUS, shiny)[0, 0]


def test_points_that_are_lit_and_have_no_inspector() -> None:
    points, sun = sphere_points("fibonacci", 40, RADIUS), np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    inspector = np.random.default_rng(0).integers(-1, 2, (2, 40)).astype(np.int8)
    model = PointsModel("chief", 1, points, RADIUS, binary_light(RADIUS))
    found = model.candidates(np.zeros((2, 3)), sun, inspector)
    np.testing.assert_array_equal(found, (sun @ points.T > 0.0) & (inspector < 0))
    assert found.any(axis=1).all()


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
