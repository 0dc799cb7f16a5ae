from __future__ import annotations

import math

import numpy as np
import pytest

from safe_inspect.environments import BatchedEnvironment
from safe_inspect.platforms.state_sensors import SunAngleSensor

STILL = np.zeros((1, 1, 3))


def reading(env: BatchedEnvironment, sensor: str) -> np.ndarray:
    return env.view().reading(sensor)[0]


def test_sensors_of_the_own_state_and_of_the_chief(fixed_start):
    env = BatchedEnvironment(fixed_start((60.0, -5.0, 7.0), (0.1, 0.2, -0.3), 0.5, chief=(0.0, 9.0, 0.0)))
    env.reset()
    np.testing.assert_array_equal(reading(env, "Sensor_Position"), [60.0, -5.0, 7.0])
    np.testing.assert_array_equal(reading(env, "Sensor_Velocity"), [0.1, 0.2, -0.3])
    np.testing.assert_array_equal(reading(env, "Sensor_SunAngle"), [0.5])
    np.testing.assert_array_equal(reading(env, "reference_position"), [0.0, 9.0, 0.0])
    np.testing.assert_array_equal(reading(env, "reference_velocity"), [0.0, 0.0, 0.0])


def test_the_sun_angle_is_wrapped_unless_it_is_not(fixed_start):
    env = BatchedEnvironment(fixed_start((60.0, 0.0, 0.0), sun_angle=-1.0))
    env.reset()
    assert reading(env, "Sensor_SunAngle")[0] == pytest.approx(2.0 * math.pi - 1.0)
    view = env.view()
    assert SunAngleSensor(wrap=False)(view)[0, 0] == -1.0
    assert SunAngleSensor().limits == (0.0, 2.0 * math.pi)
    assert SunAngleSensor(wrap=False).limits == (-math.inf, math.inf)


@pytest.mark.parametrize("angle", [-1e-20, 0.0, 2 * math.pi, 4 * math.pi, -2 * math.pi])
def test_a_wrapped_angle_is_below_a_full_turn(fixed_start, angle):
    env = BatchedEnvironment(fixed_start((60.0, 0.0, 0.0), sun_angle=angle))
    env.reset()
    assert 0.0 <= reading(env, "Sensor_SunAngle")[0] < 2.0 * math.pi


def test_the_direction_leads_to_what_is_left_to_inspect(fixed_start):
    """From +x with the sun near -y, what is lit and not seen lies beyond the horizon."""
    env = BatchedEnvironment(fixed_start((60.0, 0.0, 0.0), sun_angle=math.pi / 2))
    env.reset()
    view = env.view()
    points = view.points("chief")
    left = points.model.points[(points.lit & ~points.inspected)[0]]
    assert len(left) > 20
    assert (left[:, 0] < 10.0 / 6.0).all()
    direction = reading(env, "Sensor_UninspectedPoints")
    assert np.linalg.norm(direction) == pytest.approx(1.0)
    # Every centre is a mean of such points; the nearest to the deputy is among those with the largest x.
    assert direction[1] < 0.0
    centres = view.memory("Sensor_UninspectedPoints", "centres")[0]
    count = view.memory("Sensor_UninspectedPoints", "count")[0]
    assert count == math.ceil(len(left) / 10)
    owner = np.argmin(np.linalg.norm(left[:, None] - centres[None, :count], axis=-1), axis=1)
    for index in range(count):  # a fixed point of Lloyd's iteration
        np.testing.assert_allclose(centres[index], left[owner == index].mean(axis=0), atol=1e-12)
    nearest = centres[np.argmin(np.linalg.norm(centres[:count] - [60.0, 0.0, 0.0], axis=1))]
    np.testing.assert_allclose(direction, nearest / np.linalg.norm(nearest), atol=1e-12)


def test_no_direction_when_nothing_is_left(fixed_start):
    only = "env_config.simulator.config.inspection_points_map.chief.num_points=1"
    env = BatchedEnvironment(fixed_start((60.0, 0.0, 0.0), overrides=[only]))
    env.reset()
    np.testing.assert_array_equal(reading(env, "Sensor_UninspectedPoints"), [0.0, 0.0, 0.0])


def test_counts_are_of_the_deputy_that_inspected_first(fixed_start):
    env = BatchedEnvironment(fixed_start((60.0, 0.0, 0.0)))
    env.reset()
    points = env.view().points("chief")
    count = reading(env, "Sensor_InspectedPoints")[0]
    assert count == points.count_of("blue0")[0] == points.count[0] == points.inspected.sum()
