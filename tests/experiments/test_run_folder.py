"""The folder of a run: newly made, recorded, guarded against another configuration."""

from __future__ import annotations

import io
import json
import subprocess
import sys

import pytest
from training_values import MAKER

from safe_inspect.errors import CheckpointError, OutputError
from safe_inspect.evaluation.task import differences
from safe_inspect.experiments.modules.run_folder import RunFolder, digest, learning_configuration
from safe_inspect.experiments.runs.train import train
from safe_inspect.experiments.runs.training_run import TrainingRun
from safe_inspect.outputs import exclusive

CONFIGURATION = {"experiment": {"radius": 10.0, "points": [1, 2]}, "rllib_configs": {"lr": 1e-4}}


def record(folder, configuration=None):
    folder.write_record(text="a: 1\n", seed=7, configuration=configuration or CONFIGURATION)


def test_two_runs_of_one_second_have_two_folders(tmp_path):
    first, second = (RunFolder.create(tmp_path / "out", "My run/1") for _ in range(2))
    assert first.path != second.path
    assert first.path.parent == tmp_path / "out"
    assert first.path.name.startswith("My-run-1_2")


@pytest.mark.parametrize("output", ["/proc/none/here", "file/below"])
def test_a_folder_that_cannot_be_written_is_one_message(tmp_path, monkeypatch, output):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match=r"cannot be written .* --output"):
        RunFolder.create(output, "x")


def test_the_record_says_what_was_run(tmp_path):
    folder = RunFolder.create(tmp_path, "x")
    record(folder)
    assert folder.add_attempt(["safe-inspect", "train", "a b.yml"]) == 0
    assert folder.add_attempt([], "checkpoint", 12) == 1
    found = json.loads(folder.record.read_text())
    assert found["seed"] == 7
    assert found["safe_inspect"]
    assert "git_commit" in found
    assert found["attempts"][0]["command"] == "safe-inspect train 'a b.yml'"
    assert found["attempts"][1]["iteration"] == 12
    assert folder.configuration.read_text() == "a: 1\n"


def test_another_configuration_is_refused_with_the_difference(tmp_path):
    folder = RunFolder.create(tmp_path, "x")
    record(folder)
    folder.check_configuration(json.loads(json.dumps(CONFIGURATION)))
    other = {"experiment": {"radius": 12.0, "points": [1, 3]}, "rllib_configs": {}}
    with pytest.raises(CheckpointError) as caught:
        folder.check_configuration(other)
    message = str(caught.value)
    assert "experiment.radius: 10.0 in the run, 12.0 now" in message
    assert "experiment.points[1]: 2 in the run, 3 now" in message
    assert "rllib_configs.lr: 0.0001 in the run, nothing now" in message


def test_only_the_place_and_the_length_of_computing_may_change():
    def learning(radius=1, stop=10, **more):
        task = {"tune_config": {"stop": stop}, "ray_config": {"num_cpus": stop}, "env_config": {"radius": radius}}
        experiment = {"config": {"config": task}}
        return digest(learning_configuration(experiment, {"lr": 1.0, "num_env_runners": 0, **more}))

    base = learning()
    assert learning(stop=20, num_env_runners=8, num_gpus_per_learner=1, torch_num_threads=4) == base
    assert learning(lr=2.0) != base
    assert learning(radius=2) != base


def test_a_folder_that_is_no_run_is_refused(tmp_path):
    with pytest.raises(CheckpointError, match="not the folder of a training run"):
        RunFolder.open(tmp_path)
    (tmp_path / "run.json").write_text('{"seed": 1')
    with pytest.raises(CheckpointError, match="damaged"):
        RunFolder.open(tmp_path)


def test_two_processes_cannot_train_in_one_folder(tmp_path):
    folder = RunFolder.create(tmp_path, "x")
    code = (
        "import sys; from pathlib import Path\n"
        "from safe_inspect.outputs import exclusive\n"
        "with exclusive(Path(sys.argv[1]), 'training in'): pass"
    )
    command = [sys.executable, "-c", code, str(folder.path)]
    with exclusive(folder.path, "training in"):
        other = subprocess.run(command, capture_output=True, text=True, check=False)
    assert "OutputError" in other.stderr
    assert "another process is training" in other.stderr
    assert subprocess.run(command, check=False).returncode == 0


def test_the_lists_of_two_lengths_differ():
    assert list(differences({"a": [1]}, {"a": [1, 2]})) == [("a", [1], [1, 2])]


def test_a_run_whose_record_cannot_be_written_leaves_no_folder(tmp_path, monkeypatch):
    def full(*_, **__):
        raise OutputError("run.json: the file cannot be written (No space left on device)")

    monkeypatch.setattr(RunFolder, "write_record", full)
    with pytest.raises(OutputError, match="No space left"):
        train(TrainingRun({}, output=tmp_path, maker=MAKER), io.StringIO())
    assert not list(tmp_path.iterdir())
