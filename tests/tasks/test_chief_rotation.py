"""A chief that rotates: its points, what sees them, the cluster sensor and the priority vector turn with it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from safe_inspect.config.data import configs_root
from safe_inspect.config.experiment import load_experiment
from safe_inspect.environments import TeamEnvironment
from safe_inspect.errors import ConfigError, SafeInspectError
from safe_inspect.evaluation.optimiser import coverage_task
from safe_inspect.evaluation.policies import with_scripted
from safe_inspect.policies import NaturalMotionInspector
from safe_inspect.simulators.simulator import ComposedSimulator
from safe_inspect.tasks.inspection.simulator import InspectionSimulator

SIMULATOR = "config.config.env_config.simulator.config"
SPIN = np.array([2.0e-3, -1.0e-3, 3.0e-3])
TASKS = ("weighted-translational-inspection", "multiagent-weighted-six-dof-inspection")


def environment(task, *overrides, num_envs=40, spin=SPIN, **kwargs):
    path = configs_root() / task / "experiment.yml"
    given = f"{SIMULATOR}.chief_angular_velocity={[float(x) for x in spin]}"
    return TeamEnvironment(load_experiment(path, [given, *overrides]).spec, num_envs, seed=3, **kwargs)


def fly(env, steps, size):
    """Fly all environments on noise, without a reset; call after every step."""
    generator, action = np.random.default_rng(1), []
    for _ in range(steps):
        action = [
            generator.integers(0, 3, (env.num_envs, group.size, 3)).astype(float)
            if size == 3
            else generator.uniform(-1, 1, (env.num_envs, group.size, 6)) * np.repeat([0.02, 0.1], 3)
            for group in env.acting
        ]
        env.step(action)
        yield env.state


def attitude(state):
    return Rotation.from_rotvec(state.time[:, None] * SPIN)


@pytest.mark.parametrize("task", TASKS)
def test_points_are_inspected_as_those_of_a_turned_sphere_are(task):
    env = environment(task)
    env.reset()
    model, camera = env.simulation.world.points["chief"], env.simulation.world.camera
    deputies = env.simulation.world.num_deputies
    owner = np.where(env.state.points["chief"].inspector >= 0, env.state.points["chief"].inspector, -1)
    for state in fly(env, 30, 3 if camera is None else 6):
        turned = np.stack([attitude(state)[n].apply(model.points) for n in range(env.num_envs)])  # Hill frame
        bright = np.einsum("npk,nk->np", turned, state.sun_direction) > 0.0
        for d in range(deputies):
            viewer = state.position[:, d]
            seen = np.einsum("npk,nk->np", turned, viewer) >= 100.0
            if camera is not None:
                look = Rotation.from_quat(state.orientation[:, d]).apply(camera.axis)
                way = turned - viewer[:, None]
                seen &= np.einsum("npk,nk->np", way, look) >= np.cos(camera.half_angle) * np.linalg.norm(way, axis=2)
            owner = np.where((owner < 0) & seen & bright, d, owner)
        assert (state.points["chief"].inspector == owner).mean() > 0.9999  # but for rounding at an edge
        np.testing.assert_allclose(state.chief_orientation, attitude(state).as_quat(canonical=True), atol=1e-12)
    assert (owner >= 0).mean() > 0.05


def test_the_sensors_tell_directions_in_hills_frame():
    turning, resting = (environment(TASKS[0], spin=spin) for spin in (SPIN, np.zeros(3)))
    turning.reset()
    resting.reset()
    np.testing.assert_array_equal(*(env.state.priority_vector for env in (turning, resting)))
    model = turning.simulation.world.points["chief"]
    state = list(fly(turning, 25, 3))[-1]
    view = turning.simulation.views[0]
    expected = attitude(state).apply(state.priority_vector)
    np.testing.assert_allclose(view.reading("Sensor_PriorityVector"), expected, atol=1e-12)
    weights = state.points["chief"].weights
    heaviest = attitude(state)[0].apply(model.points[weights[0].argmax()]) / model.radius
    assert heaviest @ expected[0] > 0.95  # points towards the vector, wherever the chief has turned, weigh most
    # The cluster that is nearest lies among lit points: its direction is within 90 degrees of the sun's.
    direction = view.reading("Sensor_UninspectedPoints")
    assert ((direction * state.sun_direction).sum(axis=1)[np.abs(direction).any(axis=1)] > 0.0).all()
    points = view.points("chief")
    turned = np.stack([attitude(state)[n].apply(model.points) for n in range(turning.num_envs)])
    lit = np.einsum("npk,nk->np", turned, state.sun_direction) > 0.0
    assert (points.lit == lit).mean() > 0.9999


def test_what_plans_for_a_chief_at_rest_refuses():
    file = configs_root() / "translational-inspection" / "experiment.yml"
    spec = load_experiment(file, [f"{SIMULATOR}.chief_angular_velocity=[0, 0, 0.001]"]).spec
    with pytest.raises(SafeInspectError, match="`chief_angular_velocity`"):
        coverage_task(spec)
    env = TeamEnvironment(with_scripted(spec, NaturalMotionInspector()), 1)
    env.reset()
    with pytest.raises(SafeInspectError, match="'chief' rotates"):
        env.step([])


@pytest.mark.parametrize("task", TASKS)
def test_a_row_alone_and_the_plugins_give_the_same_bits(task):
    size = 3 if task == TASKS[0] else 6
    names = ("chief_orientation", "axes/chief/position", "axes/chief/sun_direction")
    batch, plain = environment(task, num_envs=5), environment(task, num_envs=5, _fused=False)
    alone = environment(task, num_envs=1, first_slot=4)
    observed = [env.reset()[0] for env in (batch, plain, alone)]
    assert observed[0].tobytes() == observed[1].tobytes()
    generator = np.random.default_rng(0)
    for _ in range(15):
        action = generator.integers(0, 3, (5, 1, 3)).astype(float) if size == 3 else generator.uniform(-1, 1, (5, 3, 6))
        found = [env.step([part]).groups[0] for env, part in ((batch, action), (plain, action), (alone, action[4:]))]
        assert found[0].observation.tobytes() == found[1].observation.tobytes()
        assert found[0].observation[4].tobytes() == found[2].observation[0].tobytes()
        assert found[0].reward.tobytes() == found[1].reward.tobytes()
        for name in names:
            assert batch.state[name][4].tobytes() == alone.state[name][0].tobytes()


def test_a_chief_that_rests_has_no_rotation():
    names = [component.registered_name for component in InspectionSimulator().compose()[1]]
    assert "ChiefRotation" not in names
    turning = InspectionSimulator(chief_angular_velocity=(0.0, 0.0, -0.001))
    assert [component.registered_name for component in turning.compose()[1]][1] == "ChiefRotation"
    sun, rotation, points, _ = turning.compose()[1]
    for order in ((sun, points, rotation), (rotation, sun, points)):
        wrong = replace(environment(TASKS[0]).spec, simulator=ComposedSimulator(components=order))
        with pytest.raises(ValueError, match="after Sun and before InspectionPoints"):
            TeamEnvironment(wrong, 1)
    with pytest.raises(ConfigError, match="chief_angular_velocity"):
        environment(TASKS[0], f"{SIMULATOR}.chief_angular_velocity=[0, 0, 1 m]")
