"""Exported policies are the checkpoint's, say what they are, and leave no file when they cannot be written."""

from __future__ import annotations

import argparse
import json
import logging

import numpy as np
import pytest
from random_checkpoint import LEVELS, TEAM, discrete, experiment_of, make_module, save_run, scaled, single_run

from safe_inspect.cli.commands import export as command
from safe_inspect.environments import TeamEnvironment
from safe_inspect.errors import CheckpointError, ConfigError, OutputError, SafeInspectError
from safe_inspect.evaluation.onnx_policy import load_onnx
from safe_inspect.experiments.modules.checkpoints import policy_names
from safe_inspect.glues import Normalizer
from safe_inspect.plugins.registry import registry

onnx = pytest.importorskip("onnx")
logging.getLogger("ray").setLevel(logging.ERROR)


@pytest.fixture
def classes():
    """Forget the plugins that a test defines."""
    before = {kind: dict(known) for kind, known in registry._classes.items()}
    yield
    for kind in list(registry._classes):
        registry._classes[kind] = before.get(kind, {})


def observe(experiment, prepared, rows=1000):
    """Return what the agents of the task and of the prepared one see in the same states, late in some episodes."""
    seen = []
    for spec in (experiment.spec, prepared):
        environment = TeamEnvironment(spec, rows, seed=3)
        seen.append(environment.reset()[0][:, 0])
    return seen


