"""`train` around a made-up Tune: folders, checkpoints to continue from, reached limits, errors and what they leave."""

from __future__ import annotations

import io
import json
import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from training_values import MAKER, QUICK

from safe_inspect.errors import CheckpointError, ConfigError, OutputError, SafeInspectError
from safe_inspect.experiments.modules.checkpoints import Checkpoint
from safe_inspect.experiments.modules.run_folder import RunFolder
from safe_inspect.experiments.runs import train as module
from safe_inspect.experiments.runs import tune_run
from safe_inspect.experiments.runs.train import TrainingResult, train
from safe_inspect.experiments.runs.training_run import TrainingRun

pytestmark = pytest.mark.ray


class Tune:
    """A stand-in for a training by Tune: records its arguments, and leaves a checkpoint or an error."""

    def __init__(self) -> None:
        self.given: list[Any] = []
        self.saves: tuple[int, ...] = (3,)
        self.raises: BaseException | None = None
        self.progress = False
        self.last: dict[str, float] = {
            "training_iteration": 3.0, "num_env_steps_sampled_lifetime": 3000.0, "a": 0.5, "b": math.nan,
        }  # fmt: skip

    def __call__(
        self, run: Any, settings: Any, folder: RunFolder, digest: str, start: Any, stream: Any, processors: float
    ) -> Any:
        assert processors == 3.0
        self.given.append((folder.path, start))
        for iteration in self.saves:
            checkpoint = folder.tune / "000" / "trial" / f"checkpoint_{iteration:06d}"
            checkpoint.mkdir(parents=True, exist_ok=True)
            (checkpoint / "data").write_text("whole")
            Checkpoint(checkpoint, iteration, 1000 * iteration, 10.0 * iteration, digest).seal()
        if self.progress:
            folder.progress.write_text("iteration\n1\n")
        if self.raises is not None:
            raise self.raises
        return SimpleNamespace(last=self.last, interrupted=True, best="best")


@pytest.fixture
def tune(monkeypatch: pytest.MonkeyPatch) -> Tune:
    found = Tune()
    monkeypatch.setattr(module.cluster, "set_environment", lambda: None)
    monkeypatch.setattr(tune_run, "check", lambda run, settings: 3.0)
    monkeypatch.setattr(tune_run, "run_tune", found)
    return found


def run_of(folder: Path, *, stop: Any = None, resume: Path | None = None, **rllib: Any) -> TrainingRun:
    stop = {"training_iteration": 9} if stop is None else stop
    return TrainingRun(
        {"x": 1}, {**QUICK, **rllib}, {"stop": stop}, text="x: 1\n", name="some", output=folder / "out", resume=resume,
        maker=MAKER,
    )  # fmt: skip


def flown(run: TrainingRun) -> tuple[TrainingResult, str]:
    """Return the result of a training, and what it printed."""
    stream = io.StringIO()
    return train(run, stream), stream.getvalue()


def runs_in(folder: Path) -> list[Path]:
    return sorted((folder / "out").glob("*"))


def test_a_new_training_has_a_folder_and_a_result(tune: Tune, tmp_path: Path) -> None:
    found, printed = flown(run_of(tmp_path, seed=4))
    (folder,) = runs_in(tmp_path)
    assert folder.name.startswith("some_")
    assert tune.given == [(folder, None)]
    assert (folder / "experiment.resolved.yml").read_text() == "x: 1\n"
    assert json.loads((folder / "run.json").read_text())["seed"] == 4
    assert (found.folder, found.iteration, found.steps, found.interrupted, found.best) == (
        folder,
        3,
        3000,
        True,
        "best",
    )
    assert found.checkpoint == folder / "tune" / "000" / "trial" / "checkpoint_000003"
    assert found.metrics == {"training_iteration": 3.0, "num_env_steps_sampled_lifetime": 3000.0, "a": 0.5}
    assert 0.0 <= found.seconds < 60.0
    assert (found.trials, printed) == ((), "")
    tune.last, tune.saves = {}, ()
    nothing, _ = flown(run_of(tmp_path / "other"))
    assert (nothing.iteration, nothing.steps, nothing.checkpoint, dict(nothing.metrics)) == (0, 0, None, {})


