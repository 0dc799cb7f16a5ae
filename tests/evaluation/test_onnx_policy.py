"""ONNX files fly as their checkpoints do; damaged and foreign ones are recognised."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

EXPERIMENTS = Path(__file__).parents[1] / "experiments"
if str(EXPERIMENTS) not in sys.path:
    sys.path.insert(0, str(EXPERIMENTS))

from random_checkpoint import TEAM, discrete, experiment_of, make_module, save_run, scaled, single_run  # noqa: E402

from safe_inspect.environments import TeamEnvironment  # noqa: E402
from safe_inspect.errors import CheckpointError, SafeInspectError  # noqa: E402
from safe_inspect.evaluation import rollout  # noqa: E402
from safe_inspect.evaluation.onnx_policy import load_onnx  # noqa: E402
from safe_inspect.evaluation.policy_file import seal  # noqa: E402

onnx = pytest.importorskip("onnx")


def export(folder, experiment):
    """Return a checkpoint of a single agent and its file."""
    from safe_inspect.experiments.export import export_policy

    checkpoint = single_run(folder / "run", experiment)
    return checkpoint, export_policy(checkpoint, folder / "p.onnx").path


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """Return the checkpoint and the file of the tasks by their names, and the tasks."""
    made = {}
    for name, change in (("plain", None), ("scaled", scaled), ("discrete", discrete)):
        experiment = experiment_of(change)
        made[name] = (experiment, *export(tmp_path_factory.mktemp(name), experiment))
    return made


@pytest.mark.parametrize("name", ["plain", "scaled", "discrete"])
@pytest.mark.parametrize("sampled", [False, True])
def test_a_rollout_is_that_of_the_checkpoint(exported, name, sampled):
    from safe_inspect.experiments.modules.policy import trained_policy

    experiment, checkpoint, file = exported[name]
    policy = load_onnx(file, sampled, seed=5)
    theirs = rollout(
        experiment.spec, trained_policy(checkpoint, sampled=sampled, seed=5), 12, seed=2, num_envs=5, record=12
    )
    ours = rollout(policy.prepare(experiment.spec), policy, 12, seed=2, num_envs=12, record=12)
    np.testing.assert_array_equal(ours.status, theirs.status)
    np.testing.assert_array_equal(ours.length, theirs.length)
    np.testing.assert_array_equal(ours.inspected_fraction, theirs.inspected_fraction)
    np.testing.assert_allclose(ours.delta_v, theirs.delta_v, rtol=1e-4)
    assert len(set(ours.length)) > 1
    for one, other in zip(ours.trajectories, theirs.trajectories, strict=True):
        np.testing.assert_allclose(one.control, other.control, atol=2e-4)
        np.testing.assert_allclose(one.position[0], other.position[0], rtol=1e-15)  # the same beginning


def test_the_episodes_do_not_depend_on_the_size_of_the_batch(exported):
    experiment, _, file = exported["plain"]
    policy = load_onnx(file, sampled=True)
    spec = policy.prepare(experiment.spec)
    whole, parts = (rollout(spec, policy, 23, seed=1, num_envs=count, record=23) for count in (23, 7))
    for one, other in zip(whole.trajectories, parts.trajectories, strict=True):
        np.testing.assert_array_equal(one.position, other.position)


def test_a_row_does_not_depend_on_its_neighbours(exported):
    experiment, _, file = exported["plain"]
    policy = load_onnx(file)
    readings = TeamEnvironment(policy.prepare(experiment.spec), 300).reset()[0][:, 0]
    whole = policy.outputs(readings)
    for rows in (1, 2, 15, 16, 17, 100):
        for part, all_of_them in zip(policy.outputs(readings[40 : 40 + rows]), whole, strict=True):
            np.testing.assert_array_equal(part, all_of_them[40 : 40 + rows])
    assert policy(readings[:0]).shape == (0, 3)
    with pytest.raises(ValueError, match=r"shape \(R, 11\), got \(300, 10\)"):
        policy(readings[:, :-1])


def test_a_team_is_flown_by_its_files(tmp_path):
    from safe_inspect.experiments.export import export_policy
    from safe_inspect.experiments.modules.policy import trained_policy

    experiment = experiment_of(path=TEAM, overrides=("horizon=30",))
    agents = experiment.spec.agents
    modules = {agent.policy: make_module(agent, seed=index) for index, agent in enumerate(agents)}
    checkpoint = save_run(tmp_path / "run", experiment, modules)
    spec, files = experiment.spec, {}
    for agent in agents:
        path = tmp_path / f"{agent.name}.onnx"
        export_policy(checkpoint, path, agent.policy)
        files[agent.name] = load_onnx(path, sampled=True, seed=3)
        spec = files[agent.name].prepare(spec, [agent.name])
    loaded = {agent.name: trained_policy(checkpoint, agent.policy, sampled=True, seed=3) for agent in agents}
    theirs = rollout(experiment.spec, loaded, 3, seed=2, record=3)
    ours = rollout(spec, files, 3, seed=2, record=3)
    np.testing.assert_array_equal(ours.status, theirs.status)
    for one, other in zip(ours.trajectories, theirs.trajectories, strict=True):
        np.testing.assert_allclose(one.control, other.control, atol=2e-4)
    assert not np.allclose(ours.trajectories[0].control[:, 0], ours.trajectories[0].control[:, 1], atol=0.1)


def test_the_file_says_in_which_task_it_flies(exported):
    experiment, _, file = exported["scaled"]
    policy = load_onnx(file)
    assert policy.info.configuration == experiment.resolved
    assert policy.task().agents == experiment.spec.agents
    flown = rollout(policy.prepare(policy.task(["horizon=5"])), policy, 2)
    assert flown.length.tolist() == [5, 5]


def test_only_the_glues_of_the_prepared_task_are_others(exported):
    experiment, _, file = exported["scaled"]
    raw = load_onnx(file).prepare(experiment.spec)
    for one, other in zip(raw.agents, experiment.spec.agents, strict=True):
        assert (one.rewards, one.dones, one.parts) == (other.rewards, other.dones, other.parts)
    assert raw.reset is experiment.spec.reset
    assert raw.simulator is experiment.spec.simulator


class TestRefusals:
    @pytest.mark.parametrize(
        ("change", "message"),
        [
            (
                lambda agent: agent["glues"].pop(),
                "in the observation of blue0_ctrl, there are 11 elements in training and 10 in the task",
            ),
            (
                lambda agent: agent["glues"].insert(1, agent["glues"].pop(2)),
                r"element 0 is Sensor_Position.x \[m\] in training and Sensor_Velocity.v_x \[m/s\] in the task",
            ),
            (
                lambda agent: agent["glues"][0]["wrapped"].reverse(),
                r"in the action of blue0_ctrl, element 0 is X Thrust \[N\] in training and Z Thrust",
            ),
        ],
    )
    def test_another_task(self, exported, change, message):
        with pytest.raises(CheckpointError, match=message):
            load_onnx(exported["plain"][2]).prepare(experiment_of(change).spec)

    def test_an_agent_that_is_not_there(self, exported):
        experiment, _, file = exported["plain"]
        with pytest.raises(SafeInspectError, match=r"no controlled agent is named 'blue_ctrl'; did you mean"):
            load_onnx(file).prepare(experiment.spec, ["blue_ctrl"])

    def test_a_task_that_was_not_prepared(self, exported):
        experiment, _, file = exported["discrete"]
        with pytest.raises(SafeInspectError, match=r"use `policy.prepare\(task\)`"):
            rollout(experiment.spec, load_onnx(file), 1)

    def test_rows_that_are_not_known(self, exported):
        with pytest.raises(ValueError, match="needs a call of `begin` with its rows"):
            load_onnx(exported["plain"][2], sampled=True)(np.zeros((2, 11), dtype=np.float32))

    def test_a_missing_file(self, tmp_path):
        with pytest.raises(
            CheckpointError, match=r"p.onnx: there is no such file; write one with `safe-inspect export`"
        ):
            load_onnx(tmp_path / "p.onnx")
        with pytest.raises(CheckpointError, match="cannot be read"):
            load_onnx(tmp_path)

    @pytest.mark.parametrize("where", [0.0, 0.02, 0.3, 0.5, 0.99])
    def test_one_wrong_bit(self, exported, tmp_path, where):
        content = bytearray(exported["plain"][2].read_bytes())
        content[int(where * len(content))] ^= 16
        (tmp_path / "p.onnx").write_bytes(content)
        with pytest.raises(CheckpointError, match=r"damaged|contains no policy") as raised:
            load_onnx(tmp_path / "p.onnx")
        assert "\n" not in str(raised.value)

    @pytest.mark.parametrize("content", [b"", b"no model", None])
    def test_a_file_that_is_cut_or_none(self, exported, tmp_path, content):
        path = tmp_path / "p.onnx"
        path.write_bytes(exported["plain"][2].read_bytes()[:2000] if content is None else content)
        with pytest.raises(CheckpointError, match=r"p.onnx: the file (is damaged|contains no policy)"):
            load_onnx(path)

    def test_models_of_others_and_changed_ones(self, exported, tmp_path):
        model = onnx.load(exported["plain"][2])
        path = tmp_path / "p.onnx"
        model.metadata_props[1].value = "99"
        path.write_bytes(model.SerializeToString())
        with pytest.raises(CheckpointError, match="the file was damaged or changed after the export"):
            load_onnx(path)
        path.write_bytes(seal(model.SerializeToString()))
        with pytest.raises(CheckpointError, match=r"written by safe_inspect .*export the checkpoint again"):
            load_onnx(path)
        model.metadata_props[1].value = "1"
        for key in ("observation", "action"):
            entry = next(item for item in model.metadata_props if item.key == key)
            elements = json.loads(entry.value)
            for damaged in ([{}], [element | {"a later key": 1} for element in elements]):
                entry.value = json.dumps(damaged)
                path.write_bytes(seal(model.SerializeToString()))
                with pytest.raises(CheckpointError, match="metadata are damaged"):
                    load_onnx(path)
            entry.value = json.dumps(elements)
        del model.metadata_props[:]
        path.write_bytes(model.SerializeToString())
        with pytest.raises(CheckpointError, match="contains no policy of this package"):
            load_onnx(path)

    def test_a_missing_package_is_named_with_its_extra(self, exported, monkeypatch):
        monkeypatch.setitem(sys.modules, "onnxruntime", None)
        with pytest.raises(
            SafeInspectError, match=r"onnxruntime, which is not installed; pip install 'safe_inspect\[onnx\]'"
        ):
            load_onnx(exported["plain"][2])


@pytest.mark.slow
def test_a_file_is_flown_without_ray_and_torch(exported):
    code = (
        "import sys, json; from safe_inspect.evaluation import rollout\n"
        "from safe_inspect.evaluation.onnx_policy import load_onnx\n"
        f"policy = load_onnx({str(exported['plain'][2])!r})\n"
        "rollout(policy.prepare(policy.task()), policy, 1)\n"
        "print(json.dumps([name for name in ('ray', 'torch', 'onnx') if name in sys.modules]))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=True)
    assert json.loads(done.stdout.splitlines()[-1]) == []


def test_onnxruntime_writes_nothing_into_the_home_folder(exported, tmp_path):
    environment = {key: value for key, value in os.environ.items() if key not in ("ORT_DISABLE_TELEMETRY", "CI")}
    environment |= {"HOME": str(tmp_path), "XDG_CACHE_HOME": str(tmp_path / "cache")}
    files = {}
    for name, code in (("import", "import onnxruntime"), ("load", LOAD.format(str(exported["plain"][2])))):
        subprocess.run([sys.executable, "-c", code], env=environment, timeout=120, check=True)
        files[name] = [path for path in tmp_path.rglob("*") if path.is_file()]
        shutil.rmtree(tmp_path)
        tmp_path.mkdir()
    if not files["import"]:
        pytest.skip("this release of onnxruntime has no telemetry here")
    assert files["load"] == []


LOAD = "from safe_inspect.evaluation.onnx_policy import load_onnx\nload_onnx({!r})"


def example():
    """Return the program in the documentation that runs a file without this package."""
    text = (Path(__file__).parents[2] / "docs" / "export.md").read_text(encoding="utf-8")
    return next(code for part in text.split("```python\n")[1:] if "onnxruntime" in (code := part.partition("```")[0]))


def test_the_documented_program_runs_a_file_without_this_package(exported, tmp_path):
    (tmp_path / "policy.onnx").write_bytes(exported["plain"][2].read_bytes())
    code = f"{example()}\nimport sys\nassert 'safe_inspect' not in sys.modules"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "Sensor_Position.x [m]" in done.stdout
    assert "X Thrust [N]" in done.stdout
