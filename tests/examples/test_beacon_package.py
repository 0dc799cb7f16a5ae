"""The vehicle and the task in `examples/beacon_package`, which the core knows nothing of."""

from __future__ import annotations

import math
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import safe_inspect
from safe_inspect.environments import BatchedEnvironment, TeamEnvironment
from safe_inspect.errors import ConfigError

_PACKAGE = Path(__file__).parents[2] / "examples" / "beacon_package"
_EXPERIMENT = _PACKAGE / "configs" / "beacon" / "experiment.yml"
_BY_PATH = "config.config.env_config.plugin_paths=[safe_inspect_beacon]"


@pytest.fixture
def load(monkeypatch):
    monkeypatch.syspath_prepend(str(_PACKAGE / "src"))
    return lambda *overrides: safe_inspect.load_experiment(_EXPERIMENT, [_BY_PATH, *overrides]).spec


@pytest.mark.parametrize("decimation", [1, 2, 5])
def test_the_vehicle_moves_by_its_closed_form(load, decimation):
    env = BatchedEnvironment(load(f"decimation={decimation}"), 3, seed=2)
    env.reset()
    p, v = env.state.position[:, 0].copy(), np.zeros((3, 3))
    force = np.array([[0.5, -1.0, 0.25], [0.0, 0.0, 0.0], [1.0, 1.0, 1.0]])
    k, t, mass = 0.02, 5.0, 12.0
    for _ in range(4):
        env.step(force[:, None])
        end = force / (mass * k)
        p = p + end * t + (v - end) * (1.0 - math.exp(-k * t)) / k
        v = end + (v - end) * math.exp(-k * t)
        np.testing.assert_allclose(env.state.position[:, 0], p, rtol=1e-12)
        np.testing.assert_allclose(env.state.velocity[:, 0], v, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(env.state.delta_v[:, 0], np.abs(force).sum(axis=1) / mass * 20.0, rtol=1e-12)
    np.testing.assert_allclose(env.state.time, 20.0)


def test_the_beacon_moves_and_is_seen_paid_and_reached(load):
    env = BatchedEnvironment(load(), 64, seed=3)
    first = env.reset()
    angle = env.state.beacon_angle.copy()
    assert np.ptp(angle) > 3.0
    transition = env.step(np.zeros((64, 1, 3)))
    np.testing.assert_allclose(env.state.beacon_angle, angle + 0.025)
    beacon = 50.0 * np.stack((np.cos(env.state.beacon_angle), np.sin(env.state.beacon_angle), np.zeros(64)), axis=1)
    relative = beacon - env.state.position[:, 0]
    np.testing.assert_allclose(transition.observation[:, 0, 3:], relative / 100.0, rtol=1e-5, atol=1e-6)
    nearer = np.linalg.norm(first[:, 0, 3:] * 100.0, axis=1) - np.linalg.norm(relative, axis=1)
    np.testing.assert_allclose(transition.reward[:, 0], 0.02 * nearer, atol=2e-6)
    env.state.position[:, 0] = env.state.beacon_position
    assert (env.step(np.zeros((64, 1, 3))).status == 1).all()


@pytest.mark.parametrize("num_envs", [1, 5, 64])
def test_its_row_kernel_runs_in_the_compiled_step_with_equal_values(load, num_envs):
    fused, plain = (TeamEnvironment(load(), num_envs, seed=3, _fused=fused) for fused in (True, False))
    fused.reset(), plain.reset()
    (group,) = fused.groups
    assert group.fused.called_in_python[-1] == "BeaconReachedDone"
    assert "BeaconProgressReward" not in group.fused.called_in_python
    generator = np.random.default_rng(1)
    for _ in range(20):
        actions = [generator.uniform(-1.0, 1.0, (num_envs, 1, 3))]
        one, other = (env.step(actions).groups[0] for env in (fused, plain))
        assert one.terms["BeaconProgressReward"].tobytes() == other.terms["BeaconProgressReward"].tobytes()
        assert one.observation.tobytes() == other.observation.tobytes()
        sides = ((view.beacon_position - view.position) ** 2 for view in (one.step.before, one.step.after))
        before, after = (np.sqrt(side.sum(axis=1)) for side in sides)
        np.testing.assert_allclose(one.reward[:, 0], 0.02 * (before - after), atol=1e-12)


def test_a_name_that_the_task_does_not_offer_is_one_message(load):
    env = BatchedEnvironment(load(), 1)
    env.reset()
    with pytest.raises(AttributeError, match=r"the view of this task has no 'sun_direction'; .*beacon_position"):
        _ = env.view().sun_direction
    info = safe_inspect.environments.InspectionEnv(load()).reset(seed=1)[1]
    assert "beacon_distance" in info
    assert "inspected_count" not in info


def test_a_filter_for_another_vehicle_is_refused(load):
    wrapped = "[{functor: ControllerGlue, config: {controller: X Thrust}}]"
    glue = f"{{functor: RTAGlueCWHInspection1v1, config: {{enabled: True}}, wrapped: {wrapped}}}"
    with pytest.raises(
        ConfigError, match=r"Clohessy-Wiltshire dynamics, but these deputies move by DragPointMass; disable"
    ):
        load(f"agent_config.blue0_ctrl.config.config.glues.0={glue}")


@pytest.mark.slow
@pytest.mark.ray
def test_it_trains_and_is_evaluated(tmp_path):
    environment = {**os.environ, "PYTHONPATH": str(_PACKAGE / "src")}

    def run(*arguments: str) -> str:
        command = [sys.executable, "-m", *arguments]
        done = subprocess.run(command, capture_output=True, text=True, timeout=300, env=environment, cwd=tmp_path)
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout + done.stderr

    words = ("num_env_steps_sampled_lifetime=8000", _BY_PATH)
    told = run("safe_inspect.train_rl", "--cfg", str(_EXPERIMENT), "--output", "out", *words)
    assert "iteration    2" in told
    (folder,) = (tmp_path / "out").iterdir()
    assert "4 episodes" in run("safe_inspect", "evaluate", str(folder), "--episodes", "4")


def _command(*arguments: str) -> None:
    from safe_inspect.cli.main import main

    assert main([*arguments, "--cfg", str(_EXPERIMENT), "--seed", "3", _BY_PATH]) == 0


def test_it_is_evaluated_compared_and_drawn_with_its_own_columns(load, tmp_path, capsys):
    from safe_inspect.evaluation.results.files import read_evaluation, read_trajectories

    load()
    folder, figure = tmp_path / "flown", tmp_path / "episode.png"
    _command("evaluate", "random", "--episodes", "6", "--record", "2", "--output", str(folder))
    table = capsys.readouterr().out
    assert "inspect" not in table
    assert [line.split()[-1] for line in table.splitlines() if line.startswith("  beacon distance")] == ["m"]
    found = read_evaluation(folder)
    usual = ["return", "beacon distance", "delta-v", "length", "reward/BeaconProgressReward", "interventions"]
    assert list(found.team.figures) == list(found.agents["blue0_ctrl"].figures) == usual
    assert list(found.initial_states) == ["position", "velocity", "beacon_angle"]
    assert np.ptp(found.initial_states["beacon_angle"]) > 1.0
    one = read_trajectories(folder)[1]
    np.testing.assert_allclose(np.diff(one.beacon_angle), 0.025)
    beacon = 50.0 * np.array([np.cos(one.beacon_angle[-1]), np.sin(one.beacon_angle[-1]), 0.0])
    apart = np.linalg.norm(one.position[-1, 0] - beacon)
    assert found.team.figures["beacon distance"][1] == pytest.approx(apart, rel=1e-12)
    assert len(one.points) == 0

    _command("compare", str(folder), "zero-thrust")
    table = capsys.readouterr().out
    assert "zero-thrust less random, episode by episode" in table
    assert "beacon distance" in table
    assert "inspect" not in table

    _command("draw", "random", "--output", str(figure))
    assert "points" not in capsys.readouterr().out
    assert figure.stat().st_size > 10_000
