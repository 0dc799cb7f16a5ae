from __future__ import annotations

import shutil
import subprocess
import sys
import time

import numpy as np
import pytest

from safe_inspect.config.data import configs_root
from safe_inspect.config.experiment import build_experiment, load_experiment
from safe_inspect.config.loading.loader import load
from safe_inspect.environments import BatchedEnvironment, TeamEnvironment
from safe_inspect.rendezvous.experiment import build_rendezvous, load_rendezvous
from safe_inspect.task_ids import TASKS, TEAM_TASKS

FILES = sorted(configs_root().rglob("*.yml"))
FOLDERS = ("translational-inspection", "multiagent-translational-inspection")
WEIGHTED = ("weighted-translational-inspection", "multiagent-weighted-translational-inspection")
SIX_DOF = ("weighted-six-dof-inspection", "multiagent-weighted-six-dof-inspection")
OTHERS = (*WEIGHTED, *SIX_DOF, "docking", "multiagent-docking", "tumbling-rendezvous-learning")
EXPERIMENTS = sorted(
    path for folder in (*FOLDERS, *OTHERS) for path in (configs_root() / folder).rglob("experiment*.yml")
)
RENDEZVOUS = sorted((configs_root() / "tumbling-rendezvous").glob("experiment*.yml"))


def test_there_are_files():
    assert len(FILES) >= 10
    assert {configs_root() / path for path in (TASKS | TEAM_TASKS).values()} <= set(EXPERIMENTS)
    assert {path.parent.name for path in FILES} >= set(FOLDERS)
    assert set(EXPERIMENTS) | set(RENDEZVOUS) == set(configs_root().rglob("experiment*.yml"))
    assert RENDEZVOUS
    for folder in FOLDERS:
        assert {configs_root() / folder / f"experiment{end}.yml" for end in ("", "-seed")} <= set(EXPERIMENTS)


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.relative_to(configs_root()).as_posix())
def test_every_file_loads(path):
    assert load(path)


@pytest.mark.parametrize("path", EXPERIMENTS, ids=lambda path: f"{path.parent.name}-{path.stem}")
def test_every_experiment_builds_and_steps(path):
    experiment = load_experiment(path)
    env = TeamEnvironment(experiment.spec, 8)
    observations = env.reset()
    for _ in range(20):
        transition = env.step([np.zeros((8, group.size, group.action_layout.size)) for group in env.acting])
        for group in transition.groups:
            assert np.isfinite(group.reward).all()
        acting = [told for told, group in zip(transition.groups, env.groups, strict=True) if not group.scripted]
        assert [told.observation.shape for told in acting] == [seen.shape for seen in observations]


@pytest.mark.parametrize("path", RENDEZVOUS, ids=lambda path: path.stem)
def test_every_rendezvous_loads(path):
    assert build_rendezvous(load_rendezvous(path).resolved).config == load_rendezvous(path).config


def test_the_shipped_task_is_the_documented_one(shipped):
    experiment = load_experiment(shipped)
    env = BatchedEnvironment(experiment.spec)
    assert env.observation_layout.names == (
        "Sensor_Position.x", "Sensor_Position.y", "Sensor_Position.z",
        "Sensor_Velocity.v_x", "Sensor_Velocity.v_y", "Sensor_Velocity.v_z",
        "Sensor_InspectedPoints.n_inspected",
        "Sensor_UninspectedPoints.x_ups", "Sensor_UninspectedPoints.y_ups", "Sensor_UninspectedPoints.z_ups",
        "Sensor_SunAngle.theta_sun",
    )  # fmt: skip
    assert env.action_layout.names == ("X Thrust", "Y Thrust", "Z Thrust")
    assert experiment.spec.step_size == 10.0
    assert experiment.spec.platforms["blue0"].mass == 12.0
    agent = experiment.spec.agents[0]
    assert [named.name for named in agent.rewards] == [
        "ObservedPointsReward", "InspectionSuccessReward", "InspectionCrashReward", "InspectionDeltaVReward",
    ]  # fmt: skip
    assert {named.name: named.functor for named in agent.dones}["EpisodeLengthDone"].horizon == 1224
    assert experiment.algorithm == "PPO"


@pytest.mark.parametrize("folder", FOLDERS)
def test_the_seed_experiments_hold_the_first_values(folder):
    experiment = load_experiment(configs_root() / folder / "experiment-seed.yml")
    simulator = experiment.spec.simulator
    assert simulator.delta_v_scale_bounds == (-0.1, -0.001)
    assert simulator.delta_v_scale_step == -0.00005
    assert simulator.steps_until_update == 1500
    assert simulator.inspected_points_update_bounds == (0.8, 0.9)
    for agent in experiment.spec.agents:
        assert {named.name: named.functor.scale for named in agent.rewards} == {
            "ObservedPointsReward": 0.01,
            "InspectionSuccessReward": 1.0,
            "InspectionCrashReward": -1.0,
            "InspectionDeltaVReward": -0.001,
        }
    for group in TeamEnvironment(experiment.spec, 1).acting:
        layout = group.action_layout
        assert not layout.choices  # N, no index of a level
        np.testing.assert_array_equal(layout.low, [-1.0] * 3)
        np.testing.assert_array_equal(layout.high, [1.0] * 3)
    assert experiment.algorithm == "PPO"
    values = {
        "num_envs_per_env_runner": 64, "train_batch_size_per_learner": 4000, "minibatch_size": 500, "num_epochs": 10,
        "lr": 3.0e-4, "gamma": 0.99, "lambda_": 0.95, "clip_param": 0.2, "entropy_coeff": 0.0,
        "model_config": {"fcnet_hiddens": [256, 256], "fcnet_activation": "tanh", "vf_share_layers": False},
    }  # fmt: skip
    assert {name: experiment.rllib[name] for name in values} == values
    assert "use_kl_loss" not in experiment.rllib  # RLlib's own value
    assert all(policy.trains and not policy.config for policy in experiment.policies.values())


@pytest.mark.parametrize("folder", FOLDERS)
@pytest.mark.parametrize("name", ["experiment", "experiment-seed"])
def test_what_differs_from_another_experiment_gives_what_is_written_out(long_form, monkeypatch, tmp_path, folder, name):
    for each in FOLDERS:
        shutil.copytree(long_form / each, tmp_path / "configs" / each)
    monkeypatch.chdir(tmp_path)
    written = load_experiment(f"configs/{folder}/{name}.yml")
    shipped = load_experiment(configs_root() / folder / f"{name}.yml")
    assert (shipped.rllib, shipped.policies, shipped.config) == (written.rllib, written.policies, written.config)


def test_a_resolved_experiment_builds_the_same(shipped):
    experiment = load_experiment(shipped, ["ObservedPointsReward.config.scale=0.5", "horizon=7"])
    again = build_experiment(experiment.resolved)
    assert again.spec == experiment.spec
    assert again.rllib == experiment.rllib


def test_validating_is_quick_and_loads_no_compiler(shipped):
    code = f"""
import sys
import safe_inspect
safe_inspect.load_experiment({str(shipped)!r})
heavy = {{"ray", "torch", "numba", "sklearn", "scipy", "matplotlib"}} & set(sys.modules)
assert not heavy, heavy
"""
    begin = time.perf_counter()
    subprocess.run([sys.executable, "-c", code], check=True)
    assert time.perf_counter() - begin < 10.0  # under a second on an idle machine; this one may be busy
