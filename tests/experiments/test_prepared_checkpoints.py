"""Checkpoints whose pickles run code when they are loaded: only `--resume` loads them."""

from __future__ import annotations

import json
import os
import pickle
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml
from dummy_environment import ONE, TEAM
from random_checkpoint import discrete, experiment_of, make_module, save_run, single_run

from safe_inspect.cli.main import main
from safe_inspect.config.data import configs_root
from safe_inspect.config.spec import PolicySpec
from safe_inspect.errors import CheckpointError
from safe_inspect.experiments.modules.checkpoints import MODULES, WEIGHTS, Checkpoint, find_newest

MIXED = configs_root() / "multiagent-translational-inspection" / "experiment-mixed.yml"

#: Files that RLlib and Tune write into the folder of a run, as far as they are pickles.
PICKLES = (
    "algorithm_state.pkl",
    "class_and_ctor_args.pkl",
    "learner_group/class_and_ctor_args.pkl",
    "learner_group/state.pkl",
    "learner_group/learner/class_and_ctor_args.pkl",
    "learner_group/learner/state.pkl",
    "learner_group/learner/rl_module/class_and_ctor_args.pkl",
    "learner_group/learner/rl_module/module_state.pkl",
    "env_runner/class_and_ctor_args.pkl",
    "env_runner/state.pkl",
    "env_runner/rl_module/default_policy/module_state.pkl",
)


class Prepared:
    """An object whose pickle makes a file when it is loaded."""

    def __init__(self, marker):
        self.marker = str(marker)

    def __reduce__(self):
        return Path.touch, (Path(self.marker),)


def prepare(folder, marker):
    """Replace every pickle below a folder by one that makes the marker, seal the checkpoints again, and count them."""
    content = pickle.dumps(Prepared(marker))
    for seal in list(folder.rglob("safe_inspect.json")):
        found = json.loads(seal.read_text())
        for name in PICKLES:
            (seal.parent / name).parent.mkdir(parents=True, exist_ok=True)
            (seal.parent / name).touch()
    if (folder / "tune").is_dir():
        (folder / "tune" / "000" / "tuner.pkl").touch()
    pickles = list(folder.rglob("*.pkl"))
    for path in pickles:
        path.write_bytes(content)
    for seal in list(folder.rglob("safe_inspect.json")):
        Checkpoint(seal.parent, found["iteration"], found["steps"], found["seconds"], found["digest"]).seal()
    return len(pickles)


@pytest.fixture
def prepared(tmp_path):
    """Return a run's folder with prepared pickles, and the file that each of them makes when it is loaded."""
    marker = tmp_path / "marker"
    single_run(tmp_path / "run", experiment_of(discrete, overrides=("horizon=4",)))
    modules = {path.name for path in (tmp_path / "run").rglob("*.pkl")}
    assert {"class_and_ctor_args.pkl", "module_state.pkl"} <= modules
    assert prepare(tmp_path / "run", marker) > len(PICKLES)
    return tmp_path / "run", marker


def test_the_pickles_would_run(prepared):
    folder, marker = prepared
    from ray.rllib.core.rl_module.rl_module import RLModule

    checkpoint = find_newest(folder)[0].path
    RLModule.from_checkpoint(str(checkpoint / MODULES / "default_policy"))
    assert marker.exists()


@pytest.mark.parametrize(
    "words",
    [
        ("evaluate", "RUN", "--episodes", "2", "--output", "results"),
        ("compare", "RUN", "zero-thrust", "--episodes", "2"),
        ("draw", "RUN", "--output", "a.png"),
        ("film", "RUN", "--frames", "2", "--width", "320", "--output", "a.gif"),
        ("view", "RUN", "--output", "a.html"),
        ("export", "RUN", "--output", "a.onnx"),
    ],
    ids=lambda words: words[0],
)
def test_no_command_loads_a_pickle(prepared, words, monkeypatch, capsys):
    if words[0] == "export":
        pytest.importorskip("onnx")
    folder, marker = prepared
    monkeypatch.chdir(folder.parent)
    assert main([str(folder) if word == "RUN" else word for word in words]) == 0, capsys.readouterr().err
    assert not marker.exists()


@pytest.fixture
def no_pickle(monkeypatch):
    """Let every way to load a pickle fail."""
    import cloudpickle
    import ray.cloudpickle
    import torch

    def refuse(*_, **__):
        raise AssertionError("a pickle was loaded")

    for module in (pickle, ray.cloudpickle, cloudpickle):
        for name in ("load", "loads", "Unpickler"):
            if hasattr(module, name):
                monkeypatch.setattr(module, name, refuse)
    monkeypatch.setattr(torch, "load", refuse)
    monkeypatch.setattr(np, "load", refuse)


def open_all(folder):
    """Open the policy of a run in every way that there is."""
    from safe_inspect.experiments.modules.policy import (
        FrozenPolicy,
        frozen_spec,
        policy_spec,
        trained_policy,
    )
    from safe_inspect.experiments.modules.sources import open_source

    checkpoint = find_newest(folder)[0].path
    spec, policies = open_source(folder)
    observation = np.linspace(-1.0, 1.0, 22, dtype=np.float32).reshape(2, 11)
    wanted = policies[spec.agents[0].name].inputs(observation)
    np.testing.assert_array_equal(trained_policy(checkpoint).inputs(observation), wanted)
    frozen = frozen_spec(PolicySpec("old", ("blue0_ctrl",), "", {}, checkpoint=str(checkpoint))).build()
    assert isinstance(frozen, FrozenPolicy)
    model = {"fcnet_hiddens": [32, 32], "fcnet_activation": "tanh", "vf_share_layers": False}
    start = policy_spec({**model, "initial_weights": str(checkpoint)})
    start.observation_space, start.action_space = frozen.observation_space, frozen.action_space
    for module in (frozen, start.build()):
        for name, value in trained_policy(checkpoint).module.state_dict().items():
            np.testing.assert_array_equal(module.state_dict()[name].numpy(), value.numpy())


