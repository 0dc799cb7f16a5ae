"""What pictures of environments show, measured in their pixels against the state."""

from __future__ import annotations

import numpy as np
import pytest

import safe_inspect

pytest.importorskip("PIL")

ID = "safe_inspect/TranslationalInspection-v0"
BLUE, BLACK, ORANGE, PALE = (0, 114, 178), (34, 34, 34), (230, 159, 0), (217, 217, 217)
MIDDLE = 240.0
OUTER = 480.0 / 2.3  # radius of the outer circle [pixels]


def seen(direction) -> np.ndarray:
    """Return a vector to the right and up from 22 degrees over the orbital plane and 52 degrees before the x axis."""
    x, y, z = direction
    turn, tilt = np.radians(-52.0), np.radians(22.0)
    away = np.cos(turn) * x + np.sin(turn) * y
    return np.array([np.cos(turn) * y - np.sin(turn) * x, np.cos(tilt) * z - np.sin(tilt) * away])


def of_colour(environment, colour, tolerance: int = 40) -> np.ndarray:
    """Return the pixels of a colour below the line of text, to the right and up from the middle."""
    picture = environment.render().astype(int)
    rows, columns = np.nonzero(np.abs(picture - colour).max(axis=-1) < tolerance)
    below = rows > 30
    return np.stack((columns[below] + 0.5 - MIDDLE, MIDDLE - rows[below] - 0.5), axis=-1)


def farthest(pixels: np.ndarray, origin: np.ndarray) -> np.ndarray:
    gaps = pixels - origin
    return gaps[np.argmax(np.square(gaps).sum(axis=-1))]


@pytest.fixture(scope="module")
def environment():
    return safe_inspect.make(ID, render_mode="rgb_array")


@pytest.mark.parametrize("thrust", [(1.0, 0.4, 0.0), (0.01, 0.004, 0.0), (0.0, 0.0, -0.3), (-0.5, 0.5, 0.5)])
def test_the_arrow_points_along_the_thrust_and_is_as_long_for_any(environment, thrust):
    """Its length is 0.15 radii of the outer circle unless it points at the reader; it shows the direction only."""
    environment.reset(seed=3)
    environment.step(np.array(thrust, dtype=np.float32))
    state = environment.core.state
    place = OUTER / 125.0 * seen(state["position"][0, 0])
    blue = of_colour(environment, BLUE)
    assert np.sqrt(np.square(blue - place).sum(axis=-1)).min() < 1.0
    arrow = 0.15 * OUTER * seen(np.divide(thrust, np.linalg.norm(thrust)))
    np.testing.assert_allclose(farthest(of_colour(environment, BLACK), place), arrow, atol=2.5)


def test_no_arrow_without_thrust(environment):
    environment.reset(seed=3)
    environment.step(np.zeros(3, dtype=np.float32))
    assert not len(of_colour(environment, BLACK))


def test_an_arrow_points_to_the_sun(environment):
    environment.reset(seed=3)
    for _ in range(3):
        tip = OUTER * seen(environment.core.state["sun_direction"][0])
        orange = of_colour(environment, ORANGE)
        apart = np.sqrt(np.square(orange - tip).sum(axis=-1))
        assert apart.min() < 2.5
        tail = orange[np.argmax(apart)]
        np.testing.assert_allclose(tail, 0.7 * tip, atol=4.0)
        for _ in range(60):
            environment.step(np.zeros(3, dtype=np.float32))


def test_the_way_runs_through_every_position(environment):
    environment.reset(seed=3)
    places = [environment.core.state["position"][0, 0].copy()]
    for step in range(40):
        environment.step(np.array((0.03, -0.01, 0.05 if step % 10 < 5 else -0.05), dtype=np.float32))
        places.append(environment.core.state["position"][0, 0].copy())
    blue = of_colour(environment, BLUE)
    ring = OUTER / np.abs(of_colour(environment, PALE, 6)[:, 0]).max()
    assert ring == pytest.approx(1.0, abs=0.01)
    reach = 1.1 * np.linalg.norm(places, axis=-1).max()
    radius = min(size for size in (100.0, 125.0, 160.0, 200.0, 250.0, 320.0, 400.0, 500.0) if size >= reach)
    gaps = [np.sqrt(np.square(blue - OUTER / radius * seen(place)).sum(axis=-1)).min() for place in places]
    assert max(gaps) < 1.5
