"""Where sunlight ends on a sphere, and which points are lit, computed by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from safe_inspect.geometry.sphere import sphere_points
from safe_inspect.geometry.visibility import lit, terminator_height

R = 10.0
SUN = np.array([[1.0, 0.0, 0.0]])


def is_lit(degrees: float, terminator: float) -> bool:
    """Return whether the point whose normal is so far from the sun, in the plane of x and y, is lit."""
    angle = math.radians(degrees)
    return bool(lit(SUN, R * np.array([[math.cos(angle), math.sin(angle), 0.0]]), terminator)[0, 0])


def test_terminator_without_an_offset() -> None:
    terminator = terminator_height(R)
    assert terminator == 0.0
    assert math.copysign(1.0, terminator) == 1.0
    assert is_lit(89.9999, terminator)
    assert not is_lit(90.0001, terminator)
    exactly = np.array([[0.0, R, 0.0]])
    assert not lit(SUN, exactly, terminator)[0, 0]


def test_terminator_with_an_offset() -> None:
    terminator = terminator_height(R, 1e-5)
    assert terminator == pytest.approx(-1.41421e-3 * R, rel=1e-5)
    # The ray that starts R + e from the centre grazes the sphere asin(R/(R + e)) from the direction away from the sun.
    edge = 180.0 - math.degrees(math.asin(R / (R + 1e-5)))
    assert is_lit(edge - 1e-4, terminator)
    assert not is_lit(edge + 1e-4, terminator)
    assert terminator_height(3.0, 2.0) == pytest.approx(-2.4)  # the angle whose sine is 3 / 5, beyond a right angle


@given(radius=st.floats(0.1, 100.0), offset=st.floats(1e-3, 10.0))
@settings(max_examples=30, deadline=None)
def test_terminator_is_the_formula(radius: float, offset: float) -> None:
    naive = -radius * math.sqrt(1.0 - (radius / (radius + offset)) ** 2)
    assert terminator_height(radius, offset) == pytest.approx(naive, rel=1e-9)


def test_half_of_the_points_are_lit() -> None:
    rng = np.random.default_rng(0)
    sun = rng.normal(size=(50, 3))
    sun /= np.linalg.norm(sun, axis=1, keepdims=True)
    counts = lit(sun, sphere_points("fibonacci", 1000, R), 0.0).sum(axis=1)
    assert abs(counts - 500).max() <= 8


def test_without_a_terminator_there_is_no_night() -> None:
    assert lit(SUN, sphere_points("fibonacci", 100, R), -math.inf).all()


def test_a_row_alone_is_the_same_to_the_bit() -> None:
    sun = np.random.default_rng(4).normal(size=(33, 3))
    sun /= np.linalg.norm(sun, axis=1, keepdims=True)
    points, terminator = sphere_points("cmu", 100, R), terminator_height(R, 0.5)
    whole = lit(sun, points, terminator)
    for row in range(33):
        assert np.array_equal(lit(sun[row : row + 1], points, terminator)[0], whole[row])
