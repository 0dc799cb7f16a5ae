"""The Kalman filter of deputies against a filter in plain NumPy, and its errors against their covariance."""

from __future__ import annotations

import numpy as np
import pytest

from safe_inspect.config.data import configs_root
from safe_inspect.config.experiment import load_experiment
from safe_inspect.dynamics.cwh import transition
from safe_inspect.environments import TeamEnvironment
from safe_inspect.errors import ConfigError
from safe_inspect.tasks.kalman_filter import KalmanFilter

SIMULATOR = "config.config.env_config.simulator.config"
N, MASS, STEP = 0.001027, 12.0, 10.0
FIELDS = {"measurement": 0.3, "acceleration": 1e-4, "initial_position": 2.0, "initial_velocity": 0.05}


def environment(num_envs, *overrides, first_slot=0, task="translational-inspection", **fields):
    given = f"{SIMULATOR}.disturbance={{functor: KalmanFilter, config: {fields}}}"
    spec = load_experiment(configs_root() / task / "experiment.yml", [given, *overrides]).spec
    env = TeamEnvironment(spec, num_envs, seed=5, first_slot=first_slot)
    env.reset()
    return env


def errors(env):
    """Return estimate minus truth, shape (N, D, 6)."""
    state, d = env.simulation.state, env.simulation.world.num_deputies
    return np.concatenate(
        (
            state["estimated_position"] - state["position"][:, :d],
            state["estimated_velocity"] - state["velocity"][:, :d],
        ),
        axis=2,
    )


def covariances(steps):
    """Return the covariance of the error at each step by Joseph's form, from the information of each measurement."""
    phi, _ = transition(N, MASS, STEP)
    q = FIELDS["acceleration"] ** 2
    noise = np.zeros((6, 6))
    for k in range(3):  # white acceleration, integrated over a step
        noise[k, k], noise[k, 3 + k] = q * STEP**3 / 3.0, q * STEP**2 / 2.0
        noise[3 + k, k], noise[3 + k, 3 + k] = q * STEP**2 / 2.0, q * STEP
    h = np.eye(3, 6)
    found = [np.diag([FIELDS["initial_position"] ** 2] * 3 + [FIELDS["initial_velocity"] ** 2] * 3)]
    for _ in range(steps):
        predicted = phi @ found[-1] @ phi.T + noise
        found.append(np.linalg.inv(np.linalg.inv(predicted) + h.T @ h / FIELDS["measurement"] ** 2))
    return np.array(found), noise


def test_the_gains_are_those_of_the_information_form_and_converge():
    phi, _ = transition(N, MASS, STEP)
    gains, found = KalmanFilter(**FIELDS).gains(phi, STEP)
    expected, _ = covariances(len(gains))
    np.testing.assert_allclose(found, expected, rtol=1e-7, atol=1e-14)
    np.testing.assert_allclose(gains, expected[1:, :, :3] / FIELDS["measurement"] ** 2, rtol=1e-6, atol=1e-12)
    assert 10 < len(gains) < 500
    assert np.all(np.diff(np.trace(found[:, :3, :3], axis1=1, axis2=2))[:5] < 0.0)


@pytest.mark.parametrize("thrust", [0.0, 0.4])
def test_errors_have_the_covariance_that_the_filter_computes(thrust):
    """With an acceleration of the assumed noise, NEES is 6 on average, and every block of the covariance agrees."""
    rows, steps = 4096, 60
    env = environment(rows, **FIELDS)
    expected, noise = covariances(steps)
    generator = np.random.default_rng(1)
    root = np.linalg.cholesky(noise)
    checked = {0: errors(env)[:, 0]}
    for step in range(1, steps + 1):
        control = np.broadcast_to(thrust * np.array([1.0, -0.5, 0.25]), (rows, 1, 3)).copy()
        push = generator.normal(size=(rows, 6)) @ root.T
        simulation = env.simulation
        component = next(iter(simulation.components.values()))
        measure, component.step = component.step, lambda state, running: None
        simulation.step(control)
        component.step = measure
        state = simulation.state
        state.position[:, 0] += push[:, :3]
        state.velocity[:, 0] += push[:, 3:]
        component.step(state, simulation.running)
        checked[step] = errors(env)[:, 0]
    for step in (0, 1, 2, 5, 20, 60):
        error = checked[step]
        assert np.abs(error.mean(axis=0) / np.sqrt(np.diag(expected[step]))).max() < 5.0 / np.sqrt(rows)
        nees = np.einsum("ri,ij,rj->r", error, np.linalg.inv(expected[step]), error)
        assert nees.mean() == pytest.approx(6.0, abs=5.0 * np.sqrt(12.0 / rows))
        scale = np.sqrt(np.diag(expected[step]))
        assert np.abs(np.cov(error.T) / np.outer(scale, scale) - expected[step] / np.outer(scale, scale)).max() < 0.09


def test_deputies_and_rows_are_independent_and_a_row_is_as_alone():
    team = environment(256, "rta.config.enabled=False", task="multiagent-translational-inspection", **FIELDS)
    for _ in range(3):
        team.simulation.step(np.zeros((256, 3, 3)))
    error = errors(team).reshape(256, 18)
    assert np.abs(np.corrcoef(error[:, [0, 6, 12, 1, 7, 13]].T) - np.eye(6)).max() < 0.3
    batch, alone = environment(8, **FIELDS), environment(1, first_slot=5, **FIELDS)
    for _ in range(4):
        batch.simulation.step(np.full((8, 1, 3), 0.3))
        alone.simulation.step(np.full((1, 1, 3), 0.3))
    np.testing.assert_array_equal(errors(batch)[5], errors(alone)[0])


def test_sensors_read_the_estimates_and_filters_are_refused():
    env = environment(4, **FIELDS)
    view = env.view()
    read = view.reading(next(name for name in env.groups[0].agent.sensors if "Position" in name))
    np.testing.assert_array_equal(read, view.estimated_position)
    with pytest.raises(ConfigError, match=r"KalmanFilter may change the motion .* no `disturbance_bounds`"):
        environment(1, "RTAGlueCWHInspection1v1.config.enabled=True")


@pytest.mark.parametrize("order", [1, -1])
def test_estimates_of_two_components_are_refused(order):
    listed = ["{functor: BoundedDisturbance, config: {position_error: 1}}", "{functor: KalmanFilter}"][::order]
    with pytest.raises(ConfigError, match=r"disturbance: \w+ and \w+ estimate the states; remove one of them"):
        environment(1, f"{SIMULATOR}.disturbance=[{', '.join(listed)}]")


def test_a_vehicle_that_turns_is_refused():
    with pytest.raises(ValueError, match="KalmanFilter is for point masses"):
        environment(1, task="weighted-six-dof-inspection")
