"""Whole trainings on one Ray: what is logged, kept, evaluated and raised."""

from __future__ import annotations

import errno
import io
import json
import math
import os
from pathlib import Path

import numpy as np
import pytest
from training_values import MAKER, QUICK

from safe_inspect.errors import CheckpointError, ConfigError, OutputError, PluginValueError, SafeInspectError
from safe_inspect.experiments.modules.checkpoints import MODULES, SEAL, Checkpoint, find_newest
from safe_inspect.experiments.runs.progress import TrainingLog, read_progress
from safe_inspect.experiments.runs.train import train
from safe_inspect.experiments.runs.training_run import TrainingRun
from safe_inspect.experiments.settings.search import sample_seed

pytestmark = pytest.mark.ray


def home_results():
    """Return the contents of the folder in which Ray saves results by default."""
    return sorted((Path.home() / "ray_results").glob("*"))


@pytest.fixture(scope="module")
def trained(ray_session, tmp_path_factory):
    """Train two iterations, once for the tests below."""
    before = home_results()
    stream = io.StringIO()
    run = TrainingRun(
        {"kind": "dummy"},
        rllib={**QUICK, "evaluation_interval": 2, "evaluation_duration": 8},
        tune={"stop": {"training_iteration": 2}, "checkpoint_frequency": 1},
        text="kind: dummy\n",
        name="dummy",
        output=tmp_path_factory.mktemp("out"),
        maker=MAKER,
    )
    result = train(run, stream)
    assert home_results() == before  # nothing is left outside the run folder
    return result, stream.getvalue(), run


def test_a_training_ends_at_its_limit(trained):
    result, _, _ = trained
    assert result.iteration == 2
    assert 1024 <= result.steps <= 1024 + 2 * 16
    assert not result.interrupted
    assert math.isfinite(result.metrics["env_runners/episode_return_mean"])


def lines_of(text):
    """Return what was printed, without what a slow machine is given while it waits."""
    return [line for line in text.splitlines() if not line.startswith(("working on ", "compiling, "))]


def test_its_progress_is_one_line_for_each_iteration(trained):
    _, printed, _ = trained
    first, *lines = lines_of(printed)
    assert "the training starts; code that is not compiled yet on this installation is compiled first" in first
    assert first.endswith("; Ray takes some seconds to start")
    assert [line.split("  steps")[0] for line in lines] == ["iteration    1/2", "iteration    2/2"]
    assert all("success" in line and "m/s  left 0:" in line for line in lines)


def test_the_run_folder_is_complete(trained):
    result, _, _ = trained
    names = {path.name for path in result.folder.iterdir()}
    assert {"experiment.resolved.yml", "run.json", "progress.csv", "result.json", "tensorboard", "tune"} <= names
    record = json.loads((result.folder / "run.json").read_text())
    assert record["configuration"]["experiment"] == {"kind": "dummy"}
    assert len(record["attempts"]) == 1
    assert list((result.folder / "tensorboard").glob("events.out.tfevents.*"))


def test_the_learning_curve_holds_the_task(trained):
    result, _, _ = trained
    rows = read_progress(result.folder / "progress.csv")
    assert [row["iteration"] for row in rows] == [1, 2]
    last = rows[-1]
    assert last["steps"] == result.steps
    assert 0.0 <= last["success_rate"] <= 1.0
    assert last["inspected_fraction"] == pytest.approx(last["inspected_count"] / 99.0)
    assert last["return_mean"] == pytest.approx(last["reward/near"] + last["reward/cost"], abs=1e-4)
    assert last["delta_v"] == pytest.approx(-100.0 * last["reward/cost"], rel=1e-6)
    assert math.isfinite(last["evaluation_return_mean"])
    assert math.isfinite(last["evaluation_success_rate"])
    assert math.isnan(rows[0]["evaluation_return_mean"])


