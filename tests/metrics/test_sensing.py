"""Errors of sensors and estimates in tables, against the distributions from which they are drawn."""

from __future__ import annotations

import numpy as np
import pytest

from safe_inspect.config.data import configs_root
from safe_inspect.config.experiment import load_experiment
from safe_inspect.config.spec import EnvironmentSpec
from safe_inspect.evaluation.results.results import Evaluation
from safe_inspect.evaluation.rollouts import rollout
from safe_inspect.evaluation.task import default_metrics
from safe_inspect.metrics import EstimateError, ReadingError
from safe_inspect.policies import ZeroThrust

SIMULATOR = "config.config.env_config.simulator.config"
NOISE = "parts.Sensor_Position.config.errors={noise: 0.2}"
BOUNDED = f"{SIMULATOR}.disturbance={{functor: BoundedDisturbance, config: {{position_error: 4 cm, velocity_error: 2 mm/s, distribution: extreme}}}}"  # noqa: E501
FILTER = f"{SIMULATOR}.disturbance=KalmanFilter"


def spec_of(*overrides: str, task: str = "translational-inspection") -> EnvironmentSpec:
    return load_experiment(configs_root() / task / "experiment.yml", ["horizon=40", *overrides]).spec


def figures(spec: EnvironmentSpec) -> dict[str, np.ndarray]:
    episodes = rollout(spec, ZeroThrust(), 64, seed=3, metrics=default_metrics(spec))
    found = {**Evaluation.of("x", episodes).team.figures, **Evaluation.of("x", episodes).agents["blue0_ctrl"].figures}
    return {name: np.asarray(values) for name, values in found.items() if name.startswith("error of ")}


def labels(spec: EnvironmentSpec) -> list[str]:
    return [metric.label for metric in default_metrics(spec) if isinstance(metric, ReadingError | EstimateError)]


def test_only_what_has_errors_is_listed() -> None:
    assert labels(spec_of()) == []
    assert labels(spec_of(NOISE)) == ["error of Sensor_Position"]
    estimated = ["error of estimated position", "error of estimated velocity"]
    assert labels(spec_of(BOUNDED)) == labels(spec_of(FILTER)) == estimated
    assert labels(spec_of(f"{SIMULATOR}.disturbance={{functor: BoundedDisturbance, config: {{velocity: 1e-3}}}}")) == []
    team = spec_of(NOISE, task="multiagent-translational-inspection")
    assert labels(team) == ["error of Sensor_Position"], "once for all deputies"


def test_the_units_are_those_of_what_is_measured() -> None:
    assert (ReadingError(sensor="s", symbol="m/s").unit, ReadingError(symbol="").unit) == ("m/s", "-")
    assert (EstimateError().unit, EstimateError(quantity="velocity").unit) == ("m", "m/s")


def test_the_errors_are_those_that_were_drawn() -> None:
    noisy = figures(spec_of(NOISE))
    assert noisy["error of Sensor_Position"].mean() == pytest.approx(0.2 * np.sqrt(8.0 / np.pi), rel=0.02)
    estimated = figures(spec_of(BOUNDED))
    np.testing.assert_allclose(estimated["error of estimated position"], 0.04, rtol=1e-9)
    np.testing.assert_allclose(estimated["error of estimated velocity"], 0.002, rtol=1e-9)
    both = figures(spec_of(NOISE, BOUNDED))
    assert set(both) == set(noisy) | set(estimated)
