"""Docking: the speed limit, the region along the step, rewards and ends by hand, and the autopilot."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from safe_inspect.config.data import configs_root
from safe_inspect.config.experiment import build_experiment, load_experiment
from safe_inspect.dones import DoneStatus
from safe_inspect.dones.shared import CollisionDoneFunction
from safe_inspect.dynamics.cwh import transition
from safe_inspect.environments import BatchedEnvironment, TeamEnvironment, load_spec
from safe_inspect.errors import ConfigError
from safe_inspect.evaluation.policies import with_scripted
from safe_inspect.evaluation.rollouts import rollout
from safe_inspect.platforms.docking_sensors import ApproachVelocitySensor
from safe_inspect.policies import DockingAutopilot
from safe_inspect.tasks.docking.speed_limit import DOCKED, OUTSIDE, TOO_FAST, docking_outcome, entry_speed

TASK = "safe_inspect/Docking-v0"
N = 0.001027
RULE = np.array([0.2, 0.5, 2 * N, 1.0, 0.5, 1.0])
ORIGIN = np.zeros(3)


def limit(distance: float) -> float:
    return 0.2 + 2 * N * max(distance - 0.5, 0.0)


def environment(position, velocity=(0.0, 0.0, 0.0), *overrides: str) -> BatchedEnvironment:
    """Return the task with every episode started in one state."""
    tree = load_experiment(configs_root() / "docking" / "experiment.yml", overrides).resolved
    names = ("x", "y", "z", "x_dot", "y_dot", "z_dot")
    tree["agent_config"][0]["config"]["config"]["simulator_reset_parameters"] = {
        "initializer": {"functor": "PositionVelocityInitializer"},
        "config": dict(zip(names, [*position, *velocity], strict=True)),
    }
    env = BatchedEnvironment(build_experiment(tree).spec, 1, seed=0)
    env.reset()
    return env


def step(env: BatchedEnvironment, thrust=(0.0, 0.0, 0.0)):
    return env.step(np.array(thrust, dtype=np.float64)[None, None])


def test_a_step_by_hand():
    env = environment((120.0, 0.0, 0.0), (-0.1, 0.2, 0.0))
    found = step(env, (0.6, -0.3, 0.0))
    phi, gamma = transition(N, 12.0, 1.0)
    after = phi @ [120.0, 0, 0, -0.1, 0.2, 0] + gamma @ [0.6, -0.3, 0.0]
    distance, speed = np.linalg.norm(after[:3]), np.linalg.norm(after[3:])
    a = math.log(2.0) / 100.0
    expected = {
        "DockingDistanceExponentialChangeReward": 2.0 * (math.exp(-a * distance) - math.exp(-a * 120.0)),
        "DockingDeltaVReward": -0.01 * 0.9 / 12.0,
        "DockingVelocityConstraintReward": 0.0,
        "DockingSuccessReward": 0.0,
        "DockingFailureReward": 0.0,
    }
    assert {name: value[0, 0] for name, value in found.terms.items()} == pytest.approx(expected, rel=1e-10)
    observed = [*(after[:3] / 100), *(after[3:] / 0.5), speed, limit(distance)]
    np.testing.assert_allclose(found.observation[0, 0], observed, rtol=1e-6)
    assert not found.done.any()


def test_a_violation_is_priced_and_ends_the_episode_when_it_has_summed_up():
    env = environment((120.0, 0.0, 0.0), (0.0, 2.0, 0.0))
    total, steps = 0.0, 0
    while True:
        found = step(env)
        excess = np.linalg.norm(env.state.velocity[0, 0]) - limit(np.linalg.norm(env.state.position[0, 0]))
        reward = found.terms["DockingVelocityConstraintReward"][0, 0]
        assert reward == pytest.approx(-0.01 * excess - 0.01, rel=1e-12)
        total, steps = total + reward, steps + 1
        if found.done.any():
            break
        assert total > -5.0
    assert total <= -5.0
    assert found.status[0, 0] == DoneStatus.LOSE
    assert found.terminated.all()
    assert env.view().speed_limit_violations[0] == steps + 1  # the reset violates it too
    env.reset()
    assert not step(env).done.any()  # the sum is reset


@pytest.mark.parametrize(
    ("position", "velocity", "status", "terms"),
    [
        ((0.55, 0.0, 0.0), (-0.15, 0.0, 0.0), DoneStatus.WIN, {"DockingSuccessReward": 2.0 - 1.0 / 2000.0}),
        ((0.0, 0.65, 0.0), (0.0, -0.25, 0.0), DoneStatus.LOSE, {"DockingFailureReward": -1.0}),
        # Through the whole region within a step, early and late in it.
        ((0.0, 0.0, 1.0), (0.0, 0.0, -2.5), DoneStatus.LOSE, {"DockingFailureReward": -1.0}),
        ((0.0, 0.0, 1.9), (0.0, 0.0, -2.5), DoneStatus.LOSE, {"DockingFailureReward": -1.0}),
        ((10_000.5, 0.0, 0.0), (0.0, 0.0, 0.0), DoneStatus.LOSE, {"DockingFailureReward": -1.0}),
        ((0.75, 0.0, 0.0), (-0.15, 0.0, 0.0), DoneStatus.RUNNING, {}),
    ],
)
def test_ends(position, velocity, status, terms):
    found = step(environment(position, velocity))
    assert found.status[0, 0] == status
    for name in ("DockingSuccessReward", "DockingFailureReward"):
        assert found.terms[name][0, 0] == pytest.approx(terms.get(name, 0.0), rel=1e-12)


def test_the_end_of_a_step_alone_misses_who_flies_through():
    off = "agent_config.0.config.config.dones.2.config.along_step=False"
    rewards = "agent_config.0.config.config.rewards.4.config.along_step=False"
    env = environment((0.0, 0.0, 1.0), (0.0, 0.0, -2.5), off, rewards)
    found = step(env)
    assert found.status[0, 0] == DoneStatus.RUNNING
    assert found.terms["DockingFailureReward"][0, 0] == 0.0


def test_position_and_speed_are_those_relative_to_the_reference():
    """A deputy that is its own reference has docked wherever it is, however fast."""
    own_position = "reference_position_sensor_name: Sensor_Position"
    own_velocity = "reference_velocity_sensor_name: Sensor_Velocity"
    for fields, status in (
        (f"{own_position}, {own_velocity}", DoneStatus.WIN),
        (own_position, DoneStatus.RUNNING),  # too fast
        (own_velocity, DoneStatus.RUNNING),  # too far
    ):
        override = f"agent_config.0.config.config.dones.3.config={{along_step: False, {fields}}}"
        found = step(environment((120.0, 0.0, 0.0), (0.0, 0.4, 0.0), override))
        assert found.status[0, 0] == status


def test_the_time_limit_is_a_loss():
    env = environment((100.0, 0.0, 0.0))
    env.state.time[:] = 1999.0
    found = step(env)
    assert found.status[0, 0] == DoneStatus.LOSE
    assert found.terminated.all()
    assert not found.truncated.any()
    assert found.terms["DockingFailureReward"][0, 0] == -1.0


vectors = st.tuples(*[st.floats(-1.0, 1.0)] * 3)


@settings(max_examples=60, deadline=None)
@given(vectors, vectors, vectors, st.floats(0.1, 6.0))
@example((0.0, -0.5, 0.0), (0.0, 0.25, 0.0), (0.0, 1.0, 0.0), 4.0)  # reached late in the step
def test_the_region_is_found_along_the_true_path(place, direction, thrust, speed):
    position = 3.0 * np.array(place)
    velocity = speed * np.array(direction)
    if np.linalg.norm(position) <= 0.5 + 1e-3:
        return
    x = np.concatenate([position, velocity])
    a = np.zeros((6, 6))
    a[:3, 3:] = np.eye(3)
    a[3, 0], a[3, 4], a[4, 3], a[5, 2] = 3 * N * N, 2 * N, -2 * N, -N * N
    whole = np.zeros((9, 9))
    whole[:6, :6], whole[3:6, 6:] = a, np.eye(3) / 12.0
    small = expm(whole / 2000.0)
    path = [np.concatenate([x, thrust])]
    for _ in range(2000):
        path.append(small @ path[-1])
    ranges = np.array([np.linalg.norm(p[:3]) for p in path])
    end = path[-1]
    found = entry_speed(0.5, 1.0, position, velocity, end[:3], end[3:6], ORIGIN, ORIGIN)
    inside = np.flatnonzero(ranges <= 0.5)
    if len(inside):
        assert found == pytest.approx(np.linalg.norm(path[inside[0]][3:6]), abs=2e-3)
    elif ranges.min() > 0.5 + 2e-3:
        assert found == -1.0


@settings(max_examples=40, deadline=None)
@given(st.floats(0.05, 3.0), vectors)
def test_the_speed_at_the_region_decides(speed, direction):
    size = np.linalg.norm(direction)
    if size < 0.1 or abs(speed - 0.2) < 1e-9:  # at the limit itself rounding decides
        return
    unit = np.array(direction) / size
    before, after = (0.5 + 0.3 * speed) * unit, (0.5 - 0.7 * speed) * unit
    outcome = docking_outcome(RULE, before, -speed * unit, after, -speed * unit, ORIGIN, ORIGIN)
    assert outcome == (DOCKED if speed <= 0.2 else TOO_FAST)
    assert docking_outcome(RULE, before, speed * unit, before + speed * unit, speed * unit, ORIGIN, ORIGIN) == OUTSIDE


def test_initial_states_keep_the_limit():
    env = BatchedEnvironment(load_spec(TASK), 2000, seed=3)
    env.reset()
    distance = np.linalg.norm(env.state.position[:, 0], axis=1)
    share = np.linalg.norm(env.state.velocity[:, 0], axis=1) / (0.2 + 2 * N * (distance - 0.5))
    assert distance.min() >= 100.0
    assert distance.max() <= 150.0
    assert share.max() <= 0.8
    assert abs(share.mean() - 0.4) < 0.02  # uniform from 0 to 0.8


def test_the_plugins_give_what_the_compiled_step_gives():
    spec = load_spec(TASK)
    fast, slow = TeamEnvironment(spec, 16, seed=5), TeamEnvironment(spec, 16, seed=5, _fused=False)
    assert np.array_equal(fast.reset()[0], slow.reset()[0])
    generator = np.random.default_rng(0)
    for _ in range(300):
        action = generator.uniform(-1.0, 1.0, (16, 1, 3))
        one, other = fast.step((action,)), slow.step((action,))
        for name in ("observation", "reward", "status"):
            assert getattr(one.groups[0], name).tobytes() == getattr(other.groups[0], name).tobytes(), name
        if one.over.any():
            rows = np.flatnonzero(one.over)
            assert np.array_equal(fast.reset(rows)[0], slow.reset(rows)[0])


def test_the_autopilot_docks_within_the_limit():
    result = rollout(with_scripted(load_spec(TASK), DockingAutopilot()), {}, 32, num_envs=32, seed=9)
    assert (np.asarray(result.status) == DoneStatus.WIN).all()


def test_deputies_that_have_docked_are_in_nobodys_way():
    spec = load_spec("safe_inspect/MultiagentDocking-v0")
    env = TeamEnvironment(spec, 1, seed=1)
    env.reset()
    coast = np.zeros((1, 3, 3))
    env.state.position[0, :3] = [[0.6, 0.0, 0.0], [60.0, 0.0, 0.0], [0.0, 90.0, 0.0]]
    env.state.velocity[0, :3] = [[-0.15, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]]
    assert env.step((coast,)).groups[0].status[0].tolist() == [DoneStatus.WIN, 0, 0]
    env.state.position[0, 1] = env.state.position[0, 0] + [0.45, 0.0, 0.0]
    assert env.step((coast,)).groups[0].status[0].tolist() == [DoneStatus.WIN, 0, 0]
    env.state.position[0, 2] = env.state.position[0, 1] + [0.2, 0.0, 0.0]
    ends = env.step((coast,)).groups[0].status[0].tolist()
    assert ends == [DoneStatus.WIN, DoneStatus.LOSE, DoneStatus.LOSE]
    assert CollisionDoneFunction().exempt == ()


def test_a_wrong_reward_is_named_where_it_stands():
    wrong = "agent_config.0.config.config.dones.4.config.reward_functor=DockingVelocityReward"
    with pytest.raises(ConfigError, match="DockingVelocityReward"):
        load_spec(TASK, (wrong,))


def test_the_approach_velocity_points_to_the_chief_at_the_speed_limit():
    cfg = configs_root() / "docking" / "experiment-recipe.yml"
    env = BatchedEnvironment(load_spec(cfg), 8, seed=2)
    observation = env.reset()
    position = env.state.position[:, 0]
    distance = np.linalg.norm(position, axis=1)
    wanted = -position * (np.array([limit(r) for r in distance]) / distance)[:, None]
    np.testing.assert_allclose(observation[:, 0, 8:11], wanted / 0.5, rtol=1e-6)
    env.state.position[:, 0] = 0.0
    np.testing.assert_array_equal(ApproachVelocitySensor()(env.view()), 0.0)


def test_a_state_that_is_not_finite_is_nowhere():
    nowhere = np.full(3, np.nan)
    assert entry_speed(0.5, 1.0, nowhere, ORIGIN, nowhere, ORIGIN, ORIGIN, ORIGIN) == -1.0
