"""Reward terms that the episode by hand does not cover: their settings."""

from __future__ import annotations

import numpy as np
import pytest

from safe_inspect.environments import BatchedEnvironment
from safe_inspect.rewards.delta_v import InspectionDeltaVReward
from safe_inspect.rewards.inspection import (
    InspectionCrashReward,
    InspectionRTAReward,
    InspectionSuccessReward,
    ObservedPointsReward,
)
from safe_inspect.simulators import Step

THRUST = np.array([[[0.3, -0.5, 0.1]]])


@pytest.fixture
def step(fixed_start) -> Step:
    """Return the first step of an episode from 60 m, the sun behind."""
    env = BatchedEnvironment(fixed_start((60.0, 0.0, 0.0)))
    env.reset()
    return env.step(THRUST).step


def test_fuel_at_a_constant_price(step):
    np.testing.assert_allclose(InspectionDeltaVReward(mode="constant", scale=-0.1)(step), [-0.1 * 0.9 / 12 * 10])


def test_fuel_at_the_simulators_price(step):
    np.testing.assert_allclose(InspectionDeltaVReward(scale=-5.0)(step), [-0.001 * 0.9 / 12 * 10])


@pytest.mark.parametrize(
    ("fields", "delta_v"),
    [({"mass": 6.0}, 0.9 / 6 * 10), ({"step_size": 1.0}, 0.9 / 12), ({"mass": "1 kg", "step_size": "2 s"}, 1.8)],
)
def test_fuel_of_another_mass_or_step(step, fields, delta_v):
    reward = InspectionDeltaVReward.model_validate({"mode": "constant", "scale": -1.0, **fields})
    np.testing.assert_allclose(reward(step), [-delta_v])


def test_fuel_is_no_income():
    with pytest.raises(ValueError, match="less than or equal to 0"):
        InspectionDeltaVReward(scale=0.1)


def test_points_are_paid_by_their_number(step):
    count = step.after.points("chief").count
    np.testing.assert_allclose(ObservedPointsReward(scale=2.0)(step), 2.0 * count)


def test_points_are_paid_once(fixed_start):
    env = BatchedEnvironment(fixed_start((60.0, 0.0, 0.0)))
    env.reset()
    first = env.step(np.zeros((1, 1, 3))).terms["ObservedPointsReward"][0, 0]
    second = env.step(np.zeros((1, 1, 3))).terms["ObservedPointsReward"][0, 0]
    assert first >= 0.4
    assert second <= 0.02


def test_success_is_paid_when_the_last_point_is_inspected(fixed_start):
    few = "env_config.simulator.config.inspection_points_map.chief.num_points=2"  # one faces +x, one -x
    env = BatchedEnvironment(fixed_start((60.0, 0.0, 0.0), overrides=[few]))
    env.reset()
    step = env.step(np.zeros((1, 1, 3))).step
    np.testing.assert_array_equal(InspectionSuccessReward(scale=3.0)(step), [0.0])
    env.state.points["chief"].team_count[:] = 2
    np.testing.assert_array_equal(InspectionSuccessReward(scale=3.0)(step), [3.0])


@pytest.mark.parametrize(("radius", "paid"), [(59.0, 0.0), (70.0, -4.0), ("0.07 km", -4.0)])
def test_a_crash_is_a_range_below_the_radius(step, radius, paid):
    reward = InspectionCrashReward(scale=-4.0, crash_region_radius=radius)
    np.testing.assert_array_equal(reward(step), [paid])


def test_an_intervention_has_a_price(step):
    np.testing.assert_array_equal(InspectionRTAReward()(step), [0.0])
    step.writable_intervening = np.array([True])
    np.testing.assert_array_equal(InspectionRTAReward()(step), [-0.01])


def test_rewards_change_nothing(step):
    before = {name: array.copy() for name, array in step.after.state.arrays.items()}
    for reward in (ObservedPointsReward(), InspectionSuccessReward(), InspectionCrashReward(),
                   InspectionDeltaVReward(), InspectionRTAReward()):  # fmt: skip
        reward(step)
    for name, array in before.items():
        np.testing.assert_array_equal(step.after.state.arrays[name], array)
