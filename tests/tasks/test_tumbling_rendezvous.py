"""The learning task of docking with a tumbling target: observations, rewards, ends, batches and the baseline."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest

import safe_inspect
from safe_inspect.dynamics import quaternion
from safe_inspect.environments import BatchedEnvironment, TeamEnvironment, load_spec
from safe_inspect.errors import ConfigError
from safe_inspect.evaluation.policies import with_scripted
from safe_inspect.evaluation.rollouts import rollout

TASK = "safe_inspect/TumblingRendezvous-v0"
COAST = 3  # index of the level 0 N
AT_REST = "target_tumble.config.rate={type: ConstantParameter, config: {value: 0}}"


def environment(num_envs: int, *overrides: str, seed: int = 1) -> BatchedEnvironment:
    env = BatchedEnvironment(load_spec(TASK, overrides), num_envs, seed=seed)
    env.reset()
    return env


def coast(env: BatchedEnvironment):
    return env.step(np.full((env.num_envs, 1, 3), float(COAST)))


def test_the_observation_is_that_of_the_state():
    env = environment(20)
    observed = coast(env).observation[:, 0]
    state = env.state
    axes = quaternion.to_matrix(state.target_orientation)[:, :, :2].transpose(0, 2, 1).reshape(20, 6)
    spin = quaternion.rotate(state.target_orientation, state.target_angular_velocity)
    expected = (
        (state.mating_point_position - state.position[:, 0]) / 0.5,
        (state.mating_point_velocity - state.velocity[:, 0]) / 0.05,
        axes,
        spin / 0.05,
        (state.clearance - 0.25) / 0.25,
    )
    np.testing.assert_allclose(observed, np.concatenate(expected, axis=1), rtol=1e-5, atol=1e-5)


def test_docking_ends_with_a_win_and_is_paid():
    env = environment(4, AT_REST)
    env.state.position[:, 0] = env.state.mating_point_position
    env.state.position[1, 0, 0] += 0.029
    env.state.position[2, 0, 0] += 0.031  # too far away
    env.state.velocity[3, 0, 2] = 0.011  # too fast
    told = coast(env)
    assert told.status[:, 0].tolist() == [1, 1, 0, 0]
    assert told.terminated[:, 0].tolist() == [True, True, False, False]
    np.testing.assert_array_equal(told.terms["MatingSuccessReward"][:, 0], [3.0, 3.0, 0.0, 0.0])


def test_moving_with_the_mating_point_is_what_counts():
    env = environment(64)
    coast(env)
    env.state.position[:, 0] = env.state.mating_point_position - env.state.mating_point_velocity
    env.state.velocity[:, 0] = 0.0  # it comes to the mating point, and is at rest there
    before = env.state.mating_point_velocity.copy()
    env.state.position[:, 0] += 2.0 * before  # where the mating point will be, to the second order
    fast = np.linalg.norm(before, axis=1) > 0.0105
    status = coast(env).status[:, 0]
    assert fast.sum() > 20
    assert (status[fast] == 0).all()
    env.state.position[:, 0] = env.state.mating_point_position
    env.state.velocity[:, 0] = env.state.mating_point_velocity
    assert (coast(env).status == 1).all()


def test_contact_and_leaving_end_with_a_loss():
    env = environment(3, AT_REST)
    env.state.position[0, 0] = 0.0
    env.state.position[1, 0] = [0.0, 3.1, 0.0]
    told = coast(env)
    assert told.status[:, 0].tolist() == [2, 2, 0]
    np.testing.assert_array_equal(told.terms["ContactReward"][:, 0], [-1.0, 0.0, 0.0])
    assert env.state.clearance[0, 0] < 0.0


def test_a_docked_chaser_that_touches_the_target_has_lost():
    place = "env_config.simulator.config.components.0.config.mating_point=[0, 0.2, 0]"
    env = environment(1, AT_REST, place)
    env.state.position[:, 0] = env.state.mating_point_position
    assert coast(env).status[0, 0] == 2


def test_progress_adds_up_to_what_the_docking_error_has_lost():
    env = environment(8)
    generator = np.random.default_rng(2)

    def error() -> np.ndarray:
        state = env.state
        apart = np.linalg.norm(state.mating_point_position - state.position[:, 0], axis=1)
        return np.hypot(apart, 5.0 * np.linalg.norm(state.mating_point_velocity - state.velocity[:, 0], axis=1))

    begun, paid, spent = error(), np.zeros(8), np.zeros(8)
    for _ in range(15):
        told = env.step(generator.integers(0, 7, (8, 1, 3)).astype(np.float64))
        paid += told.terms["MatingProgressReward"][:, 0]
        spent += told.terms["FuelReward"][:, 0]
    np.testing.assert_allclose(paid, begun - error(), atol=1e-12)
    np.testing.assert_allclose(spent, -env.state.delta_v[:, 0], atol=1e-12)


@pytest.mark.parametrize("fused", [True, False])
def test_a_row_of_a_batch_is_the_environment_alone(fused):
    spec = load_spec(TASK, ["horizon=25"])
    actions = np.random.default_rng(1).integers(0, 7, (60, 9, 1, 3)).astype(np.float64)

    def fly(first: int, count: int) -> list[bytes]:
        env = TeamEnvironment(spec, count, seed=3, first_slot=first, _fused=fused)
        env.reset()
        seen, own = [], 0 if count == 1 else 4
        for action in actions:
            told = env.step([action[first : first + count]])
            (group,) = told.groups
            arrays = (group.observation, group.reward, group.status, *env.state.arrays.values())
            seen.append(b"".join(np.ascontiguousarray(array[own]).tobytes() for array in arrays))
            if told.over.any():
                env.reset(np.flatnonzero(told.over))
        return seen

    assert fly(0, 9) == fly(4, 1)


def test_the_compiled_step_gives_what_the_plugins_give():
    spec = load_spec(TASK)
    one, other = (TeamEnvironment(spec, 16, seed=3, _fused=fused) for fused in (True, False))
    assert one.reset()[0].tobytes() == other.reset()[0].tobytes()
    assert one.groups[0].fused.called_in_python == ()
    generator = np.random.default_rng(1)
    for _ in range(30):
        action = [generator.integers(0, 7, (16, 1, 3)).astype(np.float64)]
        told = [env.step(action).groups[0] for env in (one, other)]
        for name in ("observation", "reward", "status"):
            assert getattr(told[0], name).tobytes() == getattr(told[1], name).tobytes()


def test_it_is_made_by_its_id():
    env = gymnasium.make(TASK)
    observation, info = env.reset(seed=3)
    assert observation.shape == (16,)
    assert env.action_space == gymnasium.spaces.MultiDiscrete([7, 7, 7])
    assert {"mating_point_distance", "mating_point_speed", "least_clearance"} <= set(info)
    assert "inspected_count" not in info
    made = safe_inspect.make(TASK)
    np.testing.assert_array_equal(made.reset(seed=3)[0], observation)


def test_the_controller_docks_and_its_episodes_are_measured():
    spec = with_scripted(load_spec(TASK), "DockingController")
    episodes = rollout(spec, {}, 64, seed=5, num_envs=64)
    assert (np.asarray(episodes.status) == 1).all()  # the filter prevents the few contacts


def test_a_safety_filter_for_orbits_is_refused():
    wrapped = "[{functor: DiscreteControllerGlue, config: {controller: X Thrust, levels: [-0.3, 0, 0.3]}}]"
    glue = f"{{functor: RTAGlueCWHInspection1v1, config: {{enabled: True}}, wrapped: {wrapped}}}"
    with pytest.raises(ConfigError, match="these deputies move by DoubleIntegrator; disable"):
        load_spec(TASK, [f"agent_config.chaser_ctrl.config.config.glues.0={glue}"])
