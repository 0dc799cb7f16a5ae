"""The errors of sensors: each alone against its definition, in a batch and alone, in observations, and refusals."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest
import yaml

from safe_inspect.config.data import configs_root
from safe_inspect.config.experiment import load_experiment
from safe_inspect.environments.team import TeamEnvironment
from safe_inspect.errors import ConfigError

_EXPERIMENT = str(configs_root() / "docking" / "experiment.yml")
_PART = "agent_config.0.config.config.parts.3.config"


def _spec(errors: dict[str, Any], *overrides: str) -> Any:
    value = yaml.safe_dump({"errors": errors}, default_flow_style=True, width=10_000).strip()
    return load_experiment(_EXPERIMENT, [f"{_PART}={value}", *overrides]).spec


def _flown(errors: dict[str, Any], num_envs: int, steps: int, first: int = 0) -> tuple[np.ndarray, np.ndarray, Any]:
    """Return the true positions and the readings after the reset and each step, shape (T + 1, N, 3), and the batch."""
    env = TeamEnvironment(_spec(errors, "horizon=10000"), num_envs, seed=3, first_slot=first)
    env.reset()
    truth, readings = [], []
    for _ in range(steps + 1):
        view = env.view()
        truth.append(view.position.copy())
        readings.append(view.reading("Sensor_Position").copy())
        env.step([np.zeros((num_envs, 1, 3))])
    return np.array(truth), np.array(readings), env


def test_noise_is_white_and_has_its_standard_deviation() -> None:
    truth, readings, _ = _flown({"noise": "50 cm"}, 400, 24)
    error = (readings - truth) / 0.5
    assert error.mean() == pytest.approx(0.0, abs=4 / np.sqrt(error.size))
    assert error.std() == pytest.approx(1.0, abs=4 / np.sqrt(2 * error.size))
    assert (error**4).mean() == pytest.approx(3.0, abs=4 * np.sqrt(96 / error.size))
    for one, other in ((error[1:], error[:-1]), (error[:, 1:], error[:, :-1]), (error[..., 1:], error[..., :-1])):
        assert (one * other).mean() == pytest.approx(0.0, abs=4 / np.sqrt(one.size))


def test_a_bias_lasts_for_the_episode_and_walks() -> None:
    truth, readings, _ = _flown({"bias": 2.0}, 500, 5)
    error = readings - truth
    assert np.ptp(error, axis=0).max() < 1e-9
    assert error[0].std() == pytest.approx(2.0, rel=4 / np.sqrt(2 * error[0].size))
    truth, readings, _ = _flown({"walk": 0.3}, 500, 16)
    error = readings - truth
    assert np.abs(error[0]).max() < 1e-9
    assert error[16].std() == pytest.approx(0.3 * 4.0, rel=4 / np.sqrt(2 * error[16].size))
    assert np.diff(error, axis=0).std() == pytest.approx(0.3, rel=0.02)


def test_a_resolution_rounds() -> None:
    truth, readings, _ = _flown({"resolution": "25 cm"}, 50, 5)
    assert (readings == 0.25 * np.rint(truth / 0.25)).all()


@pytest.mark.parametrize("delay", [1, 3])
def test_a_delay_shows_the_first_value_and_then_old_ones(delay: int) -> None:
    truth, readings, _ = _flown({"delay": delay}, 20, 12)
    assert (readings[:delay] == truth[0]).all()
    assert (readings[delay:] == truth[:-delay]).all()


def test_a_lost_reading_repeats_the_last_one() -> None:
    truth, readings, _ = _flown({"dropout": 0.3}, 300, 20)
    fresh = (readings == truth).all(axis=-1)
    assert fresh[0].all()
    repeated = (readings[1:] == readings[:-1]).all(axis=-1)
    assert (fresh[1:] ^ repeated).all()
    share = repeated.mean()
    assert share == pytest.approx(0.3, abs=4 * np.sqrt(0.21 / repeated.size))


_ALL = {"noise": 0.5, "bias": 1.0, "walk": 0.1, "resolution": 0.01, "delay": 2, "dropout": 0.2}


def test_a_row_of_a_batch_is_the_environment_alone() -> None:
    _, readings, _ = _flown(_ALL, 5, 10)
    _, alone, _ = _flown(_ALL, 1, 10, first=3)
    assert (readings[:, 3] == alone[:, 0]).all()
    assert len(np.unique(readings[:, :, 0])) > 40


def test_observations_have_the_errors_and_rewards_have_not() -> None:
    runs = []
    for errors in (_ALL, {}):
        env = TeamEnvironment(_spec(errors), 30, seed=3)
        env.reset()
        actions = np.random.default_rng(7)
        rewards = []
        for _ in range(12):
            step = env.step([actions.uniform(-1.0, 1.0, (30, 1, 3))])
            rewards.append(step.groups[0].reward.copy())
        (observation,) = (step.groups[0].observation,)
        runs.append((env.view().position, env.view().reading("Sensor_Position"), observation, rewards))
    (truth, reading, seen, paid), (same, exact, clean, as_much) = runs
    assert (truth == same).all()
    assert (exact == same).all()
    assert np.abs(reading - truth).mean() > 0.5
    differs = np.abs(seen.reshape(30, -1) - clean.reshape(30, -1)).max(axis=0) > 0.0
    assert differs[:3].all()
    assert not differs[3:].any()
    assert np.array_equal(paid, as_much)


def test_a_bounded_sensor_stays_within_its_bounds() -> None:
    spec = load_experiment(
        str(configs_root() / "translational-inspection" / "experiment-seed.yml"),
        ["agent_config.0.config.config.parts.Sensor_SunAngle.config={errors: {noise: 1 deg, bias: 10.0}}"],
    ).spec
    env = TeamEnvironment(spec, 50, seed=1)
    env.reset()
    reading = env.view().reading("Sensor_SunAngle")
    assert (reading.min(), reading.max()) == spec.agents[0].sensors["Sensor_SunAngle"].limits


def test_a_copy_of_the_specification_gives_the_same_readings() -> None:
    spec = _spec(_ALL)
    found = []
    for one in (spec, pickle.loads(pickle.dumps(spec))):
        env = TeamEnvironment(one, 3, seed=8)
        env.reset()
        env.step([np.ones((3, 1, 3))])
        found.append(env.view().reading("Sensor_Position").copy())
    assert (found[0] == found[1]).all()


@pytest.mark.parametrize(
    ("errors", "text"),
    [
        ({"noise": -1.0}, "noise"),
        (
            {"noise": "5 s", "bias": "1 kg"},
            "noise: 's' is not a unit of length; use 'm', 'km', 'cm', 'mm' or 'ft'; bias: 'kg'",
        ),
        ({"dropout": 1.0}, "dropout"),
        ({"delay": 1.5}, "delay"),
        ({"nose": 1.0}, "nose"),
        ({"bias": float("nan")}, "bias"),
    ],
)
def test_errors_that_make_no_sense_are_refused(errors: dict[str, Any], text: str) -> None:
    with pytest.raises(ConfigError, match=text):
        _spec(errors)


def test_a_reward_that_names_a_sensor_with_errors_is_refused() -> None:
    with pytest.raises(ConfigError, match="'Sensor_Position' has `errors`, but a done needs exact"):
        _spec(
            _ALL,
            "agent_config.0.config.config.dones.MaxDistanceDoneFunction.config="
            "{reference_position_sensor_name: Sensor_Position}",
        )


def test_the_errors_of_agents_and_sensors_are_independent_and_a_bias_walks_by_time() -> None:
    """Three deputies that are computed as one group, with steps of 10 s."""
    given = {"Sensor_Position": "{walk: 0.3, noise: 0.2}", "Sensor_Velocity": "{walk: 0.3, noise: 0.2}"}
    overrides = [f"parts.{sensor}.config.errors={errors}" for sensor, errors in given.items()]
    overrides.append("env_config.rta.config.enabled=False")
    spec = load_experiment(
        str(configs_root() / "multiagent-translational-inspection" / "experiment.yml"), overrides
    ).spec
    env, errors = TeamEnvironment(spec, 400, seed=3), []
    env.reset()
    (group,) = env.groups
    for _ in range(9):
        view = env.view()
        exact = view.position, view.velocity
        errors.append([view.reading(name) - truth for name, truth in zip(given, exact, strict=True)])
        env.step([np.zeros((400, 3, group.action_layout.size))])
    error = np.array(errors).reshape(9, 2, 400, 3, 3)  # steps, sensors, environments, agents, elements
    moves = np.diff(error, axis=0)
    variance = 0.3**2 * 10.0 + 2.0 * 0.2**2
    assert moves.var() == pytest.approx(variance, rel=0.03)
    assert np.var(error[8] - error[0]) == pytest.approx(8 * 0.9 + 0.08, rel=0.06)  # noise and walk are independent
    own = moves / np.sqrt(variance)
    for one, other in ((own[:, 0], own[:, 1]), (own[..., 0, :], own[..., 1, :]), (own[..., 1, :], own[..., 2, :])):
        assert (one * other).mean() == pytest.approx(0.0, abs=4 / np.sqrt(one.size))
