from __future__ import annotations

import pytest

from safe_inspect.compiling import njit
from safe_inspect.dynamics.attitude.rigid_body import rotation_row


@njit
def rotate_bodies(inertia, orientation, angular_velocity, torque, dt, steps):
    """Advance the attitude and the angular velocity of each row by some steps, in place."""
    for row in range(orientation.shape[0]):
        q, w, u, j = orientation[row], angular_velocity[row], torque[row], inertia[row]
        x = (q[0], q[1], q[2], q[3], w[0], w[1], w[2])
        for _ in range(steps):
            x = rotation_row((j[0], j[1], j[2]), x, (u[0], u[1], u[2]), dt)
        for i in range(4):
            q[i] = x[i]
        for i in range(3):
            w[i] = x[4 + i]


@pytest.fixture(scope="session", name="rotate_bodies")
def _rotate_bodies():
    return rotate_bodies
