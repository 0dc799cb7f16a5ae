"""Short episodes against closed forms: trajectories, the exact points, every reward term and every end."""

from __future__ import annotations

import math

import numpy as np
import pytest

from safe_inspect.dones import DoneStatus
from safe_inspect.environments import BatchedEnvironment

N, RADIUS, MASS, DT = 0.001027, 10.0, 12.0, 10.0


def fibonacci(count: int = 100) -> np.ndarray:
    i = np.arange(count)
    z = 1.0 - (2.0 * i + 1.0) / count
    azimuth = i * math.pi * (3.0 - math.sqrt(5.0))
    return RADIUS * np.stack((np.sqrt(1.0 - z * z) * np.cos(azimuth), np.sqrt(1.0 - z * z) * np.sin(azimuth), z), -1)


def closed_form(start: np.ndarray, thrust: np.ndarray, t: float) -> np.ndarray:
    """Position and velocity after t seconds of constant thrust, solved from the Clohessy-Wiltshire equations."""
    x, y, z, vx, vy, vz = start
    ax, ay, az = thrust / MASS
    s, c, nt = math.sin(N * t), math.cos(N * t), N * t
    return np.array(
        [
            (4 - 3 * c) * x + s / N * vx + 2 * (1 - c) / N * vy + ax * (1 - c) / N**2 + 2 * ay * (nt - s) / N**2,
            6 * (s - nt) * x + y - 2 * (1 - c) / N * vx + (4 * s - 3 * nt) / N * vy
            - 2 * ax * (nt - s) / N**2 + ay * (4 * (1 - c) / N**2 - 1.5 * t * t),
            c * z + s / N * vz + az * (1 - c) / N**2,
            3 * N * s * x + c * vx + 2 * s * vy + ax * s / N + 2 * ay * (1 - c) / N,
            -6 * N * (1 - c) * x - 2 * s * vx + (4 * c - 3) * vy - 2 * ax * (1 - c) / N + ay * (4 * s / N - 3 * t),
            -N * s * z + c * vz + az * s / N,
        ]
    )  # fmt: skip


def new_points(position: np.ndarray, sun_angle: float) -> np.ndarray:
    points = fibonacci()
    sun = np.array([math.cos(sun_angle), -math.sin(sun_angle), 0.0])
    return (points @ position >= RADIUS**2) & (points @ sun > 0.0)


def test_the_points_seen_from_60_m_with_the_sun_behind(fixed_start):
    env = BatchedEnvironment(fixed_start((60.0, 0.0, 0.0), sun_angle=0.0))
    observation = env.reset()[0, 0]
    expected = fibonacci()[:, 0] >= RADIUS / 6.0  # q . p >= R^2 with p = 60 m along x
    np.testing.assert_array_equal(env.state.points["chief"].inspector[0] >= 0, expected)
    assert 40 <= expected.sum() <= 43  # a cap of (1 - 1/6)/2 of the sphere
    assert observation[6] == pytest.approx(expected.sum() / 100.0)


def test_a_sun_on_the_other_side_lights_nothing_that_is_seen(fixed_start):
    env = BatchedEnvironment(fixed_start((60.0, 0.0, 0.0), sun_angle=math.pi))
    env.reset()
    assert env.state.points["chief"].team_count[0] == 0
    # After a quarter turn, the sun is at -y and lights half of what is seen.
    quarter = BatchedEnvironment(fixed_start((60.0, 0.0, 0.0), sun_angle=math.pi / 2))
    quarter.reset()
    points = fibonacci()
    expected = (points[:, 0] >= RADIUS / 6.0) & (points[:, 1] < 0.0)
    np.testing.assert_array_equal(quarter.state.points["chief"].inspector[0] >= 0, expected)


def test_an_episode_of_constant_thrust(fixed_start):
    start, thrust = np.array([60.0, -15.0, 20.0, 0.1, -0.15, 0.05]), np.array([0.02, -0.03, 0.01])
    sun = 0.7
    env = BatchedEnvironment(fixed_start(start[:3], start[3:], sun))
    first = env.reset()[0, 0]
    inspected = new_points(start[:3], sun)
    assert first[6] == pytest.approx(inspected.sum() / 100.0)
    at_reset, paid = inspected.sum(), 0.0
    for step in range(1, 61):
        transition = env.step(thrust[None, None])
        state = closed_form(start, thrust, step * DT)
        before = inspected.sum() if step > 1 else 0  # what is seen at the reset is paid in the first step
        inspected |= new_points(state[:3], sun + N * step * DT)
        np.testing.assert_allclose(env.state.position[0, 0], state[:3], rtol=0, atol=1e-7)
        np.testing.assert_allclose(env.state.velocity[0, 0], state[3:], rtol=0, atol=1e-10)
        np.testing.assert_array_equal(env.state.points["chief"].inspector[0] >= 0, inspected)
        observation = transition.observation[0, 0]
        np.testing.assert_allclose(observation[:3], state[:3] / 100.0, rtol=1e-6, atol=1e-7)
        np.testing.assert_allclose(observation[3:6], state[3:] / 0.5, rtol=1e-6, atol=1e-7)
        assert observation[6] == np.float32(inspected.sum() / 100.0)
        assert observation[10] == pytest.approx((sun + N * step * DT) % (2 * math.pi), rel=1e-6)
        terms = {name: value[0, 0] for name, value in transition.terms.items()}
        assert terms == {
            "ObservedPointsReward": pytest.approx(0.01 * (inspected.sum() - before), abs=1e-15),
            "InspectionSuccessReward": 0.0,
            "InspectionCrashReward": 0.0,
            "InspectionDeltaVReward": pytest.approx(-0.001 * 0.06 / MASS * DT),
        }
        assert transition.reward[0, 0] == pytest.approx(sum(terms.values()))
        assert not transition.done[0, 0]
        assert transition.status[0, 0] == DoneStatus.RUNNING
        paid += terms["ObservedPointsReward"]
    assert inspected.sum() > at_reset > 0
    assert paid == pytest.approx(0.01 * inspected.sum())
    assert env.state.delta_v[0, 0] == pytest.approx(60 * 0.06 / MASS * DT)


