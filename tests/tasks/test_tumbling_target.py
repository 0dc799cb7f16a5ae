"""The tumbling target: its motion, mating point, shape and reset, against closed forms and NumPy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from pydantic import ValidationError

from safe_inspect.dynamics import quaternion
from safe_inspect.dynamics.attitude.inertia import principal_axes
from safe_inspect.dynamics.double_integrator import double_integrator_row
from safe_inspect.dynamics.rotation_row import rotated, rotated_back
from safe_inspect.dynamics.tumble import tumble
from safe_inspect.environments import BatchedEnvironment, load_spec
from safe_inspect.errors import ConfigError, InitialStateError
from safe_inspect.geometry.oriented_boxes import BoxArrays, OrientedBoxes, box_distance
from safe_inspect.random.streams import Streams
from safe_inspect.simulators import Draw
from safe_inspect.simulators.resets.parameters import ConstantParameter, UniformParameter
from safe_inspect.tasks.docking.shape import ENVISAT_BOXES, ENVISAT_INERTIA, boxes_in_principal_axes
from safe_inspect.tasks.docking.target import TumblingTarget
from safe_inspect.tasks.docking.tumble_parameter import TumbleParameter, tumble_states

TASK = "safe_inspect/TumblingRendezvous-v0"
COAST = 3  # index of the level 0 N


def environment(num_envs: int, *overrides: str, seed: int = 1) -> BatchedEnvironment:
    env = BatchedEnvironment(load_spec(TASK, overrides), num_envs, seed=seed)
    env.reset()
    return env


def coast(env: BatchedEnvironment) -> None:
    env.step(np.full((env.num_envs, 1, 3), float(COAST)))


def test_the_attitude_follows_the_closed_form():
    env = environment(32)
    q0, w0 = env.state.target_orientation.copy(), env.state.target_angular_velocity.copy()
    for _ in range(60):
        coast(env)
    moments, _ = principal_axes(ENVISAT_INERTIA)
    q, w = tumble(moments, q0, w0, np.array([60.0]))
    np.testing.assert_allclose(env.state.target_angular_velocity, w[:, 0], atol=1e-9)
    apart = quaternion.log(quaternion.multiply(quaternion.conjugate(env.state.target_orientation), q[:, 0]))
    assert np.linalg.norm(apart, axis=1).max() < 2e-7


def test_the_mating_point_turns_with_the_target():
    env = environment(16, "horizon=1000")
    places = []
    for _ in range(3):
        state = env.state
        place = quaternion.rotate(state.target_orientation, np.array([0.0, 0.45, 0.0]))
        np.testing.assert_allclose(state.mating_point_position, place, atol=1e-15)
        spin = quaternion.rotate(state.target_orientation, state.target_angular_velocity)
        np.testing.assert_allclose(state.mating_point_velocity, np.cross(spin, place), atol=1e-15)
        places.append((place, state.mating_point_velocity.copy()))
        coast(env)
    difference = (places[2][0] - places[0][0]) / 2.0  # over 2 s; the next term of the series is of the order w^3 r / 6
    np.testing.assert_allclose(difference, places[1][1], atol=0.1**3 * 0.45 / 6)


def test_the_clearance_is_the_distance_to_the_boxes_in_the_model_frame():
    env = environment(200)
    for _ in range(20):
        coast(env)
    state = env.state
    _, rotation = principal_axes(ENVISAT_INERTIA)
    in_target = quaternion.rotate(quaternion.conjugate(state.target_orientation), state.position[:, 0])
    rolls = [np.array([[1, 0, 0], [0, np.cos(b.roll), -np.sin(b.roll)], [0, np.sin(b.roll), np.cos(b.roll)]])
             for b in ENVISAT_BOXES]  # fmt: skip
    boxes = OrientedBoxes(
        0.05 * np.array([b.centre for b in ENVISAT_BOXES]),
        0.05 * np.array([b.half_size for b in ENVISAT_BOXES]),
        np.array(rolls),
    )
    np.testing.assert_allclose(state.clearance[:, 0], boxes.distance(in_target @ rotation.T), atol=1e-14)
    assert (state.least_clearance <= state.clearance).all()


def test_the_mating_point_can_be_reached_and_every_reset_is_clear():
    _, rotation = principal_axes(ENVISAT_INERTIA)
    boxes = boxes_in_principal_axes(ENVISAT_BOXES, 0.05, rotation)
    for point in ((0.0, 0.45, 0.0), (0.25, 0.0, 0.42)):
        assert 0.25 + 0.12 <= box_distance(boxes, *point) <= 0.25 + 0.13
    env = environment(2000)
    assert env.state.clearance.min() > 0.25
    assert np.linalg.norm(env.state.mating_point_velocity, axis=1).max() < 0.0873 * 0.45 * 1.001


def test_attitudes_and_directions_are_uniform():
    env = environment(4000)
    rotations = quaternion.to_matrix(env.state.target_orientation)
    assert np.abs(rotations.mean(axis=0)).max() < 4.0 * (1.0 / 3.0) ** 0.5 / 4000**0.5
    rate = np.linalg.norm(env.state.target_angular_velocity, axis=1)
    assert np.rad2deg(rate.min()) >= 1.0
    assert np.rad2deg(rate.max()) <= 5.0
    assert np.rad2deg(rate.mean()) == pytest.approx(3.0, abs=0.1)
    direction = env.state.target_angular_velocity / rate[:, None]
    assert np.abs((direction**2).mean(axis=0) - 1.0 / 3.0).max() < 0.03
    np.testing.assert_allclose(np.linalg.norm(env.state.target_orientation, axis=1), 1.0, atol=1e-15)


def test_a_tumble_is_given():
    word = "target_tumble.config"
    given = (f"{word}.direction=[0, 0, 2]", f"{word}.orientation=[0, 0, 1, 1]")
    with pytest.raises(ConfigError, match="rate"):
        environment(1, *given, f"{word}.rate=null")
    env = environment(3, *given, f"{word}.rate={{type: ConstantParameter, config: {{value: 0.1}}}}")
    np.testing.assert_allclose(env.state.target_angular_velocity, [[0.0, 0.0, 0.1]] * 3)
    np.testing.assert_allclose(env.state.target_orientation, [[0.0, 0.0, 0.5**0.5, 0.5**0.5]] * 3)
    np.testing.assert_allclose(env.state.mating_point_position, [[-0.45, 0.0, 0.0]] * 3, atol=1e-16)


def test_without_a_tumble_the_target_rests():
    spec = load_spec(TASK)
    env = BatchedEnvironment(replace(spec, reset=replace(spec.reset, parameters={})), 2)
    env.reset()
    coast(env)
    np.testing.assert_array_equal(env.state.target_orientation, [[0.0, 0.0, 0.0, 1.0]] * 2)
    np.testing.assert_array_equal(env.state.mating_point_position, [[0.0, 0.45, 0.0]] * 2)


def test_mistakes_are_one_message():
    with pytest.raises(ConfigError, match="expected the states of a body here"):
        load_spec(TASK, ["simulator_reset_parameters.target_tumble={type: ConstantParameter, config: {value: 1}}"])
    with pytest.raises(ValidationError, match="must be a symmetric matrix"):
        TumblingTarget(inertia=((1, 2, 0), (0, 1, 0), (0, 0, 1)))
    with pytest.raises(ValidationError, match="no body has the principal moments"):
        TumblingTarget(inertia=((1, 0, 0), (0, 1, 0), (0, 0, 3)))
    with pytest.raises(ValidationError, match="neither a direction nor an attitude"):
        TumbleParameter(direction=(0, 0, 0))
    with pytest.raises(ValidationError, match="number in rad/s"):
        TumbleParameter(rate=UniformParameter(units="m"))
    env = environment(1)
    with pytest.raises(InitialStateError, match="gives no attitude and angular velocity; use TumbleParameter"):
        env.simulation.components["TumblingTarget"].reset(env.state, {"target_tumble": {"position": np.zeros((1, 3))}})


@pytest.mark.parametrize(
    ("orientation", "rate", "message"),
    [
        ([[0.0, 0.0, 0.0, 1.0]] * 2, np.zeros((2, 3)), "`Mine` returned .* as orientation; it must be an array"),
        (np.eye(4)[3], np.zeros((2, 3)), r"an array of shape \(4,\) as orientation; .* shape \(2, 4\)"),
        (np.eye(4)[:2], np.zeros(3), r"an array of shape \(3,\) as angular_velocity; .* shape \(2, 3\)"),
        (np.eye(4)[:2], np.full((2, 3), np.nan), "`Mine` must give unit quaternions as orientation and finite numbers"),
        (2.0 * np.eye(4)[:2], np.zeros((2, 3)), "`Mine` must give unit quaternions"),
    ],
)
def test_the_result_of_a_tumble_is_checked(orientation, rate, message):
    with pytest.raises(InitialStateError, match=message):
        tumble_states("Mine", {"orientation": orientation, "angular_velocity": rate}, 2)


def test_the_draws_of_a_row_do_not_depend_on_the_batch():
    slots = np.arange(20)
    parameter = TumbleParameter(rate=ConstantParameter(value=0.05))
    whole = parameter(Draw(Streams(3, slots, slots % 4), "target_tumble"))
    for row in (0, 19):
        alone = parameter(Draw(Streams(3, slots[row : row + 1], slots[row : row + 1] % 4), "target_tumble"))
        assert {name: array[row].tobytes() for name, array in whole.items()} == {
            name: array[0].tobytes() for name, array in alone.items()
        }


def test_row_kernels_agree_with_the_batches():
    generator = np.random.default_rng(5)
    q = quaternion.normalise(generator.normal(size=(50, 4)))
    v = generator.normal(size=(50, 3))
    forth = np.array([rotated(*pair) for pair in zip(q, *v.T, strict=True)])
    np.testing.assert_allclose(forth, quaternion.rotate(q, v), atol=1e-15)
    back = np.array([rotated_back(*pair) for pair in zip(q, *forth.T, strict=True)])
    np.testing.assert_allclose(back, v, atol=1e-14)
    boxes = OrientedBoxes(
        generator.normal(size=(5, 3)), generator.uniform(0.1, 1.0, (5, 3)), quaternion.to_matrix(q[:5])
    )
    arrays = BoxArrays(boxes.centre, boxes.half_size, boxes.rotation)
    points = generator.normal(size=(300, 3))
    found = [box_distance(arrays, *point) for point in points]
    np.testing.assert_allclose(found, boxes.distance(points), atol=1e-14)
    assert min(found) < 0.0 < max(found)


def test_the_double_integrator_is_exact():
    position, velocity = np.array([1.0, 2.0, 3.0]), np.array([0.1, 0.0, -0.1])
    rate = double_integrator_row(2.0, position, velocity, np.array([1.0, -2.0, 0.0]), 4.0)
    np.testing.assert_allclose(position, [1.0 + 0.2 + 0.5, 2.0 - 1.0, 3.0 - 0.2])
    np.testing.assert_allclose(velocity, [0.6, -1.0, -0.1])
    assert rate == pytest.approx(0.75)
