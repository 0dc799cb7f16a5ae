"""Where the points of the sphere lie, and that they share it evenly."""

from __future__ import annotations

import math
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import SphericalVoronoi

from safe_inspect.geometry.sphere import sphere_points


def ring_sizes(points: np.ndarray) -> list[int]:
    _, sizes = np.unique(-points[:, 2].round(9), return_counts=True)
    return sizes.tolist()


@pytest.mark.parametrize("count", [1, 2, 3, 20, 99, 100, 1000])
def test_fibonacci_gives_the_number_asked_for(count: int) -> None:
    assert sphere_points("fibonacci", count, 10.0).shape == (count, 3)


@pytest.mark.parametrize(("asked", "given_"), [(20, 20), (50, 50), (99, 99), (100, 99), (200, 200), (1000, 998)])
def test_cmu_gives_the_published_numbers(asked: int, given_: int) -> None:
    assert sphere_points("cmu", asked, 10.0).shape == (given_, 3)


def test_cmu_rings_of_a_hundred() -> None:
    points = sphere_points("cmu", 100, 10.0)
    assert ring_sizes(points) == [3, 9, 13, 16, 17, 16, 13, 9, 3]
    start = 0
    for ring, size in enumerate([3, 9, 13, 16, 17, 16, 13, 9, 3]):
        polar = math.radians(10.0 + 20.0 * ring)
        for k in range(size):
            azimuth = 2.0 * math.pi * k / size
            expected = [
                10.0 * math.sin(polar) * math.cos(azimuth),
                10.0 * math.sin(polar) * math.sin(azimuth),
                10.0 * math.cos(polar),
            ]
            np.testing.assert_allclose(points[start + k], expected, atol=1e-13)
        start += size


@pytest.mark.parametrize("count", [50, 100, 200, 1000])
def test_cmu_points_share_their_rings_belts_evenly(count: int) -> None:
    sizes = ring_sizes(sphere_points("cmu", count, 1.0))
    edges = np.cos(np.linspace(0.0, math.pi, len(sizes) + 1))
    share = 2.0 * math.pi * (edges[:-1] - edges[1:]) / np.array(sizes)
    # Only the rounding to whole points spoils it; it is worst for the few points about a pole.
    np.testing.assert_allclose(share[1:-1], 4.0 * math.pi / count, rtol=0.06)
    np.testing.assert_allclose(share, 4.0 * math.pi / count, rtol=0.12)


@pytest.mark.parametrize(("algorithm", "tolerance"), [("fibonacci", 0.2), ("cmu", 0.25)])
def test_each_point_owns_an_equal_part_of_the_sphere(algorithm: str, tolerance: float) -> None:
    points = sphere_points(algorithm, 100, 1.0)
    areas = SphericalVoronoi(points, 1.0).calculate_areas()
    np.testing.assert_allclose(areas, 4.0 * math.pi / len(points), rtol=tolerance)


@given(algorithm=st.sampled_from(["fibonacci", "cmu"]), count=st.integers(1, 400), radius=st.floats(1e-3, 1e3))
@settings(max_examples=60, deadline=None)
def test_points_lie_on_the_sphere_from_pole_to_pole(algorithm: str, count: int, radius: float) -> None:
    points = sphere_points(algorithm, count, radius)
    np.testing.assert_allclose(np.linalg.norm(points, axis=1), radius, rtol=1e-14)
    assert (np.diff(points[:, 2]) <= 0.0).all()
    assert abs(points[:, 2].sum()) < 1e-12 * radius * len(points)
    if len(points) > 1:
        gaps = np.linalg.norm(points[:, None] - points[None], axis=-1) + 10.0 * radius * np.eye(len(points))
        assert gaps.min() > 0.5 * radius * math.sqrt(4.0 * math.pi / count) / 1.5


@pytest.mark.parametrize("algorithm", ["fibonacci", "cmu"])
def test_second_moments_are_a_spheres(algorithm: str) -> None:
    points = sphere_points(algorithm, 1000, 10.0)
    moments = (points[:, :, None] * points[:, None, :]).mean(axis=0)
    np.testing.assert_allclose(moments, np.eye(3) * 100.0 / 3.0, atol=0.2)


def test_light_modules_do_not_load_the_compiler() -> None:
    code = (
        "import sys, safe_inspect.dynamics.cwh, safe_inspect.geometry.sphere, safe_inspect.geometry.visibility;"
        "sys.exit(any(name in sys.modules for name in ('numba', 'scipy', 'sklearn')))"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
