"""Six-DoF inspection: starts, a step by hand, the camera's cone, rewards, mistakes, and the scripted inspector."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from safe_inspect.config.data import configs_root
from safe_inspect.config.experiment import build_experiment, load_experiment
from safe_inspect.dynamics import ClohessyWiltshireAttitude
from safe_inspect.dynamics.base import advance_kernel
from safe_inspect.environments import BatchedEnvironment, TeamEnvironment, load_spec
from safe_inspect.errors import ConfigError
from safe_inspect.evaluation.policies import with_scripted
from safe_inspect.evaluation.results.files import read_trajectories, save_packed
from safe_inspect.evaluation.rollouts import rollout
from safe_inspect.policies import RandomThrust, ScriptedPolicy, SixDofInspector, ZeroThrust

TASK = "safe_inspect/WeightedSixDofInspection-v0"
TEAM = "safe_inspect/MultiagentWeightedSixDofInspection-v0"
FILE = configs_root() / "weighted-six-dof-inspection" / "experiment.yml"
N, LIMIT = 0.001027, 0.034907
AXIS = "config.config.env_config.simulator.config.initial_sensor_unit_vec"


def environment(orientation, *, position=(60.0, 0.0, 0.0), velocity=(0.0, 0.0, 0.0), w=(0.0, 0.0, 0.0), overrides=()):
    """Return the task with every episode started in one state."""
    tree = load_experiment(FILE, overrides).resolved
    radius, speed = np.linalg.norm(position), np.linalg.norm(velocity)
    drawn = {
        "radius": radius,
        "azimuth_angle": math.atan2(position[1], position[0]),
        "elevation_angle": math.asin(position[2] / radius),
        "vel_mag": speed,
        "vel_azimuth_angle": math.atan2(velocity[1], velocity[0]),
        "vel_elevation_angle": math.asin(velocity[2] / speed) if speed else 0.0,
        "orientation": {"type": "AttitudeParameter", "config": {"orientation": [float(x) for x in orientation]}},
    }
    drawn |= dict(zip(("wx", "wy", "wz"), w, strict=True))
    tree["agent_config"][0]["config"]["config"]["simulator_reset_parameters"]["config"] = drawn
    env = BatchedEnvironment(build_experiment(tree).spec, 1, seed=3)
    env.reset()
    return env


def facing_chief(env):
    """Return the cosine of the camera's axis and the way to the chief, by SciPy."""
    look = Rotation.from_quat(env.state.orientation[:, 0]).apply([1.0, 0.0, 0.0])
    way = -env.state.position[:, 0] / np.linalg.norm(env.state.position[:, 0], axis=1, keepdims=True)
    return (look * way).sum(axis=1)


@pytest.mark.parametrize("axis", [[0.0, 3.0, 4.0], [0.0, 0.6, 0.8], [0.0, 6e-9, 8e-9]])
def test_the_length_of_the_camera_axis_has_no_meaning(axis):
    """The camera looks 53 degrees off y: it sees the chief only where the body is turned for that."""
    seen = []
    for turned in (axis, [1.0, 0.0, 0.0]):
        way = np.array(turned) / np.linalg.norm(turned)
        orientation = Rotation.align_vectors([[-1.0, 0.0, 0.0]], [way])[0].as_quat()
        env = environment(orientation, overrides=[f"{AXIS}={axis}"])
        env.step(np.zeros((1, 1, 6)))
        seen.append(env.state.points["chief"].team_count[0])
    assert seen[0] > 0
    assert seen[1] == 0


def test_starts_are_those_of_the_published_task():
    env = BatchedEnvironment(load_spec(TASK), 4000, seed=5)
    env.reset()
    state = env.state
    distance = np.linalg.norm(state.position[:, 0], axis=1)
    assert 50.0 <= distance.min() < 50.5
    assert 99.5 < distance.max() <= 100.0
    assert np.linalg.norm(state.velocity[:, 0], axis=1).max() <= 0.3
    w = state.angular_velocity[:, 0]
    assert np.abs(w).max() <= 0.01
    assert np.abs(np.corrcoef(w.T) - np.eye(3)).max() < 0.06
    # Uniform over all rotations: uniform axes, and an angle whose distribution is (a - sin a) / pi.
    rotations = Rotation.from_quat(state.orientation[:, 0])
    assert np.abs(rotations.as_matrix().mean(axis=0)).max() < 0.04
    angle = np.sort(rotations.magnitude())
    assert np.abs((angle - np.sin(angle)) / np.pi - (np.arange(4000) + 0.5) / 4000).max() < 0.026
    assert (state.orientation[:, 1] == [0, 0, 0, 1]).all()  # the chief


