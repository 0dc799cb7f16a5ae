"""The constants of the light, and which points are lit, computed by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from safe_inspect.geometry.light import Light, binary_light, full_light, phong_light
from safe_inspect.geometry.sphere import sphere_points
from safe_inspect.geometry.visibility import lit

R = 10.0
SUN = np.array([[1.0, 0.0, 0.0]])
FAR = np.array([[0.0, 0.0, 80.0]])


def point_at(degrees: float) -> np.ndarray:
    """Return a point of the sphere whose normal is so far from the sun, in the plane of x and y."""
    angle = math.radians(degrees)
    return R * np.array([[math.cos(angle), math.sin(angle), 0.0]])


def is_lit(degrees: float, light: Light, viewer: np.ndarray = FAR) -> bool:
    return bool(lit(viewer, SUN, point_at(degrees), R, light)[0, 0])


def test_terminator_without_an_offset() -> None:
    light = binary_light(R)
    assert light.binary
    assert light.threshold == 0.0
    assert math.copysign(1.0, light.threshold) == 1.0
    assert is_lit(89.9999, light)
    assert not is_lit(90.0001, light)
    exactly = np.array([[0.0, R, 0.0]])
    assert not lit(FAR, SUN, exactly, R, light)[0, 0]


def test_terminator_with_an_offset() -> None:
    light = binary_light(R, 1e-5)
    assert light.threshold == pytest.approx(-1.41421e-3, rel=1e-5)
    # The ray that starts R + e from the centre grazes the sphere asin(R/(R + e)) from the direction away from the sun.
    edge = 180.0 - math.degrees(math.asin(R / (R + 1e-5)))
    assert is_lit(edge - 1e-4, light)
    assert not is_lit(edge + 1e-4, light)


@given(radius=st.floats(0.1, 100.0), offset=st.floats(1e-3, 10.0))
@settings(max_examples=30, deadline=None)
def test_threshold_is_the_formula(radius: float, offset: float) -> None:
    naive = -math.sqrt(1.0 - (radius / (radius + offset)) ** 2)
    assert binary_light(radius, offset).threshold == pytest.approx(naive, rel=1e-9)
    assert phong_light(radius, ray_offset=offset).threshold == binary_light(radius, offset).threshold


def test_half_of_the_points_are_lit() -> None:
    rng = np.random.default_rng(0)
    sun = rng.normal(size=(50, 3))
    sun /= np.linalg.norm(sun, axis=1, keepdims=True)
    counts = lit(np.zeros((50, 3)), sun, sphere_points("fibonacci", 1000, R), R, binary_light(R)).sum(axis=1)
    assert abs(counts - 500).max() <= 8


def test_full_light_has_no_night() -> None:
    points = sphere_points("fibonacci", 100, R)
    assert lit(FAR, SUN, points, R, full_light()).all()


def test_red_chief_by_hand() -> None:
    # The viewer stands over the pole, 80 m up: the highlight lies near (1, 0, 1)/sqrt 2 and is nothing in the plane
    # of x and y (n.h < 0.8, to the 25th power below 4e-3). Red is 0.1 + 0.7 cos, so the limit is cos = 0.02/0.7.
    limit = math.degrees(math.acos(0.02 / 0.7))
    light = phong_light(R)
    assert is_lit(0.0, light)
    assert is_lit(limit - 0.5, light)
    assert not is_lit(limit + 0.5, light)
    assert not is_lit(120.0, light)


def test_highlight_washes_a_point_out() -> None:
    light = phong_light(R)
    behind = np.array([[80.0, 0.0, 0.0]])
    assert not is_lit(0.0, light, behind)  # n = h: the colour is (1.8, 1, 1)
    assert is_lit(30.0, light, behind)  # far from the highlight
    # The viewer at infinity along the sun: n.h = cos of the point's angle, washed out while cos^25 > 0.8.
    edge = math.degrees(math.acos(0.8 ** (1.0 / 25.0)))
    infinity = np.array([[1e9, 0.0, 0.0]])
    assert not is_lit(edge - 0.05, light, infinity)
    assert is_lit(edge + 0.05, light, infinity)
    # A chief that reflects no blue highlight is never washed out.
    assert is_lit(0.0, phong_light(R, chief_specular=(1.0, 1.0, 0.0)), behind)
    assert is_lit(0.0, phong_light(R, bright=1.0), behind)


def test_highlight_alone_can_show_a_dark_chief() -> None:
    dull = phong_light(R, chief_ambient=(0.0, 0.0, 0.0), chief_diffuse=(0.0, 0.0, 0.0))
    infinity = np.array([[1e9, 0.0, 0.0]])
    edge = math.degrees(math.acos(0.12 ** (1.0 / 25.0)))
    assert is_lit(edge - 0.05, dull, infinity)
    assert not is_lit(edge + 0.05, dull, infinity)
    assert is_lit(edge + 0.05, dull._replace(exponent=24.0), infinity)


def test_shade_has_the_ambient_part_only() -> None:
    assert is_lit(170.0, phong_light(R, chief_ambient=(0.12, 0.0, 0.0)))
    assert not is_lit(170.0, phong_light(R, chief_ambient=(0.119, 0.0, 0.0)))
    assert not is_lit(170.0, phong_light(R, chief_ambient=(0.9, 0.9, 0.9)))
    assert is_lit(170.0, phong_light(R, chief_ambient=(0.9, 0.9, 0.8)))
    # The light's own colour counts: half an ambient light leaves 0.06.
    assert not is_lit(170.0, phong_light(R, chief_ambient=(0.12, 0.0, 0.0), light_ambient=(0.5, 0.5, 0.5)))


def test_no_highlight_comes_through_the_chief() -> None:
    # On both sides of the terminator n.h is near 0.7: a blunt highlight would show the point in the shade too.
    shiny = phong_light(R, chief_ambient=(0.0, 0.0, 0.0), chief_specular=(1.0, 0.0, 0.0), shininess=0.4)
    viewer = np.array([[0.0, 80.0, 0.0]])
    assert is_lit(85.0, shiny, viewer)
    assert not is_lit(95.0, shiny, viewer)


def phong_by_numpy(viewer: np.ndarray, sun: np.ndarray, points: np.ndarray, light: Light) -> np.ndarray:
    normal = points / R
    to_sun = (normal[None] * sun[:, None]).sum(-1)
    view = viewer[:, None] - points[None]
    half = sun[:, None] + view / np.linalg.norm(view, axis=-1, keepdims=True)
    half /= np.linalg.norm(half, axis=-1, keepdims=True)
    shine = np.clip((normal[None] * half).sum(-1), 0.0, None) ** light.exponent
    ambient, diffuse, specular = (np.array(c) for c in (light.ambient, light.diffuse, light.specular))
    sunny = (to_sun > light.threshold)[..., None]
    reflected = diffuse * np.clip(to_sun, 0.0, None)[..., None] + specular * shine[..., None]
    rgb = np.clip(ambient + np.where(sunny, reflected, 0.0), 0.0, 1.0)
    return (rgb[..., 0] >= light.dark) & ~(rgb > light.bright).all(-1)


def directions(seed: int, rows: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    viewer, sun = rng.normal(size=(2, rows, 3))
    viewer *= rng.uniform(12.0, 100.0, (rows, 1)) / np.linalg.norm(viewer, axis=1, keepdims=True)
    return viewer, sun / np.linalg.norm(sun, axis=1, keepdims=True)


@given(
    seed=st.integers(0, 2**32 - 1),
    chief=st.lists(st.floats(0.0, 1.0), min_size=9, max_size=9),
    shininess=st.floats(1.0, 200.0),
    offset=st.sampled_from([0.0, 1e-5, 0.5]),
)
@settings(max_examples=40, deadline=None)
def test_agrees_with_numpy(seed: int, chief: list[float], shininess: float, offset: float) -> None:
    light = phong_light(
        R,
        chief_ambient=chief[:3],
        chief_diffuse=chief[3:6],
        chief_specular=chief[6:],
        shininess=shininess,
        ray_offset=offset,
    )
    viewer, sun = directions(seed, 6)
    points = sphere_points("fibonacci", 100, R)
    result = lit(viewer, sun, points, R, light)
    # A colour within rounding of a limit may fall to either side.
    steady = np.ones_like(result)
    for shift in (-1e-9, 1e-9):
        moved = light._replace(dark=light.dark + shift, bright=light.bright + shift)
        steady &= phong_by_numpy(viewer, sun, points, moved) == phong_by_numpy(viewer, sun, points, light)
    assert np.array_equal(result[steady], phong_by_numpy(viewer, sun, points, light)[steady])


@pytest.mark.parametrize("light", [binary_light(R), phong_light(R)])
def test_a_row_alone_is_the_same_to_the_bit(light: Light) -> None:
    viewer, sun = directions(4, 33)
    points = sphere_points("cmu", 100, R)
    whole = lit(viewer, sun, points, R, light)
    for row in range(33):
        assert np.array_equal(lit(viewer[row : row + 1], sun[row : row + 1], points, R, light)[0], whole[row])


@pytest.mark.parametrize(
    ("keywords", "name"),
    [
        ({"radius": R, "chief_diffuse": (1.0, 1.0)}, "chief_diffuse"),
        ({"radius": R, "light_specular": (1.0, -1.0, 0.0)}, "light_specular"),
    ],
)
def test_bad_constants_are_named(keywords: dict[str, float], name: str) -> None:
    with pytest.raises(ValueError, match=name):
        phong_light(**keywords)  # type: ignore[arg-type]
