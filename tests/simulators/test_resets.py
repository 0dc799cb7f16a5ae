"""Initialisers and the plan of a reset."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from safe_inspect.config.experiment import load_experiment
from safe_inspect.environments import BatchedEnvironment
from safe_inspect.random.streams import Streams
from safe_inspect.simulators.resets.initializers import (
    CWH3DRadialWithSunInitializer,
    PositionVelocityInitializer,
    RejectionSamplerInitializer,
)
from safe_inspect.simulators.resets.parameters import ConstantParameter, SimAttributeAccessor, UniformParameter
from safe_inspect.simulators.resets.plan import BodyReset, EnvironmentDraw, ResetPlan


def array(*values: float) -> np.ndarray:
    return np.array(values)


def test_polar_starts_at_known_angles():
    states = CWH3DRadialWithSunInitializer()(
        {
            "radius": array(60.0, 60.0, 60.0, 60.0),
            "azimuth_angle": array(0.0, math.pi / 2, 1.0, math.pi),
            "elevation_angle": array(0.0, 0.0, math.pi / 2, math.pi / 6),
            "vel_mag": array(0.2, 0.2, 0.2, 0.0),
            "vel_azimuth_angle": array(math.pi, 0.0, 0.0, 0.3),
            "vel_elevation_angle": array(0.0, -math.pi / 2, math.pi / 4, 0.4),
            "sun_angle": array(0.0, 1.0, 2.0, 3.0),
        }
    )
    half = 60.0 * math.cos(math.pi / 6)
    np.testing.assert_allclose(
        states["position"], [[60, 0, 0], [0, 60, 0], [0, 0, 60], [-half, 0, 30]], rtol=0, atol=1e-13
    )
    root = 0.2 * math.sqrt(0.5)
    np.testing.assert_allclose(
        states["velocity"], [[-0.2, 0, 0], [0, 0, -0.2], [root, 0, root], [0, 0, 0]], rtol=0, atol=1e-15
    )
    np.testing.assert_array_equal(states["sun_angle"], [0.0, 1.0, 2.0, 3.0])


def test_components_are_taken_as_they_are():
    names = ("x", "y", "z", "x_dot", "y_dot", "z_dot")
    values = {name: array(float(index), -float(index)) for index, name in enumerate(names)}
    states = PositionVelocityInitializer()(values)
    np.testing.assert_array_equal(states["position"], [[0, 1, 2], [0, -1, -2]])
    np.testing.assert_array_equal(states["velocity"], [[3, 4, 5], [-3, -4, -5]])


def test_accepted_states_are_taken_by_name():
    states = {"position": np.ones((2, 3)), "velocity": np.zeros((2, 3)), "sun_angle": np.zeros(2)}
    assert set(RejectionSamplerInitializer()({"init_state": states})) == {"position", "velocity"}
    taken = RejectionSamplerInitializer(states=("velocity",))({"init_state": states})
    assert taken == {"velocity": states["velocity"]}


def test_a_plan_draws_every_body_the_sun_and_the_parameters():
    deputy = BodyReset(
        PositionVelocityInitializer(),
        {"x": UniformParameter(low=50.0, high=60.0), "y": SimAttributeAccessor(attribute_name="offset")}
        | {name: ConstantParameter(value=2.0) for name in ("z", "x_dot", "y_dot", "z_dot")},
    )
    chief = BodyReset(
        PositionVelocityInitializer(),
        {name: ConstantParameter() for name in ("x", "y", "z", "x_dot", "y_dot", "z_dot")},
    )
    plan = ResetPlan(
        {"offset": UniformParameter(low=-1.0, high=1.0)},
        {"blue0": deputy, "blue1": deputy},
        {"chief": chief},
        (EnvironmentDraw("sun_angle", "sun", SimAttributeAccessor(attribute_name="offset")),),
    )
    bodies, values = plan.draw(Streams(3, np.arange(6), np.zeros(6, dtype=np.int64)))
    assert list(bodies) == ["blue0", "blue1", "chief"]
    np.testing.assert_array_equal(values["sun_angle"], values["offset"])
    np.testing.assert_array_equal(bodies["blue0"]["position"][:, 1], values["offset"])
    np.testing.assert_array_equal(bodies["chief"]["position"], np.zeros((6, 3)))
    # Each body draws for itself.
    assert not np.isclose(bodies["blue0"]["position"][:, 0], bodies["blue1"]["position"][:, 0]).any()


def test_a_deputy_that_is_drawn_again_keeps_the_other_values_of_its_row():
    deputy = BodyReset(
        PositionVelocityInitializer(),
        {"x": UniformParameter(low=0.0, high=20.0), "y": SimAttributeAccessor(attribute_name="offset")}
        | {name: ConstantParameter() for name in ("z", "x_dot", "y_dot", "z_dot")},
    )
    offset = {"offset": UniformParameter(low=-1.0, high=1.0)}
    plan = ResetPlan(offset, {"blue0": deputy, "blue1": deputy}, {}, separation=8.0)
    bodies, values = plan.draw(Streams(3, np.arange(40), np.zeros(40, dtype=np.int64)))
    apart = np.abs(bodies["blue0"]["position"][:, 0] - bodies["blue1"]["position"][:, 0])
    assert apart.min() >= 8.0
    for name in ("blue0", "blue1"):
        np.testing.assert_array_equal(bodies[name]["position"][:, 1], values["offset"])


def test_without_a_draw_the_angle_of_the_sun_is_zero(shipped):
    spec = load_experiment(shipped).spec
    env = BatchedEnvironment(replace(spec, reset=replace(spec.reset, environment=())), 3)
    env.reset()
    np.testing.assert_array_equal(env.state.sun_angle, np.zeros(3))
    np.testing.assert_array_equal(env.state.sun_direction, [[1.0, 0.0, 0.0]] * 3)


def weights(shipped, azimuth: float, elevation: float) -> tuple[np.ndarray, np.ndarray]:
    vector = "simulator_reset_parameters.priority_vector"
    env = BatchedEnvironment(
        load_experiment(
            shipped,
            [
                f"env_config.{vector}_azimuth_angle={azimuth}",
                f"env_config.{vector}_elevation_angle={elevation}",
            ],
        ).spec,
        2,
    )
    env.reset()
    return env.simulation.world.points["chief"].points / 10.0, env.state.points["chief"].weights


@pytest.mark.parametrize(("azimuth", "elevation"), [(0.0, 0.0), (1.1, -0.4), (4.0, 1.5)])
def test_points_far_from_the_priority_weigh_less_the_nearer_its_opposite(shipped, azimuth, elevation):
    """A weight is the angle between a point and the direction opposite to the priority, over the sum of all."""
    normals, drawn = weights(shipped, azimuth, elevation)
    priority = np.array(
        [math.cos(azimuth) * math.cos(elevation), math.sin(azimuth) * math.cos(elevation), math.sin(elevation)]
    )
    angles = np.array([math.acos(max(-1.0, min(1.0, -float(normal @ priority)))) for normal in normals])
    np.testing.assert_allclose(drawn, np.tile(angles / angles.sum(), (2, 1)), rtol=1e-9)
    np.testing.assert_allclose(drawn.sum(axis=1), 1.0, rtol=1e-12)
    # The heaviest point is the one nearest to the priority vector.
    assert drawn[0].argmax() == (normals @ priority).argmax()


def test_without_a_priority_all_points_weigh_the_same(fixed_start):
    env = BatchedEnvironment(fixed_start((60.0, 0.0, 0.0)))
    env.reset()
    np.testing.assert_array_equal(env.state.points["chief"].weights, np.full((1, 100), 0.01))
