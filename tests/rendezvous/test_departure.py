from __future__ import annotations

import numpy as np
import pytest

from safe_inspect.dynamics.cwh import transition
from safe_inspect.dynamics.tide import to_hill
from safe_inspect.rendezvous.coordination.escape import CommandedMotion, departure_velocity

_KEEP_IN = np.array([0.8, 3.0, 0.8])


def test_in_free_space_it_leads_straight_away() -> None:
    np.testing.assert_allclose(departure_velocity(np.array([0.0, -1.5, 0.0]), 0.02, 60.0, _KEEP_IN), [0, -0.02, 0])
    position = np.array([0.3, -1.2, 0.4])
    np.testing.assert_allclose(
        departure_velocity(position, 0.02, 60.0, np.full(3, np.inf)), 0.02 * position / np.linalg.norm(position)
    )


def test_it_stays_in_the_keep_in_box_where_that_opens_the_range() -> None:
    position = np.array([0.6, -1.3, 0.5])
    velocity = departure_velocity(position, 0.02, 60.0, _KEEP_IN)
    np.testing.assert_allclose(velocity, [0.0, -0.02, 0.0])
    assert (np.abs(position + 60.0 * velocity) <= _KEEP_IN).all()
    # Next to the target, the long axis of the box does not lead away from it.
    velocity = departure_velocity(np.array([0.7, -0.1, 0.0]), 0.02, 60.0, _KEEP_IN)
    assert velocity @ [0.7, -0.1, 0.0] > 0.0


@pytest.mark.parametrize("time", [0.0, 1000.0, 4000.0])
@pytest.mark.parametrize("direction", [[1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0.5, -0.7, 0.5]])
def test_on_an_orbit_it_does_not_come_back_in_a_revolution(direction: list[float], time: float) -> None:
    mean_motion = 1.0454e-3
    position = 28.0 * np.array(direction) / np.linalg.norm(direction)
    velocity = departure_velocity(position, 0.2, 60.0, np.full(3, 40.0), (mean_motion, time))
    assert np.linalg.norm(velocity) == pytest.approx(0.2)
    assert velocity @ position > 0.0
    state = to_hill(mean_motion, time, np.concatenate([position, velocity]))
    later = [transition(mean_motion, 1.0, at)[0] @ state for at in np.linspace(0.0, 2.0 * np.pi / mean_motion, 300)]
    assert np.linalg.norm(np.array(later)[:, :3], axis=1).min() >= 27.9


def test_commanded_motion_is_that_of_a_point_under_held_accelerations() -> None:
    motion = CommandedMotion(np.zeros(3), np.array([0.0, 0.1, 0.0]))
    motion.advance(np.array([0.02, 0.0, 0.0]), 2.0)
    motion.advance(np.array([0.0, -0.05, 0.0]), 2.0)
    np.testing.assert_allclose(motion.velocity, [0.04, 0.0, 0.0], atol=1e-15)
    np.testing.assert_allclose(motion.position, [0.12, 0.3, 0.0], atol=1e-15)