def test_checkpoints_are_sealed_and_hold_the_policy(trained):
    result, _, _ = trained
    newest = find_newest(result.folder / "tune")[0]
    assert newest.path == result.checkpoint
    assert (newest.iteration, newest.steps) == (2, result.steps)
    from ray.rllib.core.rl_module.rl_module import RLModule

    from safe_inspect.experiments.modules.policy import trained_policy

    theirs = RLModule.from_checkpoint(result.checkpoint / MODULES / "default_policy").get_state()
    module = trained_policy(result.checkpoint).module
    assert module.get_state().keys() == theirs.keys()
    for name, value in module.get_state().items():
        np.testing.assert_array_equal(value, theirs[name])
    hidden = [parameter.shape for parameter in module.parameters() if parameter.ndim == 2 and parameter.shape[1] == 11]
    assert hidden == [(16, 11), (16, 11)]  # a net for the policy, and one for the value


def resumed(run, result, **changes):
    fields = {**vars(run), "resume": result.folder, **changes}
    return TrainingRun(**fields)


@pytest.mark.slow
def test_a_finished_run_continues_with_a_later_limit(trained):
    result, _, run = trained
    stream = io.StringIO()
    more = train(resumed(run, result, tune={"stop": {"training_iteration": 3}}), stream)
    first, second = lines_of(stream.getvalue())
    assert "the training continues after iteration 2" in first
    assert second.startswith("iteration    3/3")
    assert more.iteration == 3
    assert more.folder == result.folder
    assert more.steps > result.steps
    assert [row["iteration"] for row in read_progress(result.folder / "progress.csv")] == [1, 2, 3]
    record = json.loads((result.folder / "run.json").read_text())
    assert record["attempts"][1]["iteration"] == 2
    assert find_newest(result.folder / "tune")[0].iteration == 3
    stream = io.StringIO()
    again = train(resumed(run, result), stream)  # its limit is two iterations
    assert again.iteration == 3
    text = "the run has reached its limits at iteration 3; raise `stop` to continue, as in training_iteration=6\n"
    assert stream.getvalue() == text


def test_another_configuration_is_not_resumed(trained):
    result, _, run = trained
    with pytest.raises(CheckpointError, match=r"rllib_configs\.gamma: nothing in the run, 0\.5 now"):
        train(resumed(run, result, rllib={**run.rllib, "gamma": 0.5}))


def test_an_output_that_cannot_be_written(quick, maker):
    with pytest.raises(OutputError, match="cannot be written"):
        train(TrainingRun({}, rllib=quick, output="/proc/nowhere", maker=maker))


def test_mistakes_of_all_three_mappings_come_together(tmp_path):
    with pytest.raises(ConfigError) as caught:
        train(TrainingRun({}, rllib={"gama": 1}, tune={"stopp": 1}, ray={"num_cpu": 1}, output=tmp_path))
    assert len(caught.value.problems) == 3
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("runners", [0, pytest.param(1, marks=pytest.mark.long)])
def test_an_error_of_a_plugin_arrives_as_it_was(ray_session, tmp_path, quick, maker, runners):
    run = TrainingRun(
        {"fail_at": 40},
        rllib={**quick, "num_env_runners": runners},
        tune={"stop": {"training_iteration": 5}},
        output=tmp_path,
        maker=maker,
    )
    with pytest.raises(PluginValueError, match="reward `near` returned NaN"):
        train(run, io.StringIO())


@pytest.mark.slow
def test_the_best_checkpoint_is_kept_next_to_the_newest(ray_session, tmp_path):
    score = {"checkpoint_score_attribute": "training_iteration", "checkpoint_score_order": "min", "num_to_keep": 1}
    run = TrainingRun(
        {},
        rllib=QUICK,
        tune={"stop": {"training_iteration": 4}, "checkpoint_frequency": 1, **score},
        output=tmp_path,
        maker=MAKER,
    )
    result = train(run, io.StringIO())
    kept = {Checkpoint.read(path.parent).iteration for path in result.folder.glob(f"tune/*/*/checkpoint_*/{SEAL}")}
    assert kept == {1, 4}
    assert (Checkpoint.read(result.best).iteration, Checkpoint.read(result.checkpoint).iteration) == (1, 4)


