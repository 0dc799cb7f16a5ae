"""Inspection in the Earth's shadow: nothing is lit there, and everything that predicts the light knows it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from safe_inspect.config.data import configs_root
from safe_inspect.config.experiment import load_experiment
from safe_inspect.dynamics.orbit.earth import earth_shadow
from safe_inspect.environments import BatchedEnvironment
from safe_inspect.errors import ConfigError
from safe_inspect.evaluation.policies import baseline
from safe_inspect.evaluation.rollouts import rollout
from safe_inspect.platforms.outlook_sensors import CoastingInspectionSensor

ROOT = configs_root()
PLAIN, COASTING = (ROOT / f"translational-inspection/experiment{name}.yml" for name in ("", "-burn-and-coast"))
TURNING = "simulator.config.chief_angular_velocity=[0.001, 0, 0.002]"
ON = "illumination_params.eclipse=true"
N = 0.001027
EDGE = earth_shadow(N, 150e9).edge


def made(file: Any, overrides: list[str], rows: int = 64, seed: int = 3) -> BatchedEnvironment:
    env = BatchedEnvironment(load_experiment(file, overrides).spec, rows, seed=seed)
    env.reset()
    return env


def dark(env: BatchedEnvironment) -> np.ndarray:
    """Return which environments are in the shadow, by the sun's angle."""
    return np.cos(env.state.sun_angle) < EDGE


@pytest.mark.parametrize(
    "turning", [[], ["simulator.config.chief_angular_velocity=[0.001, 0, 0.002]"]], ids=["", "turning"]
)
def test_points_are_inspected_as_without_eclipse_but_for_the_shadow(turning: list[str]) -> None:
    """Until the first step in the shadow both worlds are the same, and in the shadow nothing is inspected."""
    plain, shaded = made(PLAIN, turning), made(PLAIN, [*turning, ON])
    thrust = np.ones((plain.num_envs, 1, 3))  # the level 0 N of each axis
    lit_so_far, changed = ~dark(shaded), 0
    points = shaded.view().points("chief")
    assert (points.count[~lit_so_far] == 0).all()
    assert not points.lit[~lit_so_far].any()
    for _ in range(150):
        before = shaded.view().points("chief").inspected.copy()
        plain.step(thrust)
        shaded.step(thrust)
        inspected, unshaded = (env.view().points("chief").inspected for env in (shaded, plain))
        in_shadow = dark(shaded)
        going_on = shaded.state.step == plain.state.step  # until one world's episode has ended
        assert (inspected == before)[in_shadow & (shaded.state.step > 0)].all()
        lit_so_far &= ~in_shadow & going_on
        np.testing.assert_array_equal(inspected[lit_so_far], unshaded[lit_so_far])
        changed += int((inspected != before)[~in_shadow].sum())
        assert not shaded.view().points("chief").lit[in_shadow].any()
        np.testing.assert_array_equal(np.isnan(shaded.state["light_direction"][:, 0]), in_shadow)
        np.testing.assert_array_equal(shaded.state["sun_direction"], plain.state["sun_direction"])
    assert lit_so_far.any()
    assert changed > 1000


def test_a_third_of_an_orbit_of_the_shipped_task_is_dark() -> None:
    env = made(PLAIN, [ON], 4000)
    share = 2.0 * np.arccos(-EDGE) / (2.0 * np.pi)
    assert share == pytest.approx(0.344, abs=0.001)
    assert dark(env).mean() == pytest.approx(share, abs=0.03)
    sunlight = env.state["sunlight"]
    assert ((sunlight == 0.0) | (sunlight == 1.0)).mean() > 0.99
    assert ((sunlight < 0.5) == dark(env)).mean() > 0.999


def test_the_sensor_of_the_sunlight(tmp_path: Any) -> None:
    file = tmp_path / "experiment.yml"
    file.write_text(
        f"- !include {PLAIN}\n"
        "- blue0_ctrl:\n"
        "    parts+: [{part: Sensor_Sunlight}]\n"
        "    glues+: [{functor: ObserveSensor, config: {sensor: Sensor_Sunlight}}]\n"
    )
    with pytest.raises(ConfigError, match=r"Sensor_Sunlight needs an eclipse; set `eclipse: True`"):
        load_experiment(file)
    env = made(file, [ON], 16)
    reading = env.view().reading("Sensor_Sunlight")
    np.testing.assert_array_equal(reading[:, 0], env.state["sunlight"])
    assert {0.0, 1.0} <= set(reading[:, 0].tolist())


def test_an_orbit_inside_of_the_earth_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"`mean_motion` 0\.002 rad/s is inside of the Earth"):
        load_experiment(PLAIN, [ON, "simulator.config.mean_motion=0.002", "illumination_params.mean_motion=0.002"])


def test_the_coasting_sensor_predicts_the_shadow() -> None:
    steps = 400
    env = made(COASTING, [ON], 40, seed=4)
    ahead = CoastingInspectionSensor(duration=steps * 10.0)(env.view())
    unaware = CoastingInspectionSensor(duration=steps * 10.0)(made(COASTING, [], 40, seed=4).view())
    goes_on = np.ones(40, np.bool_)
    for _ in range(steps):
        goes_on &= ~env.step(np.zeros((40, 1, 4))).done[:, 0]
    share = 1.0 - env.view().points("chief").inspected.mean(axis=1)
    more = (ahead[:, 3] - share)[goes_on]
    assert goes_on.sum() > 10
    assert more.min() > -1e-12
    assert more.mean() < 0.004
    assert (share - unaware[:, 3])[goes_on].max() > 0.05


def test_a_scripted_inspector_plans_around_the_shadow() -> None:
    found = rollout(load_experiment(PLAIN, [ON]).spec, baseline("inspector"), 2, seed=5)
    assert found.success.mean() == 1.0


def test_a_record_holds_the_sunlight() -> None:
    found = rollout(load_experiment(PLAIN, [ON, "horizon=300"]).spec, baseline("zero-thrust"), 4, seed=5, record=4)
    for episode in found.trajectories:
        np.testing.assert_array_equal(episode.sunlight < 0.5, np.cos(episode.sun_angle) < EDGE)