def test_a_start_depends_on_its_slot_alone():
    names = ("position", "velocity", "orientation", "angular_velocity")
    for task in (TASK, TEAM):
        spec = load_spec(task)
        batch = TeamEnvironment(spec, 6, seed=5)
        batch.reset()
        alone = TeamEnvironment(spec, 1, seed=5, first_slot=4)
        alone.reset()
        for name in names:
            assert (batch.state[name][4] == alone.state[name][0]).all()
    deputies = batch.state.orientation[0, :3]
    assert len(np.unique(deputies[:, 0])) == 3  # the attitudes differ


def test_deputies_that_would_start_too_near_are_drawn_again():
    wide = load_experiment(configs_root() / "multiagent-weighted-six-dof-inspection" / "experiment.yml").spec
    far = load_experiment(
        configs_root() / "multiagent-weighted-six-dof-inspection" / "experiment.yml",
        ["env_config.dones.shared.0.config.safety_constraint=60 m"],
    ).spec
    states = []
    for spec in (wide, far):
        env = TeamEnvironment(spec, 200, seed=1)
        env.reset()
        states.append(env.state.position[:, :3].copy())
    distance = np.linalg.norm(states[1][:, [0, 0, 1]] - states[1][:, [1, 2, 2]], axis=-1)
    assert distance.min() >= 60.0
    same = (states[0] == states[1]).all(axis=(1, 2))
    assert 0.1 < same.mean() < 0.9  # those that were far enough stay what they were


def test_a_step_by_hand():
    q = Rotation.from_euler("zyx", [0.4, -0.7, 1.1]).as_quat()
    env = environment(q, position=(40.0, -30.0, 20.0), velocity=(0.1, 0.05, -0.2), w=(0.004, -0.006, 0.008))
    before = env.state.delta_v.copy()
    found = env.step(np.array([0.5, -0.25, 0.1, 1.0, -0.3, 0.02])[None, None])
    # The control is held along body axes, the moments as shares of 0.001 N m.
    held = np.array([0.5, -0.25, 0.1, 0.001, -0.0003, 0.00002])
    np.testing.assert_allclose(env.state.control[0, 0], held, rtol=1e-14, atol=1e-19)
    arrays = [np.array(value, dtype=float)[None, None] for value in
              ((40.0, -30.0, 20.0), (0.1, 0.05, -0.2), q, (0.004, -0.006, 0.008))]  # fmt: skip
    vehicle, spent, time, step = ClohessyWiltshireAttitude(), np.zeros((1, 1)), np.zeros(1), np.zeros(1, dtype=np.int64)
    advance = advance_kernel(vehicle, 10.0)
    advance(*vehicle(10.0), *arrays, held[None, None], np.array([12.0]), 10.0, 1, spent, time, step)
    for name, expected in zip(("position", "velocity", "orientation", "angular_velocity"), arrays, strict=True):
        np.testing.assert_allclose(env.state[name][0, 0], expected[0, 0], rtol=1e-9, atol=1e-12)
    p, v, q, w = (array[0, 0] for array in arrays)
    assert w[0] == LIMIT
    assert env.state.delta_v[0, 0] - before[0, 0] == pytest.approx(0.85 * 10.0 / 12.0)  # of the thrusts alone

    body = Rotation.from_quat(q)
    to_body = body.inv().apply
    position, velocity = to_body(-p), to_body(-v)
    points, score = env.state.points["chief"], env.state.points["chief"].own_score[0, 0]
    uninspected = env.view().reading("Sensor_UninspectedPoints")[0].copy()
    observed = [
        *(position / 100), np.linalg.norm(p) / 175, *(position / np.linalg.norm(p)),
        *(velocity / 0.5), np.linalg.norm(v) / 0.866, *(velocity / np.linalg.norm(v)),
        *(w / 0.05), *body.apply([1, 0, 0]), *body.apply([0, 1, 0]), *body.apply([0, 0, 1]),
        *to_body(uninspected), *to_body(env.state.sun_direction[0]), *to_body(env.state.priority_vector[0]),
        score, uninspected @ p / (np.linalg.norm(p) + 1e-5),
    ]  # fmt: skip
    np.testing.assert_allclose(found.observation[0, 0], observed, rtol=2e-6, atol=1e-6)

    f = facing_chief(env)[0]
    assert {name: value[0, 0] for name, value in found.terms.items()} == pytest.approx(
        {
            "ObservedPointsReward": points.team_score[0],
            "SafeInspectionSuccessReward": 0.0,
            "InspectionCrashReward": 0.0,
            "MaxDistanceDoneReward": 0.0,
            "LiveTimestepReward": 0.001,
            "FacingChiefReward": 0.0005 * math.exp(-((f - 1.0) ** 2) / 0.15) if f >= 0.0 else 0.0,
            "InspectionDeltaVReward": -0.005 * 0.85 * 10.0 / 12.0,
        },
        rel=1e-9,
    )