def test_the_action_is_clipped_to_one_newton(fixed_start):
    env = BatchedEnvironment(fixed_start((60.0, 0.0, 0.0)))
    env.reset()
    transition = env.step(np.array([[[7.0, -0.5, -3.0]]]))
    np.testing.assert_array_equal(transition.step.control, [[1.0, -0.5, -1.0]])
    assert transition.terms["InspectionDeltaVReward"][0, 0] == pytest.approx(-0.001 * 2.5 / MASS * DT)


def run(spec, steps, thrust=(0.0, 0.0, 0.0)):
    env = BatchedEnvironment(spec)
    env.reset()
    for _ in range(steps):
        transition = env.step(np.array([[thrust]]))
    return env, transition


def ending(transition):
    return (
        bool(transition.terminated[0, 0]),
        bool(transition.truncated[0, 0]),
        DoneStatus(int(transition.status[0, 0])),
    )


def test_a_crash_loses(fixed_start):
    env, transition = run(fixed_start((14.0, 0.0, 0.0), (-0.5, 0.0, 0.0)), 1)
    assert np.linalg.norm(env.state.position[0, 0]) == pytest.approx(9.0, abs=0.05)
    assert ending(transition) == (True, False, DoneStatus.LOSE)
    assert transition.terms["InspectionCrashReward"][0, 0] == -1.0


def test_a_near_miss_does_not_lose(fixed_start):
    _, transition = run(fixed_start((15.1, 0.0, 0.0), (-0.5, 0.0, 0.0)), 1)
    assert ending(transition) == (False, False, DoneStatus.RUNNING)
    assert transition.terms["InspectionCrashReward"][0, 0] == 0.0


def test_leaving_the_range_loses(fixed_start):
    inside = run(fixed_start((0.0, 790.0, 0.0), (0.0, 0.9, 0.0)), 1)[1]
    outside = run(fixed_start((0.0, 790.0, 0.0), (0.0, 0.9, 0.0)), 2)[1]
    assert ending(inside) == (False, False, DoneStatus.RUNNING)
    assert ending(outside) == (True, False, DoneStatus.LOSE)
    assert outside.terms["InspectionCrashReward"][0, 0] == 0.0


ONE_POINT = ("env_config.simulator.config.inspection_points_map.chief.num_points=1",)  # it lies at +x


def test_success_wins(fixed_start):
    _, transition = run(fixed_start((60.0, 0.0, 0.0), overrides=ONE_POINT), 1)
    assert ending(transition) == (True, False, DoneStatus.WIN)
    assert transition.terms["InspectionSuccessReward"][0, 0] == 1.0
    assert transition.terms["ObservedPointsReward"][0, 0] == 0.01


def test_the_time_limit_is_a_draw_and_a_truncation(fixed_start):
    spec = fixed_start((60.0, 0.0, 0.0), overrides=["horizon=3"])
    assert ending(run(spec, 2)[1]) == (False, False, DoneStatus.RUNNING)
    assert ending(run(spec, 3)[1]) == (False, True, DoneStatus.DRAW)


def test_a_win_in_the_last_step_is_no_draw(fixed_start):
    spec = fixed_start((60.0, 0.0, 0.0), overrides=["horizon=1", *ONE_POINT])
    assert ending(run(spec, 1)[1]) == (True, False, DoneStatus.WIN)


def test_a_crash_is_no_win(fixed_start):
    spec = fixed_start((14.0, 0.0, 0.0), (-0.5, 0.0, 0.0), overrides=ONE_POINT)
    _, transition = run(spec, 1)
    assert ending(transition) == (True, False, DoneStatus.LOSE)
    assert transition.reward[0, 0] == pytest.approx(0.01 + 1.0 - 1.0)


def test_ranges_are_measured_from_the_chief(fixed_start):
    """The reference position sensor locates the chief wherever it is."""
    spec = fixed_start((0.0, 512.0, 0.0), chief=(0.0, 500.0, 0.0))
    _, transition = run(spec, 1, (0.0, -1.0, 0.0))  # 1 N on 12 kg for 10 s: 4.2 m nearer
    assert ending(transition) == (True, False, DoneStatus.LOSE)
    assert transition.terms["InspectionCrashReward"][0, 0] == -1.0
