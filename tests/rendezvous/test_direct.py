"""The direct approach meets its boundary states and is one motion in both frames."""

from __future__ import annotations

import dataclasses

import numpy as np

from safe_inspect.rendezvous.planner.direct import direct_approach


def test_it_starts_at_the_state_and_ends_at_rest_on_the_mating_point(query, plan):
    np.testing.assert_allclose(plan.position[0], query.state[:3], atol=1e-12)
    np.testing.assert_allclose(plan.velocity[0], query.state[3:], atol=1e-12)
    np.testing.assert_allclose(plan.acceleration[0], 0.0, atol=1e-12)
    np.testing.assert_allclose(plan.position_target[-1], query.mating_point, atol=1e-12)
    np.testing.assert_allclose(plan.velocity_target[-1], 0.0, atol=1e-12)
    np.testing.assert_allclose(plan.acceleration_target[-1], 0.0, atol=1e-12)


def test_velocity_acceleration_and_force_are_those_of_the_path(query):
    plan = direct_approach(dataclasses.replace(query, durations=(20.0,)), step=0.01)
    np.testing.assert_allclose(np.gradient(plan.position, 0.01, axis=0)[1:-1], plan.velocity[1:-1], atol=1e-6)
    np.testing.assert_allclose(np.gradient(plan.velocity, 0.01, axis=0)[1:-1], plan.acceleration[1:-1], atol=1e-6)
    np.testing.assert_allclose(
        np.gradient(plan.position_target, 0.01, axis=0)[1:-1], plan.velocity_target[1:-1], atol=1e-6
    )
    np.testing.assert_allclose(plan.force, query.limits.mass * plan.acceleration)
    assert plan.times[-1] == 20.0