def test_a_training_goes_on_from_its_newest_good_checkpoint(tune: Tune, tmp_path: Path) -> None:
    tune.saves = (3, 5)
    folder = flown(run_of(tmp_path))[0].folder
    tune.saves, tune.last = (), {}
    found, printed = flown(run_of(tmp_path, resume=folder))
    path, start = tune.given[-1]
    assert (path, start.iteration, start.steps, start.seconds) == (folder, 5, 5000, 50.0)
    assert (found.iteration, found.steps, found.checkpoint, printed) == (5, 5000, start.path, "")
    (start.path / "data").write_text("damaged")
    _, printed = flown(run_of(tmp_path, resume=folder))
    assert tune.given[-1][1].iteration == 3
    assert printed.startswith("skipped ")
    assert "checkpoint_000005" in printed
    (tune.given[-1][1].path / "data").write_text("damaged")
    with pytest.raises(CheckpointError):
        flown(run_of(tmp_path, resume=folder))
    with pytest.raises(CheckpointError, match="lr"):
        flown(run_of(tmp_path, resume=folder, lr=0.25))
    assert len(tune.given) == 3
    tune.saves = ()
    fresh = flown(run_of(tmp_path / "fresh"))[0].folder
    _, printed = flown(run_of(tmp_path, resume=fresh))
    assert tune.given[-1] == (fresh, None)
    assert printed.startswith(f"{fresh}: ")
    assert len(runs_in(tmp_path)) == len(runs_in(tmp_path / "fresh")) == 1


@pytest.mark.parametrize(
    ("stop", "over"),
    [
        ({"training_iteration": 3}, True), ({"training_iteration": 4}, False),
        ({"num_env_steps_sampled_lifetime": 3000}, True), ({"num_env_steps_sampled_lifetime": 3001}, False),
        ({"time_total_s": 30.0}, True), ({"time_total_s": 30.1}, False),
        ({"training_iteration": 9, "time_total_s": 20.0}, True), ({"env_runners/episode_return_mean": -5.0}, False),
    ],
)  # fmt: skip
def test_a_training_that_has_reached_a_limit_does_not_go_on(
    tune: Tune, tmp_path: Path, stop: dict[str, float], over: bool
) -> None:
    folder = flown(run_of(tmp_path))[0].folder
    found, printed = flown(run_of(tmp_path, resume=folder, stop=stop))
    assert len(tune.given) == (1 if over else 2)
    assert (found.iteration, found.steps) == (3, 3000)
    if over:
        assert found.checkpoint == folder / "tune" / "000" / "trial" / "checkpoint_000003"
        assert (found.seconds, dict(found.metrics), found.interrupted, found.best) == (0.0, {}, False, None)
        assert "`stop`" in printed


def test_a_mistake_leaves_nothing_of_a_new_training(tune: Tune, tmp_path: Path) -> None:
    folder = flown(run_of(tmp_path))[0].folder
    tune.raises = ConfigError([])
    for run, left in ((run_of(tmp_path / "new"), 0), (run_of(tmp_path, resume=folder), 1)):
        with pytest.raises(ConfigError):
            flown(run)
        assert len(runs_in(run.output.parent)) == left
    tune.raises = SafeInspectError("of a plugin")
    with pytest.raises(SafeInspectError, match=r"^of a plugin$"):
        flown(run_of(tmp_path / "new"))
    assert len(runs_in(tmp_path / "new")) == 1


@pytest.mark.parametrize(
    ("saves", "progress", "left", "noted"),
    [((3,), True, True, True), ((), True, True, False), ((), False, False, False)],
)
def test_a_stopped_training_keeps_what_it_has(
    tune: Tune, tmp_path: Path, saves: Any, progress: bool, left: bool, noted: bool
) -> None:
    tune.saves, tune.progress, tune.raises = saves, progress, KeyboardInterrupt()
    with pytest.raises(KeyboardInterrupt) as caught:
        flown(run_of(tmp_path))
    assert bool(runs_in(tmp_path)) == left
    notes = getattr(caught.value, "__notes__", [])
    assert len(notes) == noted
    if noted:
        assert notes[0].endswith(f"--resume {runs_in(tmp_path)[0]}")