def test_a_policy_is_opened_without_any_loader_of_pickles(prepared, no_pickle):
    open_all(prepared[0])
    assert not prepared[1].exists()


def test_a_checkpoint_with_pickles_alone_is_refused(prepared, capsys):
    folder, marker = prepared
    checkpoint = find_newest(folder)[0]
    (checkpoint.path / MODULES / "default_policy" / WEIGHTS).unlink()
    checkpoint.seal()
    for words in (("evaluate", str(folder), "--episodes", "2"), ("export", str(folder)), ("view", str(folder))):
        assert main(list(words)) == 2
        told = capsys.readouterr().err
        assert f"{checkpoint.path}: the checkpoint contains the policy 'default_policy' only as a pickle" in told
        assert "Train again" in told
    assert not marker.exists()


def test_weights_of_another_version_or_none_are_refused(prepared):
    from safe_inspect.experiments.modules.policy import trained_policy

    checkpoint = find_newest(prepared[0])[0]
    path = checkpoint.path / MODULES / "default_policy" / WEIGHTS
    content = path.read_bytes()
    for change, text in (
        (lambda: content.replace(b'"format":"1"', b'"format":"9"'), "whose format this version does not read"),
        (lambda: content.replace(b"fcnet_use_layernorm", b"fcnet_use_layer_norm"[:19]), "unknown setting"),
        (lambda: content.replace(b"[32, 32]", b"[32, 16]"), "its weights do not match this policy"),
        (lambda: content.replace(b'\\"choices\\"', b'\\"chances\\"'), "the weights are damaged"),
        (lambda: content.replace(b'\\"unit\\"', b'\\"tinu\\"'), "the weights are damaged"),
        (lambda: content[:-100], "the weights are damaged"),
        (lambda: b"", "the weights are damaged"),
    ):
        assert change() != content
        path.write_bytes(change())
        checkpoint.seal()
        with pytest.raises(CheckpointError, match=text):
            trained_policy(checkpoint.path)


@pytest.mark.ray
def test_trainings_start_from_a_prepared_checkpoint(algorithm, tmp_path):
    model = {"fcnet_hiddens": [16, 16]}
    one = algorithm({"team": ONE}, model_config=model)
    one.save_to_path(str(tmp_path / "checkpoint"))
    Checkpoint(tmp_path / "checkpoint", 1, 100, 1.0).seal()
    assert prepare(tmp_path, tmp_path / "marker") >= len(PICKLES)
    wanted = one.learner_group._learner.module["default_policy"].state_dict()
    team = [TEAM[0], {**TEAM[1], "size": 11}]
    old = PolicySpec("old", ("green",), "", {}, str(tmp_path / "checkpoint"))
    policies = (PolicySpec("shared", ("red", "blue"), "PPO", {}), old)
    model["initial_weights"] = str(tmp_path / "checkpoint")
    algo = algorithm({"team": team}, policies=policies, model_config=model)
    for name in ("shared", "old"):
        for key, value in algo.learner_group._learner.module[name].unwrapped().state_dict().items():
            np.testing.assert_array_equal(value.numpy(), wanted[key].numpy())
        mine = algo.env_runner.module[name].state_dict()
        assert all((mine[key] == wanted[key]).all() for key in mine)
    algo.train()
    assert not (tmp_path / "marker").exists()


@pytest.mark.ray
@pytest.mark.slow
def test_a_training_as_a_user_types_it(tmp_path):
    mixed = experiment_of(path=MIXED, overrides=("horizon=20",))
    module = make_module(mixed.spec.agents[0], fcnet_hiddens=[256, 256])
    checkpoint = save_run(tmp_path / "earlier", mixed, {"default_policy": module})
    marker = tmp_path / "marker"
    prepare(tmp_path / "earlier", marker)
    tree = mixed.resolved
    (red,) = (entry for entry in tree["agent_config"] if entry["name"] == "red_ctrl")
    red["policy"] = {"checkpoint": str(checkpoint)}
    for entry in tree["agent_config"]:
        if "algorithm" in entry["policy"]:
            entry["policy"]["config"]["model_config"]["initial_weights"] = str(checkpoint)
    (tmp_path / "team.yml").write_text(yaml.safe_dump(tree))
    small = {"num_envs_per_env_runner": 4, "train_batch_size_per_learner": 64, "minibatch_size": 32, "num_epochs": 1}
    command = [sys.executable, "-m", "safe_inspect.train_rl", "--cfg", "team.yml", "--output", "out"]
    command += [f"{key}={value}" for key, value in small.items()]
    command += ["config.config.tune_config.stop={training_iteration: 1}"]
    environment = {key: value for key, value in os.environ.items() if not key.startswith("RAY_")}
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    assert not marker.exists()
    (run,) = (tmp_path / "out").iterdir()
    from safe_inspect.experiments.modules.policy import trained_policy

    frozen = trained_policy(find_newest(run)[0].path, "red_ctrl").module.state_dict()
    for name, value in module.state_dict().items():
        np.testing.assert_array_equal(frozen[name].numpy(), value.numpy())