@pytest.mark.parametrize(("angle", "expected"), [(0.0, 1.0), (0.5, None), (1.5, None), (1.7, 0.0), (math.pi, 0.0)])
def test_facing_the_chief_is_paid_and_looking_away_is_not(angle, expected):
    away = Rotation.from_euler("z", math.pi + angle).as_quat()  # at +x, the chief lies towards -x
    env = environment(away, w=(0.0, 0.0, N))
    reward = env.step(np.zeros((1, 1, 6))).terms["FacingChiefReward"][0, 0]
    f = facing_chief(env)[0]
    assert reward == pytest.approx(0.0005 * math.exp(-((f - 1.0) ** 2) / 0.15) if f > 0.0 else 0.0, rel=1e-12)
    if expected is not None:
        assert reward == pytest.approx(0.0005 * expected, abs=1e-6)


def test_points_are_seen_in_the_camera_cone_alone():
    env = BatchedEnvironment(load_spec(TASK), 300, seed=2)
    env.reset()
    state = env.state
    model = env.simulation.world.points["chief"]
    points, half = model.points, math.radians(30.0)
    look = Rotation.from_quat(state.orientation[:, 0]).apply([1.0, 0.0, 0.0])
    way = points[None] - state.position[:, :1]
    inside = np.einsum("npk,nk->np", way, look) / np.linalg.norm(way, axis=2) >= math.cos(half)
    above = np.einsum("nk,pk->np", state.position[:, 0], points) >= 100.0
    lit = np.einsum("nk,pk->np", state.sun_direction, points) > 0.0
    expected = inside & above & lit
    assert ((state.points["chief"].inspector >= 0) == expected).all()
    partly = expected.any(axis=1) & (above & lit & ~inside).any(axis=1)
    assert partly.sum() > 3  # the edge of the cone runs across the chief
    assert (state.points["chief"].team_count == expected.sum(axis=1)).all()


def test_rewards_of_time_and_of_leaving():
    env = environment(
        [0, 0, 0, 1], position=(99.0, 0.0, 0.0), velocity=(60.0, 0.0, 0.0), overrides=["max_time_rewarded=20 s"]
    )
    found = [env.step(np.zeros((1, 1, 6))) for _ in range(2)]
    assert [step.terms["MaxDistanceDoneReward"][0, 0] for step in found] == [0.0, -1.0]
    assert found[1].status[0, 0] == 2
    calm = environment([0, 0, 0, 1], overrides=["max_time_rewarded=20 s"])
    rewards = [calm.step(np.zeros((1, 1, 6))).terms["LiveTimestepReward"][0, 0] for _ in range(3)]
    assert rewards == [0.001, 0.001, 0.0]


def test_the_fuel_price_of_safe_autonomy_sims_adds_moments():
    env = environment(
        [0, 0, 0, 1], overrides=["InspectionDeltaVReward.config={mode: constant, scale: -0.005, moments: True}"]
    )
    found = env.step(np.array([0.5, 0.0, -0.5, 1.0, 1.0, 0.0])[None, None])
    assert found.terms["InspectionDeltaVReward"][0, 0] == pytest.approx(-0.005 * (1.0 + 0.002) * 10.0 / 12.0)