def test_a_run_that_is_resumed_is_never_removed(tune: Tune, tmp_path: Path) -> None:
    tune.saves = ()
    folder = flown(run_of(tmp_path))[0].folder
    tune.raises = KeyboardInterrupt()
    with pytest.raises(KeyboardInterrupt):
        flown(run_of(tmp_path, resume=folder))
    assert folder.is_dir()


@pytest.mark.parametrize("saves", [(3,), ()], ids=["saved", "not saved"])
@pytest.mark.parametrize("why", ["full", "died", "other"])
def test_an_error_of_ray_says_how_to_go_on(
    tune: Tune, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, saves: Any, why: str
) -> None:
    tune.saves, tune.raises = saves, RuntimeError("of Ray")
    monkeypatch.setattr(module, "is_full", lambda folder: why == "full")
    monkeypatch.setattr(tune_run, "process_died", lambda error: why == "died")
    kind = {"full": OutputError, "died": SafeInspectError, "other": RuntimeError}[why]
    with pytest.raises(kind) as caught:
        flown(run_of(tmp_path))
    (folder,) = runs_in(tmp_path)
    assert type(caught.value) is kind
    notes = getattr(caught.value, "__notes__", [])
    assert len(notes) == (why == "other" and bool(saves))
    told = "\n".join([str(caught.value), *notes])
    assert (f"--resume {folder}" in told) == bool(saves)
    if why != "other":
        assert told.startswith(f"{folder}: ")
        assert ("start again" in told) == (not saves)


def test_a_search_is_as_long_as_its_longest_trial(tune: Tune, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    read: list[RunFolder] = []
    trials = tuple(SimpleNamespace(iteration=iteration, steps=steps) for iteration, steps in ((4, 40), (7, 60), (2, 1)))
    monkeypatch.setattr(module, "read_trials", lambda folder: read.append(folder) or trials)
    tune.saves = ()
    found, _ = flown(run_of(tmp_path, lr={"grid_search": [0.1, 0.2]}))
    (folder,) = runs_in(tmp_path)
    assert [one.path for one in read] == [folder]
    assert sorted(path.name for path in (folder / "trials").iterdir()) == ["trial_00000", "trial_00001"]
    assert (found.iteration, found.steps, found.checkpoint, found.trials) == (7, 101, None, trials)
    checked: list[Any] = []
    monkeypatch.setattr(module, "check_trials", lambda folder, settings: checked.append(folder))
    again, _ = flown(run_of(tmp_path, lr={"grid_search": [0.1, 0.2]}, resume=folder))
    assert (checked[0].path, tune.given[-1], again.iteration) == (folder, (folder, None), 7)

    def fails(*given: Any) -> None:
        raise OutputError("full")

    monkeypatch.setattr(module, "write_trial", fails)
    with pytest.raises(OutputError, match=r"^full$"):
        flown(run_of(tmp_path / "full", lr={"grid_search": [0.1, 0.2]}))
    assert not runs_in(tmp_path / "full")


def test_without_a_stream_it_is_told_on_standard_error(
    tune: Tune, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    tune.saves = ()
    folder = train(run_of(tmp_path)).folder
    assert capsys.readouterr().err == ""
    train(run_of(tmp_path, resume=folder))
    assert capsys.readouterr().err.startswith(f"{folder}: ")


def test_what_the_loaded_rllib_refuses_leaves_nothing(
    tune: Tune, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    checked: list[Any] = []

    def check(run: Any, settings: Any) -> None:
        checked.append((run, settings.single))
        raise ConfigError([])

    monkeypatch.setattr(tune_run, "check", check)
    run = run_of(tmp_path)
    with pytest.raises(ConfigError):
        flown(run)
    assert checked == [(run, True)]
    assert not (tmp_path / "out").exists()


def test_mistakes_are_told_before_anything_is_written(tune: Tune, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="lrr"):
        flown(run_of(tmp_path, lrr=0.1))
    assert not (tmp_path / "out").exists()
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError):
        flown(run_of(tmp_path / "file"))
    assert not tune.given