def asked(module, observation):
    """Return the net's outputs."""
    import torch
    from ray.rllib.core.columns import Columns

    with torch.no_grad():
        outputs = module.forward_inference({Columns.OBS: torch.from_numpy(observation)})
    return outputs[Columns.ACTION_DIST_INPUTS].numpy()


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Return an experiment, and a checkpoint in the folder of its run."""
    experiment = experiment_of()
    return experiment, single_run(tmp_path_factory.mktemp("run"), experiment)


NETS = [
    {},
    {"fcnet_activation": "relu", "fcnet_use_layernorm": True, "fcnet_hiddens": [16]},
    {"fcnet_activation": "silu", "free_log_std": True, "log_std_clip_param": 0.5},
    {"fcnet_activation": "elu", "vf_share_layers": True, "head_fcnet_hiddens": [8], "head_fcnet_activation": "tanh"},
]


@pytest.mark.parametrize("model", NETS)
def test_the_file_gives_what_the_checkpoint_gives(tmp_path, model):
    from safe_inspect.experiments.export import export_policy

    experiment = experiment_of()
    checkpoint = single_run(tmp_path / "run", experiment, **model)
    done = export_policy(checkpoint, tmp_path / "p.onnx")
    policy = load_onnx(done.path)
    observation, readings = observe(experiment, policy.prepare(experiment.spec))
    wanted = asked(make_module(experiment.spec.agents[0], **model), observation)
    thrust, inputs = policy.outputs(readings)
    np.testing.assert_allclose(inputs, wanted, rtol=2e-5, atol=2e-5)
    np.testing.assert_allclose(thrust, np.clip(wanted[:, :3], -1.0, 1.0), atol=2e-5)
    assert np.ptp(thrust, axis=0).min() > 0.1
    assert done.difference.rows == 4096 + done.flown
    assert 0.0 < done.difference.action < 1e-5


def test_units_normalisers_and_limits_are_in_the_file(tmp_path):
    from safe_inspect.experiments.export import export_policy

    experiment = experiment_of(scaled)
    policy = load_onnx(export_policy(single_run(tmp_path / "run", experiment), tmp_path / "p.onnx").path)
    observation, readings = observe(experiment, policy.prepare(experiment.spec))
    assert np.abs(readings[:, :3]).max() > 10.0  # metres, where the net sees tenths
    action = asked(make_module(experiment.spec.agents[0]), observation)[:, :3].astype(np.float64)
    action = np.clip(action, [-2.0, -1.0, -2.2], [2.0, 1.0, 1.8])
    wanted = np.stack([0.5 * action[:, 0], -0.5 + 1.25 * (action[:, 1] + 1.0), 0.1 + 0.5 * action[:, 2]], axis=1)
    np.testing.assert_allclose(policy(readings), wanted, atol=5e-5)
    assert wanted[:, 1].max() > 1.0


def test_a_policy_that_chooses_among_levels_gives_them_in_newtons(tmp_path):
    from safe_inspect.experiments.export import export_policy

    experiment = experiment_of(discrete)
    done = export_policy(single_run(tmp_path / "run", experiment), tmp_path / "p.onnx")
    policy = load_onnx(done.path)
    observation, readings = observe(experiment, policy.prepare(experiment.spec))
    logits = asked(make_module(experiment.spec.agents[0]), observation)
    columns = np.split(logits, [3, 8], axis=1)
    pairs = zip((LEVELS[1:4], LEVELS, LEVELS), columns, strict=True)
    wanted = [np.array(levels)[part.argmax(axis=1)] for levels, part in pairs]
    agree = (policy(readings) == np.stack(wanted, axis=1)).all(axis=1)  # exact: the levels of the task, not of float32
    assert agree.mean() > 0.998
    assert all(len(np.unique(part)) > 1 for part in wanted)
    assert (done.info.distribution, done.info.action[1].levels) == ("categorical", tuple(LEVELS))


def test_the_metadata_tell_what_the_file_is(tmp_path):
    from safe_inspect.experiments.export import export_policy

    experiment = experiment_of()
    done = export_policy(single_run(tmp_path / "run", experiment), tmp_path / "p.onnx")
    model = onnx.load(done.path)
    onnx.checker.check_model(model, full_check=True)
    told = {item.key: item.value for item in model.metadata_props}
    elements = json.loads(told["observation"])
    assert [(item["name"], item["unit"]) for item in elements[2:8]] == [
        ("Sensor_Position.z", "m"), ("Sensor_Velocity.v_x", "m/s"), ("Sensor_Velocity.v_y", "m/s"),
        ("Sensor_Velocity.v_z", "m/s"), ("Sensor_InspectedPoints.n_inspected", ""),
        ("Sensor_UninspectedPoints.x_ups", ""),
    ]  # fmt: skip
    assert [item["width"] for item in elements] == [100.0] * 3 + [0.5] * 3 + [100.0] + [1.0] * 4
    assert [item["name"] for item in json.loads(told["action"])] == ["X Thrust", "Y Thrust", "Z Thrust"]
    assert json.loads(told["action"])[0] == {
        "name": "X Thrust", "unit": "N", "low": -1.0, "high": 1.0, "gain": 1.0, "offset": 0.0, "levels": [],
        "axis": "x", "plugins": [],
    }  # fmt: skip
    assert (told["distribution"], told["step_size"], told["task"]) == ("gaussian", "10.0", "TRANSLATIONAL-INSPECTION")
    assert json.loads(told["agents"]) == ["blue0_ctrl"]
    training = json.loads(told["training"])
    assert (training["steps"], training["iteration"], training["seed"], training["git_commit"]) == (28000, 7, 4, "abc+")
    assert "somewhere" not in told["training"]
    assert json.loads(told["configuration"]) == experiment.resolved == load_onnx(done.path).info.configuration
    assert [(item.name, item.type.tensor_type.shape.dim[1].dim_value) for item in model.graph.output] == [
        ("thrust", 3), ("action_dist_inputs", 6),
    ]  # fmt: skip


def test_each_policy_of_a_team_has_its_own_file(tmp_path):
    from safe_inspect.experiments.export import export_policy

    experiment = experiment_of(path=TEAM)
    agents = experiment.spec.agents
    modules = {agent.policy: make_module(agent, seed=index) for index, agent in enumerate(agents)}
    checkpoint = save_run(tmp_path / "run", experiment, modules)
    assert policy_names(checkpoint) == sorted(modules)
    with pytest.raises(CheckpointError, match="name one of them"):
        export_policy(checkpoint, tmp_path / "p.onnx")
    done = export_policy(checkpoint, tmp_path / "p.onnx", agents[1].policy)
    assert done.info.agents == (agents[1].name,)
    spec = load_onnx(done.path).prepare(experiment.spec, [agents[1].name])
    assert spec.agents[0] == agents[0]
    assert spec.agents[1] != agents[1]


class TestRefusals:
    """One clear message each, and no file."""

    def test_a_foreign_normaliser_is_named_with_its_glue(self, tmp_path, classes):
        from safe_inspect.experiments.export import export_policy

        class CubicNormalizer(Normalizer):
            """x^3."""

            def __call__(self, values, low, high):
                return values**3

            def inverse(self, values, low, high):
                return np.cbrt(values)

        def change(agent):
            agent["glues"][2]["config"]["normalization"] = {"normalizer": "CubicNormalizer"}

        checkpoint = single_run(tmp_path / "run", experiment_of(change))
        with pytest.raises(ConfigError, match=r"blue0_ctrl, glue ObserveSensor \(Sensor_Velocity.v_x.*CubicNormalizer"):
            export_policy(checkpoint, tmp_path / "p.onnx")
        assert not list(tmp_path.glob("*.onnx*"))

    @pytest.mark.parametrize(
        ("change", "message"),
        [
            (lambda agent: agent["glues"].pop(), "there are 11 elements in training and 10 in the task"),
            (discrete, r"X Thrust commands 0 \+ 1 a within .* in training and has the levels"),
            (scaled, r"Sensor_Position.x is seen as \(value - 0\) / 100 in training and is seen as \(value - "),
        ],
    )
    def test_an_experiment_of_another_task(self, run, tmp_path, change, message):
        from safe_inspect.experiments.export import export_policy

        with pytest.raises(CheckpointError, match=message):
            export_policy(run[1], tmp_path / "p.onnx", experiment=experiment_of(change))
        assert not list(tmp_path.iterdir())

    def test_a_checkpoint_outside_a_run_wants_an_experiment(self, run, tmp_path):
        import shutil

        from safe_inspect.experiments.export import export_policy

        alone = tmp_path / "checkpoint_000003"
        shutil.copytree(run[1], alone)
        with pytest.raises(CheckpointError, match="give the task with --cfg"):
            export_policy(alone, tmp_path / "p.onnx")
        assert export_policy(alone, tmp_path / "p.onnx", experiment=run[0]).info.training["steps"] == 28_000

    def test_a_file_that_differs_from_the_checkpoint_is_not_left(self, run, tmp_path, monkeypatch):
        from safe_inspect.experiments import export

        def spoilt(net, info, title):
            import torch

            with torch.no_grad():
                net.module.pi.net.mlp[-1].bias += 1e-4
            return build(net, info, title)

        build = export.build_file
        monkeypatch.setattr(export, "build_file", spoilt)
        (tmp_path / "p.onnx").write_text("old")
        with pytest.raises(CheckpointError, match=r"differs from the given one by \d\.\de-05 of the action's"):
            export.export_policy(run[1], tmp_path / "p.onnx")
        assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [("p.onnx", "old")]

    def test_a_place_that_cannot_be_written(self, run, tmp_path):
        from safe_inspect.experiments.export import export_policy

        (tmp_path / "file").write_text("")
        with pytest.raises(OutputError, match=r"file/p.onnx: the file cannot be written \(Not a directory\)"):
            export_policy(run[1], tmp_path / "file" / "p.onnx")
        with pytest.raises(OutputError, match=r"cannot be written \(Is a directory\)"):
            export_policy(run[1], tmp_path)
        assert [path.name for path in tmp_path.iterdir()] == ["file"]

    def test_a_missing_package_is_named_with_its_extra(self, run, tmp_path, monkeypatch):
        import sys

        from safe_inspect.experiments.export import export_policy

        monkeypatch.setitem(sys.modules, "onnx", None)
        with pytest.raises(SafeInspectError, match=r"pip install 'safe_inspect\[onnx\]'"):
            export_policy(run[1], tmp_path / "p.onnx")

    def command(self, *arguments):
        parser = argparse.ArgumentParser()
        command.add_arguments(parser)
        return command.run(parser.parse_args([str(item) for item in arguments]))

    def test_the_command_takes_the_newest_checkpoint_of_a_run(self, run, tmp_path, monkeypatch, capsys):
        monkeypatch.chdir(tmp_path)
        assert self.command(run[1].parents[3]) == 0
        told = capsys.readouterr().out
        assert told.startswith("policy.onnx: TRANSLATIONAL-INSPECTION, policy default_policy, for blue0_ctrl\n")
        assert "11 readings in SI units to 3 commands" in told
        assert [path.name for path in tmp_path.iterdir()] == ["policy.onnx"]

    @pytest.mark.parametrize(
        ("arguments", "message"),
        [
            (["nowhere"], "nowhere: there is no such checkpoint"),
            ([__file__], "this is a file; give the folder of a checkpoint or of a training run"),
            (["."], "neither a checkpoint nor the folder of a training run"),
            (["RUN", "--policy", "defualt_policy"], "has no policy 'defualt_policy'; did you mean"),
            (["RUN", "horizon=3"], "give one with --cfg"),
        ],
    )
    def test_mistakes_on_the_command_line(self, run, tmp_path, monkeypatch, arguments, message):
        monkeypatch.chdir(tmp_path)
        with pytest.raises(SafeInspectError, match=message):
            self.command(*(run[1].parents[3] if text == "RUN" else text for text in arguments))
        assert not list(tmp_path.iterdir())
