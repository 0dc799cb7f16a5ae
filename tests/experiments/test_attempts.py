"""What an attempt of a training hands to RLlib and to Tune: seeds, checkpoint, names and folders."""

from __future__ import annotations

import io
import json
import os
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from training_values import QUICK

from safe_inspect.errors import CheckpointError
from safe_inspect.experiments.modules.checkpoints import Checkpoint
from safe_inspect.experiments.modules.run_folder import RunFolder
from safe_inspect.experiments.runs import tune_run
from safe_inspect.experiments.runs.training_run import read_settings
from safe_inspect.experiments.runs.tune_run import Monitor, folder_name

pytestmark = pytest.mark.ray

STOP = {"stop": {"training_iteration": 3}, "checkpoint_frequency": 4}
SEARCH = {**QUICK, "lr": {"grid_search": [0.1, 0.2]}}


@pytest.mark.parametrize(("seed", "number", "expected"), [(5, 0, 5), (5, 2, 20_005), (None, 2, None)])
@pytest.mark.parametrize("single", [True, False])
def test_each_attempt_has_seeds_of_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, seed: int | None, number: int, expected: int | None, single: bool
) -> None:
    told: list[Any] = []

    def environments(experiment: Any, settings: Any, **more: Any) -> str:
        told.append((experiment, settings, more))
        return "environments"

    monkeypatch.setattr(tune_run, "environment_settings", environments)
    monkeypatch.setattr(tune_run, "experiment_of", lambda *given: ("of a trial", *given))
    monkeypatch.setattr(tune_run, "build_config", lambda *given: told.append(given) or SimpleNamespace(seed=seed))
    folder, trial = RunFolder(tmp_path), SimpleNamespace(name="trial_00001", rllib=SimpleNamespace(settings="lr"))
    run: Any = SimpleNamespace(experiment="whole", maker="x:y")
    settings: Any = SimpleNamespace(single=single, policies="policies")
    if not single:  # the attempts of a trial are counted by itself
        own = folder.trials / trial.name
        own.mkdir(parents=True)
        (own / "run.json").write_text(json.dumps({"digest": "", "configuration": {}, "attempts": [{}] * number}))
    given = number if single else 77
    found = tune_run._config(run, settings, folder, given, None, trial)  # type: ignore[arg-type]
    assert found.seed == expected
    more = {"attempt": number, "maker": "x:y", "failure_file": str(tmp_path / "failure.json")}
    experiment = "whole" if single else ("of a trial", "whole", trial)
    assert told == [(experiment, "lr", more), (trial.rllib, "environments", "policies")]
    told.clear()
    start = Checkpoint(tmp_path / "c", 6, 6000, 12.5, "d")
    tune_run._config(run, settings, folder, given, start, trial)  # type: ignore[arg-type]
    assert told[0][2] == {**more, "continue_from": {"path": str(tmp_path / "c"), "iteration": 6, "seconds": 12.5}}


@pytest.fixture
def tuner(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Return what is asked of Tune."""
    asked: list[Any] = []

    class Tuner:
        def __init__(self, *given: Any, **more: Any) -> None:
            asked.append((*given, more))

        @classmethod
        def restore(cls, *given: Any, **more: Any) -> str:
            asked.append((*given, more))
            return "restored"

    monkeypatch.setattr(tune_run.tune, "Tuner", Tuner)
    monkeypatch.setattr(tune_run.tune_objects, "search_space", lambda configs: ("space", *configs))
    for name in ("TUNE_DISABLE_STRICT_METRIC_CHECKING", "TUNE_GLOBAL_CHECKPOINT_S"):
        monkeypatch.setenv(name, "")
        monkeypatch.delenv(name)
    return asked


@pytest.mark.parametrize("resumed", [False, True])
def test_one_training_is_a_new_experiment_of_tune_for_each_attempt(tuner: Any, tmp_path: Path, resumed: bool) -> None:
    settings = read_settings(QUICK, STOP, {})
    monitor = Monitor(RunFolder(tmp_path), {}, io.StringIO(), "")
    tune_run._tuner(["only"], settings, monitor, 2, resumed)  # type: ignore[list-item]
    ((algorithm, more),) = tuner
    assert (algorithm, more["param_space"]) == ("PPO", "only")
    run = more["run_config"]
    assert (run.name, run.storage_path) == ("002", str(tmp_path / "tune"))
    assert run.stop is monitor
    assert run.callbacks == [monitor]
    assert run.checkpoint_config.checkpoint_frequency == 4
    assert run.checkpoint_config.checkpoint_score_order == "max"
    assert more["tune_config"].num_samples == 1
    assert not more["tune_config"].reuse_actors
    assert more["tune_config"].trial_dirname_creator is folder_name
    assert os.environ["TUNE_DISABLE_STRICT_METRIC_CHECKING"] == "1"
    assert "TUNE_GLOBAL_CHECKPOINT_S" not in os.environ


def test_a_search_is_one_experiment_of_tune_that_goes_on(tuner: Any, tmp_path: Path) -> None:
    settings, folder = read_settings(SEARCH, STOP, {}), RunFolder(tmp_path)
    monitor = Monitor(folder, {}, io.StringIO(), "", single=False)
    tune_run._tuner(["one", "two"], settings, monitor, 2, False)  # type: ignore[list-item]
    ((algorithm, more),) = tuner
    assert (algorithm, more["param_space"]) == ("PPO", ("space", "one", "two"))
    assert (more["run_config"].name, more["run_config"].storage_path) == ("trials", str(tmp_path))
    assert os.environ["TUNE_GLOBAL_CHECKPOINT_S"] == "0.2"
    tuner.clear()
    with pytest.raises(CheckpointError):
        tune_run._tuner(["one", "two"], settings, monitor, 2, True)  # type: ignore[list-item]
    assert not tuner
    folder.trials.mkdir()
    (folder.trials / "tuner.pkl").write_text("")
    assert tune_run._tuner(["one", "two"], settings, monitor, 2, True) == "restored"  # type: ignore[list-item, comparison-overlap]
    assert tuner == [(str(folder.trials), {
        "trainable": "PPO", "resume_unfinished": True, "resume_errored": True, "param_space": ("space", "one", "two"),
    })]  # fmt: skip
