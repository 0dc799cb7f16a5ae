"""Motion in axes that do not turn: the tide of gravity against the field of a point mass, and the map of a step."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from safe_inspect.dynamics.tide import hill_rotation, largest_tide, tidal_acceleration, to_hill

N, RADIUS = 0.00113, 6.78e6
STATES = np.random.default_rng(3).normal(size=(6, 6)) * [80.0, 80.0, 80.0, 0.1, 0.1, 0.1]


def test_the_tide_is_the_difference_of_gravity():
    times = np.array([0.0, 300.0, 900.0, 2000.0, 3500.0, 5000.0])
    target = RADIUS * np.stack((np.cos(N * times), np.sin(N * times), 0.0 * times), axis=-1)
    gravity = N * N * RADIUS**3  # of the point mass about which the target turns with N

    def pull(place):
        return -gravity * place / np.linalg.norm(place, axis=-1, keepdims=True) ** 3

    position = STATES[:, :3]
    np.testing.assert_allclose(
        tidal_acceleration(N, times, position), pull(target + position) - pull(target), rtol=1e-3, atol=2e-8
    )


def test_no_tide_within_a_distance_is_larger_than_the_largest():
    directions = STATES[:, :3] / np.linalg.norm(STATES[:, :3], axis=1, keepdims=True)
    sizes = np.linalg.norm(tidal_acceleration(N, np.zeros(6), 5.0 * directions), axis=1)
    assert (sizes <= largest_tide(N, 5.0)).all()
    along = tidal_acceleration(N, np.array(0.0), np.array([5.0, 0.0, 0.0]))
    np.testing.assert_allclose(along, [largest_tide(N, 5.0), 0.0, 0.0])


@pytest.mark.parametrize("time", [0.0, 700.0, 4000.0])
def test_hills_frame_turns_with_the_orbit(time):
    turn = Rotation.from_rotvec([0.0, 0.0, -N * time])
    position, velocity = turn.apply(STATES[:, :3]), turn.apply(STATES[:, 3:])
    expected = np.concatenate((position, velocity - np.cross([0.0, 0.0, N], position)), axis=1)
    np.testing.assert_allclose(to_hill(N, time, STATES), expected, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(STATES @ hill_rotation(N, time).T, np.concatenate((position, velocity), axis=1))