def test_the_compiled_step_and_the_plugins_give_the_same_bits():
    for task in (TASK, TEAM):
        flights = []
        for fused in (True, False):
            env = TeamEnvironment(load_spec(task), 5, seed=4, _fused=fused)
            generator = np.random.default_rng(0)
            noted = [env.reset()[0].tobytes()]
            for _ in range(25):
                actions = [generator.uniform(-1, 1, (5, group.size, 6)) for group in env.acting]
                found = env.step(actions)
                for group in found.groups:
                    noted += [group.observation.tobytes(), group.reward.tobytes(), group.status.tobytes()]
                noted += [env.state[name].tobytes() for name in ("position", "orientation", "control")]
                if found.over.any():
                    env.reset(np.flatnonzero(found.over))
            flights.append(noted)
        assert flights[0] == flights[1]


def test_the_inspector_turns_the_camera_to_the_chief_and_keeps_it_there():
    spec = with_scripted(load_spec(TASK), SixDofInspector(translation=ZeroThrust()))
    env = TeamEnvironment(spec, 40, seed=1)
    env.reset()
    worst = []
    for _ in range(40):
        env.step([])
        worst.append(facing_chief(env).min())
    assert np.degrees(np.arccos(worst[0])) > 120.0
    assert np.degrees(np.arccos(worst[25])) < 2.0
    assert np.degrees(np.arccos(worst[39])) < 0.5
    assert (env.state.delta_v == 0.0).all()
    assert (np.abs(env.state.angular_velocity[:, 0]) <= LIMIT).all()


def test_thrust_along_hills_axes_is_turned_into_body_axes():
    q = Rotation.from_euler("zyx", [2.4, -0.7, 1.1])

    class PushAlongX(ScriptedPolicy):
        """Push along x."""

        def __call__(self, view, limits):
            return np.tile([0.3, 0.0, 0.0], (view.num_rows, 1))

    tree = environment(q.as_quat(), w=(0.0, 0.0, 0.0))
    env = TeamEnvironment(with_scripted(tree.spec, PushAlongX()), 1)
    env.reset()
    env.step([])
    np.testing.assert_allclose(env.state.control[0, 0, :3], q.inv().apply([0.3, 0.0, 0.0]), atol=1e-15)
    assert (env.state.control[0, 0, 3:] == 0.0).all()


def test_a_recorded_episode_keeps_attitudes_moments_and_the_camera(tmp_path):
    spec = with_scripted(load_spec(TASK, ["horizon=12"]), SixDofInspector(translation=RandomThrust()))
    flown = rollout(spec, {}, episodes=2, seed=0, record=2).trajectories
    save_packed(tmp_path / "trajectories.npz", flown)
    for one, again in zip(flown, read_trajectories(tmp_path), strict=True):
        assert again.control.shape == (12, 1, 6)
        for name in ("control", "position", "orientation", "angular_velocity"):
            assert (getattr(one, name) == getattr(again, name)).all()
        assert again.camera == ((1.0, 0.0, 0.0), pytest.approx(math.radians(30.0)))
        attitude = Rotation.from_quat(one.orientation[:, 0])
        np.testing.assert_allclose(again.boresight[:, 0], attitude.apply([1.0, 0.0, 0.0]), atol=1e-12)
        np.testing.assert_allclose(again.thrust[:, 0], attitude[:-1].apply(one.control[:, 0, :3]), atol=1e-12)


@pytest.mark.parametrize(
    ("file", "overrides", "words"),
    [
        (FILE, ["platform_config.blue0.config.platform=cwh"], "commands a moment, but the platforms have no attitude"),
        (FILE, ["platform_config.blue0.config.platform=cwh"], "`sensor_fov` needs platforms with attitude"),
        (FILE, ["done_status=win"], "ends episodes with `lose`, not with `win`"),
        (FILE, ["FacingChiefReward.config={observation: {fields: [Obs_Sensor_Position]}}"], "remove the key"),
        ("docking", ["platform_config.blue0.config.platform=six-dof"], "CWHSimulator simulates point masses"),
        (
            "multiagent-translational-inspection",
            ["platform_config.blue#.config.platform=six-dof", "rta.config.enabled=True"],
            "these deputies have an attitude; disable the filter",
        ),
        (
            "translational-inspection",
            ["platform_config.blue0.config.platform=six-dof", "glues.0.config.enabled=True"],
            "these deputies have an attitude; disable the filter",
        ),
    ],
)
def test_what_does_not_fit_is_said(file, overrides, words):
    path = file if file == FILE else configs_root() / file / "experiment.yml"
    with pytest.raises(ConfigError, match=words):
        load_experiment(path, overrides)
