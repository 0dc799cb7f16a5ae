"""The Earth's shadow against the geometry of rays in three dimensions."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import brentq

from safe_inspect.dynamics.orbit.earth import (
    EARTH_GRAVITY,
    EARTH_RADIUS,
    SUN_RADIUS,
    Shadow,
    earth_shadow,
    sunlight_row,
)

DISTANCE = 150e9


def orbit_of(mean_motion: float) -> float:
    return float((EARTH_GRAVITY / mean_motion**2) ** (1.0 / 3.0))


def visible_share(satellite: np.ndarray, sun: np.ndarray, rays: int = 40_000) -> float:
    """Return the share of rays from the satellite to the sun's disc that miss the Earth, about which positions are."""
    generator = np.random.default_rng(1)
    to_sun = sun - satellite
    ahead = to_sun / np.linalg.norm(to_sun)
    side = np.cross(ahead, [0.0, 0.0, 1.0])
    side /= np.linalg.norm(side)
    up = np.cross(side, ahead)
    # A sphere appears as the cap whose rim the lines of sight touch.
    rim = SUN_RADIUS * math.sqrt(1.0 - (SUN_RADIUS / np.linalg.norm(to_sun)) ** 2)
    centre = satellite + ahead * (np.linalg.norm(to_sun) - SUN_RADIUS**2 / np.linalg.norm(to_sun))
    radius, angle = rim * np.sqrt(generator.random(rays)), generator.uniform(0.0, 2.0 * np.pi, rays)
    targets = centre + radius[:, None] * (np.cos(angle)[:, None] * side + np.sin(angle)[:, None] * up)
    way = targets - satellite
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    along = -(way @ satellite)
    nearest = np.sqrt(np.maximum(satellite @ satellite - along**2, 0.0))
    return float(1.0 - ((along > 0.0) & (nearest < EARTH_RADIUS)).mean())


def test_the_sun_seen_from_the_earth_is_as_wide_as_in_an_almanac() -> None:
    """Its apparent diameter at 1 au is 31' 59.3", for a radius of 696,000 km, which is 0.04 % above the nominal one."""
    assert 2.0 * earth_shadow(0.001, 149_597_870_700.0).sun == pytest.approx(math.radians(0.53313), rel=1e-3)


@pytest.mark.parametrize("mean_motion", [0.00115, 0.001027, 7.2921e-5])
def test_the_visible_share_of_the_sun_is_that_of_the_rays_to_it(mean_motion: float) -> None:
    """In a low orbit, in that of the shipped task and in the geostationary one, through the whole penumbra."""
    shadow, orbit = earth_shadow(mean_motion, DISTANCE), orbit_of(mean_motion)
    edges = math.pi - (shadow.earth + shadow.sun * np.linspace(-1.2, 1.2, 13))  # angles of the sun from the radial
    found = [sunlight_row(math.cos(angle), shadow) for angle in edges]
    for angle, share in zip(edges, found, strict=True):
        sun = DISTANCE * np.array([math.cos(angle), math.sin(angle), 0.0])
        satellite = np.array([orbit, 0.0, 0.0])
        # The angle is that of the sun seen from the satellite.
        assert share == pytest.approx(visible_share(satellite, sun + satellite), abs=0.012)
    assert found[0] == 0.0 if found[0] < found[-1] else found[0] == 1.0
    assert {0.0, 1.0} <= set(found)
    assert (np.diff(found) <= 1e-12).all() or (np.diff(found) >= -1e-12).all()


def test_entry_and_exit_are_those_of_the_inertial_motion() -> None:
    """The sun's centre sets behind the Earth and rises within a second of when a line to it touches the Earth."""
    n = 0.001027
    shadow, orbit = earth_shadow(n, DISTANCE), orbit_of(n)
    sun = np.array([DISTANCE, 0.0, 0.0])

    def clearance(time: float) -> float:
        """Return how far the line to the sun passes above the Earth, in the frame that does not rotate [m]."""
        satellite = orbit * np.array([math.cos(n * time), math.sin(n * time), 0.0])
        way = (sun - satellite) / np.linalg.norm(sun - satellite)
        along = max(-(way @ satellite), 0.0)
        return float(np.linalg.norm(satellite + along * way)) - EARTH_RADIUS

    period = 2.0 * math.pi / n
    entry = brentq(clearance, 0.25 * period, 0.5 * period)
    leaving = brentq(clearance, 0.5 * period, 0.75 * period)
    sets = brentq(lambda time: math.cos(n * time) - shadow.edge, 0.25 * period, 0.5 * period)
    rises = brentq(lambda time: math.cos(n * time) - shadow.edge, 0.5 * period, 0.75 * period)
    assert abs(sets - entry) < 1.0
    assert abs(rises - leaving) < 1.0
    assert leaving - entry == pytest.approx(2.0 * math.asin(EARTH_RADIUS / orbit) / n, abs=1.0)


@given(st.floats(-1.0, 1.0), st.floats(1e-6, 0.3), st.floats(0.1, 1.5))
def test_the_share_is_within_0_and_1_and_grows_with_the_cosine(cosine: float, sun: float, earth: float) -> None:
    shadow = Shadow(-math.cos(earth), earth, sun)
    share = sunlight_row(cosine, shadow)
    assert 0.0 <= share <= 1.0
    assert sunlight_row(min(cosine + 1e-3, 1.0), shadow) >= share - 1e-9
    if cosine < -math.cos(max(earth - sun, 0.0)) and earth > sun:
        assert share == pytest.approx(0.0, abs=1e-9)
    if cosine > -math.cos(min(earth + sun, math.pi)):
        assert share == 1.0


def test_a_disc_larger_than_the_earth_remains_visible_as_a_ring() -> None:
    assert sunlight_row(-1.0, Shadow(-1.0, 0.1, 0.2)) == pytest.approx(0.75)


def test_orbits_inside_of_the_earth_and_suns_that_are_too_near_are_refused() -> None:
    with pytest.raises(ValueError, match=r"inside of the Earth; `eclipse` requires at most 0\.001239 rad/s"):
        earth_shadow(0.00124, DISTANCE)
    with pytest.raises(ValueError, match="the sun's distance must be more than its radius"):
        earth_shadow(0.001, 1e8)
    with pytest.raises(ValueError, match="the sun's distance"):
        earth_shadow(0.001, math.nan)


def test_a_cosine_that_rounding_pushed_beyond_one_is_that_of_the_axis() -> None:
    shadow = earth_shadow(0.001027, DISTANCE)
    assert sunlight_row(-1.0 - 1e-15, shadow) == sunlight_row(-1.0, shadow) == 0.0
    assert sunlight_row(1.0 + 1e-15, shadow) == sunlight_row(1.0, shadow) == 1.0
