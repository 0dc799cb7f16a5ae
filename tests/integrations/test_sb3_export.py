"""Policies of Stable-Baselines3 and of plain Torch become files that fly as the models do."""

from __future__ import annotations

import numpy as np
import pytest

import safe_inspect
from safe_inspect.cli.main import main
from safe_inspect.environments import FlatDiscreteActions
from safe_inspect.errors import CheckpointError

sb3 = pytest.importorskip("stable_baselines3", reason="pip install 'safe_inspect[sb3]'")
pytest.importorskip("onnx")

import torch  # noqa: E402

from safe_inspect.evaluation.onnx_policy import load_onnx  # noqa: E402
from safe_inspect.experiments.perceptron import export_perceptron  # noqa: E402
from safe_inspect.integrations.sb3_export import export_onnx  # noqa: E402
from safe_inspect.integrations.stable_baselines3 import BatchedVecEnv  # noqa: E402

DOCKING = "safe_inspect/Docking-v0"  # real thrusts
LEVELS = "safe_inspect/TranslationalInspection-v1"
_NET = {"net_arch": [16, 8]}


def _model(kind, task, **keys):
    keys = {"policy_kwargs": {**_NET}, "seed": 1, **keys}
    return getattr(sb3, kind)("MlpPolicy", BatchedVecEnv(task, num_envs=2, seed=1), **keys)


@pytest.mark.parametrize(
    ("kind", "task"), [("PPO", DOCKING), ("A2C", LEVELS), ("SAC", DOCKING), ("TD3", DOCKING)]
)  # fmt: skip
def test_the_file_commands_what_the_model_predicts(kind, task, tmp_path):
    model = _model(kind, task)
    done = export_onnx(model, task, tmp_path / "policy.onnx")
    assert done.difference.passes
    policy = safe_inspect.load_policy(tmp_path / "policy.onnx")
    envs = safe_inspect.make_vec(task, num_envs=64)
    observations, _ = envs.reset(seed=3)
    for _ in range(5):
        wanted = model.predict(observations, deterministic=True)[0]
        found = policy.predict(observations)
        np.testing.assert_allclose(found, wanted, atol=2e-5)
        observations, *_ = envs.step(wanted)
    if task == DOCKING:
        assert np.ptp(wanted, axis=0).max() > 1e-3
    else:
        assert len(np.unique(wanted)) > 1


def test_the_file_of_dqn_flies_the_best_combination(tmp_path):
    flat = FlatDiscreteActions(safe_inspect.make(LEVELS))
    model = sb3.DQN("MlpPolicy", flat, policy_kwargs=_NET, seed=1, buffer_size=10)
    assert export_onnx(model, LEVELS, tmp_path / "policy.onnx").difference.passes
    envs = safe_inspect.make_vec(LEVELS, num_envs=64)
    observations, _ = envs.reset(seed=3)
    policy = safe_inspect.load_policy(tmp_path / "policy.onnx")
    wanted = np.stack([flat.action(index) for index in model.predict(observations, deterministic=True)[0]])
    np.testing.assert_array_equal(policy.predict(observations), wanted)
    np.testing.assert_array_equal(policy.predict(observations, np.random.default_rng(0)), wanted)  # it draws nothing
    assert len(np.unique(wanted, axis=0)) > 1


def test_a_drawn_file_has_the_spread_of_the_model(tmp_path):
    model = _model("PPO", DOCKING, policy_kwargs={**_NET, "log_std_init": -1.0})
    export_onnx(model, DOCKING, tmp_path / "policy.onnx")
    _, inputs = load_onnx(tmp_path / "policy.onnx").outputs(np.zeros((2, 8), np.float32))
    np.testing.assert_allclose(inputs[:, 3:], -1.0)


def test_the_file_is_evaluated_with_the_task_in_which_it_was_trained(tmp_path, capsys):
    export_onnx(_model("PPO", DOCKING), DOCKING, tmp_path / "policy.onnx", ["horizon=40"])
    assert main(["evaluate", str(tmp_path / "policy.onnx"), "--episodes", "2"]) == 0
    assert "2 episodes" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("make", "task", "shown"),
    [
        (lambda: _model("PPO", DOCKING), LEVELS, "the task in which it was trained"),
        (lambda: _model("PPO", DOCKING, use_sde=True), DOCKING, "use_sde"),
        (
            lambda: sb3.PPO("MlpPolicy", sb3.common.vec_env.VecNormalize(BatchedVecEnv(DOCKING, num_envs=2))),
            DOCKING,
            "VecNormalize",
        ),
    ],
)
def test_what_no_file_can_hold_is_refused_and_leaves_none(make, task, shown, tmp_path):
    with pytest.raises(CheckpointError, match=shown):
        export_onnx(make(), task, tmp_path / "policy.onnx")
    assert not list(tmp_path.iterdir())


def test_layers_of_torch_are_exported(tmp_path):
    torch.manual_seed(1)
    net = torch.nn.Sequential(torch.nn.Linear(8, 16), torch.nn.ReLU(), torch.nn.Linear(16, 3))
    export_perceptron(net, DOCKING, tmp_path / "policy.onnx", training={"steps": 5})
    policy = safe_inspect.load_policy(tmp_path / "policy.onnx")
    observations = np.random.default_rng(1).standard_normal((16, 8)).astype(np.float32)
    with torch.no_grad():
        wanted = net(torch.from_numpy(observations)).numpy()
    np.testing.assert_allclose(policy.predict(observations), np.clip(wanted, -1.0, 1.0), atol=1e-5)
