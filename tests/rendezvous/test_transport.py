"""Paths between the target's axes and the inertial frame."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from safe_inspect.dynamics.tumble import tumble
from safe_inspect.rendezvous.planner.problem import Path, to_inertial, to_target

INERTIA = np.array([0.1314, 0.9661, 1.0])
STEP = 1e-3


@pytest.fixture(scope="module")
def motion() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Inertia, attitudes and angular velocities."""
    times = STEP * np.arange(2001)
    q, w = tumble(INERTIA, np.array([[0.1, -0.3, 0.5, 0.8]]) / np.sqrt(0.99), np.array([[0.3, 0.2, -0.25]]), times)
    return INERTIA, q[0], w[0]


@pytest.fixture(scope="module")
def path() -> Path:
    t = STEP * np.arange(2001)[:, None]
    rates = np.array([0.7, 1.1, 0.4])
    return Path(np.sin(rates * t), rates * np.cos(rates * t), -rates * rates * np.sin(rates * t))


def test_velocity_and_acceleration_are_derivatives_of_the_position(motion, path):
    outside = to_inertial(*motion, path, np.array([1.0, 2.0, 3.0]))
    first = (outside.position[2:] - outside.position[:-2]) / (2.0 * STEP)
    second = (outside.position[2:] - 2.0 * outside.position[1:-1] + outside.position[:-2]) / STEP**2
    np.testing.assert_allclose(outside.velocity[1:-1], first, atol=1e-6)
    np.testing.assert_allclose(outside.acceleration[1:-1], second, atol=1e-5)


def test_the_position_is_the_rotated_one_plus_the_centre(motion, path):
    outside = to_inertial(*motion, path, np.array([1.0, 2.0, 3.0]))
    expected = Rotation.from_quat(motion[1]).apply(path.position) + np.array([1.0, 2.0, 3.0])
    np.testing.assert_allclose(outside.position, expected, atol=1e-13)


def test_there_and_back(motion, path):
    for centre in (0.0, np.array([0.5, -1.0, 2.0])):
        back = to_target(*motion, to_inertial(*motion, path, centre), centre)
        for found, expected in zip(back, path, strict=True):
            np.testing.assert_allclose(found, expected, atol=1e-13)


def test_a_point_at_rest_in_the_target_moves_on_its_circle():
    still = Path(np.array([1.0, 0.0, 0.0]), np.zeros(3), np.zeros(3))
    outside = to_inertial(INERTIA, np.array([0.0, 0.0, 0.0, 1.0]), np.array([0.0, 0.0, 2.0]), still)
    np.testing.assert_allclose(outside.velocity, (0.0, 2.0, 0.0), atol=1e-15)
    np.testing.assert_allclose(outside.acceleration, (-4.0, 0.0, 0.0), atol=1e-15)
