"""The third-party package in `examples/plugin_package`: found by path and by entry point, stepped, tested."""

from __future__ import annotations

import configparser
import importlib
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import safe_inspect
from safe_inspect.environments import BatchedEnvironment, TeamEnvironment
from safe_inspect.errors import ConfigError
from safe_inspect.glues import ActionGlue, ObservationGlue
from safe_inspect.metrics import Metric, TeamMetric
from safe_inspect.platforms import Controller, Sensor
from safe_inspect.plugins.registry import ENTRY_POINT_GROUP, registry
from safe_inspect.testing.rendezvous import RENDEZVOUS_CHECKS as _RENDEZVOUS

_PACKAGE = Path(__file__).parents[2] / "examples" / "plugin_package"
_EXPERIMENT = _PACKAGE / "configs" / "speed-limit" / "experiment.yml"
_FORMATION = _PACKAGE / "configs" / "formation" / "experiment.yml"
_WALL = _PACKAGE / "configs" / "wall" / "experiment.yml"
_BY_PATH = "config.config.env_config.plugin_paths=[safe_inspect_example]"


@pytest.fixture
def on_path(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(_PACKAGE / "src"))


def python(*arguments: str, path: Path, cwd: Path = _PACKAGE) -> str:
    """Run a fresh interpreter that finds the package in a folder, and return what it prints."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(path), os.environ.get("PYTHONPATH", "")])}
    done = subprocess.run(
        [sys.executable, *arguments], capture_output=True, text=True, timeout=300, env=environment, cwd=cwd
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.mark.usefixtures("on_path")
def test_the_environment_steps_with_the_plugins() -> None:
    environment = BatchedEnvironment(safe_inspect.load_experiment(_EXPERIMENT, [_BY_PATH]).spec, 4, seed=3)
    environment.reset()
    assert environment.observation_layout.names[-1] == "Sensor_RangeRate.range_rate"
    assert [named.name for named in environment.agents.agent.dones][3:] == ["FuelSpentDone", "EpisodeLengthDone"]
    assert environment.action_layout.choices == (3, 3, 3)
    forward, back = np.full((4, 1, 3), 2.0), np.zeros((4, 1, 3))  # the last and the first level: 0.1 N and -0.1 N
    too_fast = 0
    for action in [forward] * 10 + [back] * 19 + [forward] * 10:
        transition = environment.step(action)
        view = transition.step.after
        speed = np.linalg.norm(view.velocity, axis=-1)
        np.testing.assert_allclose(
            transition.terms["SpeedLimitReward"][:, 0], -0.1 * np.maximum(0.0, speed - 0.5), rtol=1e-12
        )
        too_fast += (speed > 0.5).sum()
        rate = (view.position * view.velocity).sum(axis=-1) / np.linalg.norm(view.position, axis=-1)
        np.testing.assert_allclose(transition.observation[:, 0, -1], rate / 0.5, rtol=1e-5)
        assert not transition.terminated.any()
    assert too_fast > 0
    # 0.1 N on each axis of 12 kg for 10 s: 0.25 m/s in each step, so 9.75 m/s after 39, within the budget of 10 m/s.
    np.testing.assert_allclose(environment.view().delta_v, 9.75)
    environment.step(back)
    transition = environment.step(forward)
    np.testing.assert_allclose(environment.view().delta_v, 10.25)
    assert transition.terminated.all()
    assert (transition.status == 2).all()


@pytest.mark.usefixtures("on_path")
def test_all_else_is_the_shipped_task() -> None:
    own = safe_inspect.load_experiment(_EXPERIMENT, [_BY_PATH])
    shipped = safe_inspect.load_experiment(_PACKAGE.parents[1] / "configs" / "translational-inspection/experiment.yml")
    assert own.spec.simulator == shipped.spec.simulator
    assert own.spec.reset == shipped.spec.reset
    assert own.rllib == shipped.rllib
    mine, theirs = ({named.name: named.functor for named in each.spec.agents[0].rewards} for each in (own, shipped))
    assert mine["ObservedPointsReward"] == theirs["ObservedPointsReward"]
    assert set(mine) - set(theirs) == {"SpeedLimitReward"}


@pytest.mark.usefixtures("on_path")
def test_a_mistake_in_the_variant_is_reported_with_its_place() -> None:
    with pytest.raises(ConfigError, match=r"SpeedLimitReward has no field `limt`; did you mean `limit`\?|`limt`"):
        safe_inspect.load_experiment(_EXPERIMENT, [_BY_PATH, "SpeedLimitReward.config.limt=1"])
    with pytest.raises(ConfigError, match="'m' is not a unit of speed"):
        safe_inspect.load_experiment(_EXPERIMENT, [_BY_PATH, "SpeedLimitReward.config.limit=3 m"])


def test_an_installed_package_is_found_by_its_entry_point(tmp_path: Path) -> None:
    setup = configparser.ConfigParser()
    setup.read(_PACKAGE / "setup.cfg")
    name, version = setup["metadata"]["name"], setup["metadata"]["version"]
    entries = setup["options.entry_points"][ENTRY_POINT_GROUP].strip()
    info = tmp_path / f"{name.replace('-', '_')}-{version}.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n")
    (info / "entry_points.txt").write_text(f"[{ENTRY_POINT_GROUP}]\n{entries}\n")
    shutil.copytree(_PACKAGE / "src" / "safe_inspect_example", tmp_path / "safe_inspect_example")

    listed = python("-m", "safe_inspect.cli.main", "list", "reward", "SpeedLimitReward", path=tmp_path)
    assert "limit" in listed
    assert "[m/s]" in listed
    assert "is valid" in python("-m", "safe_inspect.cli.main", "validate", str(_EXPERIMENT), path=tmp_path)


@pytest.mark.slow
def test_the_default_filter_keeps_the_deputy_off_the_wall() -> None:
    told = python(
        "-m", "safe_inspect.cli.main", "safety", str(_WALL), _BY_PATH, "--steps", "100000", "--num-envs", "256",
        path=_PACKAGE / "src",
    )  # fmt: skip
    (wall,) = (line.split() for line in told.splitlines() if line.startswith("Wall"))
    assert 0.0 <= float(wall[1]) < 1.0  # the adversaries came to it
    assert wall[3:] == ["0", "0"]
    assert "infeasible steps: 0;" in told


@pytest.mark.slow
def test_its_own_tests_pass() -> None:
    told = python("-m", "pytest", "-q", "-p", "no:cacheprovider", "tests", path=_PACKAGE / "src")
    assert re.search(r"\n3\d passed in ", told), told


@pytest.mark.usefixtures("on_path")
def test_the_examples_hold_a_plugin_of_each_kind(monkeypatch) -> None:
    monkeypatch.syspath_prepend(str(_PACKAGE.parent / "beacon_package" / "src"))
    packages = [importlib.import_module(name) for name in ("safe_inspect_example", "safe_inspect_beacon")]
    plugins = [getattr(package, name) for package in packages for name in package.__all__]
    kinds = {kind for kind in registry.kinds() if not kind.startswith("trial_")}  # those are of a test
    missing = kinds - set(_RENDEZVOUS) - {plugin.kind for plugin in plugins}
    assert missing == set()
    for base in (Sensor, Controller, ObservationGlue, ActionGlue, Metric, TeamMetric):
        assert any(issubclass(plugin, base) for plugin in plugins), base.__name__
    readme = (_PACKAGE / "README.md").read_text()
    assert [plugin.registered_name for plugin in plugins[: len(packages[0].__all__)]
            if f"`{plugin.registered_name}`" not in readme] == []  # fmt: skip


@pytest.mark.usefixtures("on_path")
def test_the_formation_flies_with_what_the_package_brings() -> None:
    env = TeamEnvironment(safe_inspect.load_experiment(_FORMATION, [_BY_PATH]).spec, 64, seed=1)
    (observation,) = env.reset()
    state = env.state
    radius = np.linalg.norm(state.position[:, :2], axis=-1)
    assert ((radius >= 20.0) & (radius <= 100.0)).all()
    assert not state.position[..., 2].any()
    assert (np.linalg.norm(state.position[:, 0] - state.position[:, 1], axis=-1) >= 20.0).all()
    assert observation.shape == (64, 2, 6)
    np.testing.assert_allclose(np.linalg.norm(observation[..., 3:], axis=-1), 1.0, rtol=1e-6)
    env.step([np.full((64, 2, 3), 2.0)])
    np.testing.assert_allclose(env.state.velocity[:, 0], 0.1 / 8.0 * 10.0)
    with pytest.raises(ConfigError, match="there are 3 sensors and room for 2; remove some"):
        safe_inspect.load_experiment(_FORMATION, [_BY_PATH, "platform_config.blue#.config.config.sensors=2"])


def test_the_reward_is_as_short_as_promised() -> None:
    text = (_PACKAGE / "src" / "safe_inspect_example" / "rewards.py").read_text()
    body = text[text.index("class SpeedLimitReward") :].strip()
    assert len([line for line in body.splitlines() if line.strip()]) <= 15


@pytest.mark.usefixtures("on_path")
def test_the_shipped_task_is_flown_on_the_orbit_and_with_the_noise_of_the_package() -> None:
    simulator = "config.config.env_config.simulator.config"
    given = [
        f"{simulator}.dynamics={{functor: safe_inspect_example.SchweighartSedwick, config: {{inclination: 98 deg}}}}",
        f"{simulator}.disturbance={{functor: safe_inspect_example.ThrustNoise, config: {{sigma: 10 mN}}}}",
    ]
    env = TeamEnvironment(safe_inspect.load_experiment("safe_inspect/TranslationalInspection-v1", given).spec, 64)
    env.reset()
    env.step([np.full((64, 1, 3), 1.0)])
    assert env.simulation.flown.std() == pytest.approx(0.01, rel=0.2)
    assert not env.state.control.any(), "the middle choice is no thrust"
    for name in ("noise", "orbits"):
        lines = (_PACKAGE / "src" / "safe_inspect_example" / f"{name}.py").read_text().splitlines()
        assert sum(bool(line.strip()) for line in lines) <= 40, "as short as the README says"
