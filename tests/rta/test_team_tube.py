"""The team's filter under a bounded disturbance: nothing is violated, even near deputies whose agents have ended."""

from __future__ import annotations

import numpy as np

from safe_inspect.config.data import configs_root
from safe_inspect.config.experiment import load_experiment
from safe_inspect.dynamics.base import DisturbanceBounds
from safe_inspect.environments import TeamEnvironment
from safe_inspect.rta.team.safety_filter import TeamFilter, TeamState

BOUNDS = {
    "velocity": 1e-4, "position_error": 0.01, "velocity_error": 1e-4, "thrust_gain": 0.01, "thrust_direction": 0.01
}  # fmt: skip
DEPUTIES = 3


def environment(rows):
    disturbance = {"functor": "BoundedDisturbance", "config": {**BOUNDS, "distribution": "extreme"}}
    given = [
        "rta.config.enabled=True", f"config.config.env_config.rta.config.disturbance={BOUNDS}",
        f"config.config.env_config.simulator.config.disturbance={disturbance}",
    ]  # fmt: skip
    path = configs_root() / "multiagent-translational-inspection" / "experiment-seed.yml"
    env = TeamEnvironment(load_experiment(path, given).spec, rows, seed=1)
    env.reset()
    return env


def states(rows, seed=0, fastest=0.25):
    generator = np.random.default_rng(seed)
    directions = generator.normal(size=(2, rows, DEPUTIES, 3))
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    return TeamState(
        directions[0] * generator.uniform(50.0, 100.0, (rows, DEPUTIES, 1)),
        directions[1] * generator.uniform(0.0, fastest, (rows, DEPUTIES, 1)), generator.uniform(0.0, 2.0 * np.pi, rows),
    )  # fmt: skip


def towards(e, step):
    """Return the largest thrusts of each deputy to its next, of all to their middle, to the chief, and at random."""
    p = e.state.position[:, :DEPUTIES]
    ways = np.roll(p, 1, axis=1) - p, p.mean(axis=1, keepdims=True) - p, -p
    units = [way / np.maximum(np.linalg.norm(way, axis=-1, keepdims=True), 1e-9) for way in ways]
    units.append(np.random.default_rng(step).choice([-1.0, 1.0], p.shape))
    return np.clip(1.8 * np.stack(units)[np.arange(e.num_envs) % 4, np.arange(e.num_envs)], -1.0, 1.0)


def test_no_deputy_breaks_a_constraint_and_ended_ones_track_their_plans():
    env = environment(24)
    keeps = env.spec.team_safety
    assert keeps is not None
    for step in range(16):
        if step == 8:
            env.state.finished[::3, 1] = 1
        found = env.step([towards(env, step)])
        assert not found.filtered.infeasible.any()
        look = {name: env.state[name][:, :DEPUTIES] for name in ("position", "velocity")}
        phi = keeps.safety({**look, "sun_angle": env.state.sun_angle})
        assert all((value >= 0.0).all() for value in phi.values())
        tracks = env.state.memory["whole team", "team safety filter", "tracks"].reshape(-1, DEPUTIES, 10)
        assert (tracks[..., 9] == 1.0).all()
        if step > 9:  # the plan of an ended deputy is a closed motion, and the deputy stays near it
            plan = tracks[::3, 1]
            np.testing.assert_allclose(plan[:, 4], -2.0 * 0.001027 * plan[:, 0], atol=1e-9)
            assert np.linalg.norm(env.state.position[::3, 1] - plan[:, :3], axis=1).max() < 0.5
            assert np.abs(found.filtered.control[::3, 1]).max() < 0.1


def test_without_a_disturbance_it_is_the_filter_of_an_exact_model():
    state = states(24)
    exact, still = TeamFilter(), TeamFilter(disturbance=DisturbanceBounds())
    kept = exact.recoverable(state)
    np.testing.assert_array_equal(still.recoverable(state), kept)
    desired = np.random.default_rng(1).uniform(-1.0, 1.0, (24, DEPUTIES, 3))
    found, wanted = still(state, desired), exact(state, desired)
    np.testing.assert_array_equal(found.control, wanted.control)
    np.testing.assert_array_equal(found.plan, wanted.plan)
    assert wanted.tracks is None
    assert (found.tracks[kept][..., 9] == 1.0).all()


def test_nearly_all_starts_are_kept():
    state = states(150, seed=3)
    exact, tube = (
        TeamFilter().recoverable(state),
        TeamFilter(disturbance=DisturbanceBounds(**BOUNDS)).recoverable(state),
    )
    assert not (tube & ~exact).any()
    assert tube.sum() > 0.9 * exact.sum()


def test_without_a_joint_plan_all_plans_are_forgotten_but_those_of_ended_deputies():
    """One deputy has no plan, and no joint plan is found; the next step must search again and not track an old one."""
    run = TeamFilter(disturbance=DisturbanceBounds(**BOUNDS))
    position = np.array([[[60.0, 0.0, 0.0], [60.0, 4.0, 0.0], [-80.0, 30.0, 0.0]]])
    velocity = np.array([[[0.0, 0.4, 0.0], [0.0, -0.4, 0.0], [0.0, -2.0 * 0.001027 * -80.0, 0.0]]])
    for ended in (False, True):
        finished = np.array([[False, False, ended]])
        tracks = np.zeros((1, DEPUTIES, 10))
        tracks[0, :, :6] = np.concatenate((position, velocity), axis=2)
        tracks[0, 1:, 9] = 1.0
        state = TeamState(position, velocity, np.array([2.0]), finished)
        found = run(state, np.zeros((1, DEPUTIES, 3)), np.zeros((1, DEPUTIES), np.int8), tracks)
        assert found.infeasible.any()
        assert found.tracks[0, :, 9].tolist() == [0.0, 0.0, 1.0 if ended else 0.0]


def test_the_desired_thrust_of_an_ended_deputy_has_no_effect_whatever_it_is():
    state = states(4)
    finished = np.zeros((4, DEPUTIES), np.bool_)
    finished[:, 1] = True
    state = TeamState(state.position, state.velocity, state.sun_angle, finished)
    desired = np.random.default_rng(2).uniform(-1.0, 1.0, (4, DEPUTIES, 3))
    found = []
    for value in (0.0, 1.0, np.nan):
        desired[:, 1] = value
        found.append(TeamFilter()(state, desired).control)
    np.testing.assert_array_equal(found[0], found[1])
    np.testing.assert_array_equal(found[0], found[2])