@pytest.mark.slow
def test_a_runner_that_is_killed_is_one_message_that_says_how_to_continue(ray_session, tmp_path):
    run = TrainingRun(
        {},
        rllib={**QUICK, "num_env_runners": 1, "callbacks": "killing.Killing"},
        tune={"stop": {"training_iteration": 6}, "checkpoint_frequency": 1},
        output=tmp_path,
        maker=MAKER,
    )
    with pytest.raises(SafeInspectError, match="a process of the training was killed") as caught:
        train(run, io.StringIO())
    (folder,) = tmp_path.iterdir()
    assert str(caught.value).endswith(f"; continue with --resume {folder}")
    assert find_newest(folder)[0].iteration >= 1


@pytest.mark.slow
def test_a_search_trains_each_value_and_can_be_resumed(ray_session, tmp_path, quick, maker):
    stream = io.StringIO()
    search = {"grid_search": [1e-4, 1e-3]}
    run = TrainingRun(
        {"agent_config": [{"policy": {"config": {"lr": search, "seed": 7}}}]},  # as the resolved configuration has it
        rllib={**quick, "lr": search, "seed": 7},
        tune={"stop": {"training_iteration": 2}, "checkpoint_frequency": 1, "num_samples": 2},
        output=tmp_path,
        maker=maker,
    )
    result = train(run, stream)
    names = [f"trial_{number:05d}" for number in range(4)]
    assert {line.split()[0] for line in lines_of(stream.getvalue())[1:]} == set(names)
    assert [trial.folder.name for trial in result.trials] == names
    first, second = sample_seed(7, 0), sample_seed(7, 1)
    values = [(1e-4, first), (1e-3, first), (1e-4, second), (1e-3, second)]
    returns = []
    for trial, (lr, seed) in zip(result.trials, values, strict=True):
        assert trial.parameters == {"lr": lr, "seed": seed}
        rows = read_progress(trial.folder / "progress.csv")
        assert [row["iteration"] for row in rows] == [1, 2]
        last = json.loads((trial.folder / "result.json").read_text().splitlines()[-1])
        assert last["learners/default_policy/default_optimizer_learning_rate"] == pytest.approx(lr)
        assert last["seed"] == seed
        record = json.loads((trial.folder / "run.json").read_text())
        assert record["configuration"]["rllib_configs"]["lr"] == lr
        assert record["configuration"]["experiment"]["agent_config"][0]["policy"]["config"] == {"lr": lr, "seed": seed}
        assert (record["seed"], len(record["attempts"])) == (seed, 1)
        assert find_newest(trial.folder)[0].path == trial.checkpoint
        assert find_newest(trial.folder)[0].digest == record["digest"]
        returns.append(last["env_runners/episode_return_mean"])
    assert len(set(returns)) == 4  # no trial repeats another
    with pytest.raises(CheckpointError, match=r"a search with 4 trials.*\n.*trial_00000  lr 0\.0001, seed 7\n"):
        find_newest(result.folder)
    again = io.StringIO()
    assert train(resumed(run, result), again).trials == result.trials  # they have ended; nothing is trained twice
    assert len(lines_of(again.getvalue())) == 1
    with pytest.raises(CheckpointError, match="has 4 trials, but this experiment requires 6"):
        train(resumed(run, result, tune={**run.tune, "num_samples": 3}), again)


def test_what_does_not_fit_is_refused_and_leaves_no_folder(ray_session, tmp_path, quick, maker):
    run = TrainingRun({}, rllib={**quick, "num_env_runners": 9}, output=tmp_path, maker=maker)
    with pytest.raises(ConfigError, match="needs 10 processors, but Ray has 4"):
        train(run)
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_a_full_disk_is_one_message_that_says_how_to_continue(ray_session, tmp_path, monkeypatch):
    add = TrainingLog.add

    def full(log, flat):
        add(log, flat)
        if flat["training_iteration"] == 3:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(TrainingLog, "add", full)
    monkeypatch.setattr("safe_inspect.experiments.runs.train.is_full", lambda folder: True)
    tune = {"stop": {"training_iteration": 9}, "checkpoint_frequency": 1}
    with pytest.raises(OutputError) as caught:
        train(TrainingRun({}, rllib=QUICK, tune=tune, output=tmp_path, maker=MAKER), io.StringIO())
    (run,) = tmp_path.iterdir()
    wanted = f"{run}: the disk is full (No space left on device); free some space and continue with --resume {run}"
    assert str(caught.value) == wanted
    assert find_newest(run / "tune")[0].iteration == 2
