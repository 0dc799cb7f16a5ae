"""What a run does at Tune's hooks, with made-up trials: logs, seals, ends, results, and errors that it passes on."""

from __future__ import annotations

import copy
import io
import json
import math
import pickle
import signal
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from safe_inspect.errors import CheckpointError, ConfigError, OutputError, PluginValueError, SafeInspectError
from safe_inspect.experiments.modules.checkpoints import Checkpoint
from safe_inspect.experiments.modules.run_folder import RunFolder
from safe_inspect.experiments.runs import progress, trials, tune_run
from safe_inspect.experiments.runs.progress import TrainingLog, read_progress
from safe_inspect.experiments.runs.trials import TrialResult, check_trials, read_trials, trial_table
from safe_inspect.experiments.runs.tune_run import Monitor, monitored
from safe_inspect.experiments.settings.search import Trial

pytestmark = pytest.mark.ray


def result(iteration: int, seed: int = 7, **more: Any) -> dict[str, Any]:
    """Return what RLlib reports of an iteration."""
    return {
        "training_iteration": iteration, "num_env_steps_sampled_lifetime": 1000 * iteration, "time_total_s": 2.5,
        "config": {"env_config": {"seed": seed}, "lr": 9.0}, **more,
    }  # fmt: skip


@pytest.fixture
def called(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Return what logs and lines are made and asked for."""
    found: list[Any] = []

    class Log:
        def __init__(self, *given: Any) -> None:
            found.append(("log", *given))
            self._name = Path(given[0]).name

        def add(self, flat: Any) -> None:
            found.append(("add", self._name, flat["training_iteration"], flat.get("seed")))

        def close(self) -> None:
            found.append(("close log", self._name))

    class Lines:
        def __init__(self, stop: Any, stream: Any, label: str) -> None:
            found.append(("line", stop, label))

        def show(self, flat: Any) -> None:
            found.append(("show", flat["training_iteration"]))

    monkeypatch.setattr(tune_run, "TrainingLog", Log)
    monkeypatch.setattr(tune_run, "TrainingProgress", Lines)
    monkeypatch.setattr(Checkpoint, "seal", lambda sealed: found.append(sealed))
    return found


def trial_of(name: str | None, last: Any = None) -> Any:
    storage = SimpleNamespace(trial_dir_name=name)
    return SimpleNamespace(storage=storage, last_result=last, config={"env_config": {"trial": 12}}, trial_id="a_9")


def monitor_of(folder: Path, *, start: Checkpoint | None = None, single: bool = True) -> Monitor:
    stop = {"training_iteration": 9.0, "env_runners/return": 5.0}
    found = Monitor(RunFolder(folder / "run"), stop, io.StringIO(), "digest", start, single)
    found.heartbeat = SimpleNamespace(iteration=lambda: None)  # type: ignore[assignment]
    return found


def test_a_single_training_is_logged_in_the_folder_of_the_run(tmp_path: Path, called: list[Any]) -> None:
    monitor, beats = monitor_of(tmp_path, start=Checkpoint(tmp_path, 4, 4096)), list[int]()
    monitor.heartbeat.iteration = lambda: beats.append(1)  # type: ignore[method-assign]
    monitor.on_trial_start(0, [], trial_of("trial"))
    monitor.on_trial_result(0, [], trial_of("trial"), result(5))
    monitor.on_trial_result(0, [], trial_of("trial"), result(6))
    assert called == [
        ("log", tmp_path / "run", 4, 4096), ("line", monitor.stop, ""), ("add", "run", 5.0, None), ("show", 5.0),
        ("add", "run", 6.0, None), ("show", 6.0),
    ]  # fmt: skip
    assert (len(beats), monitor.last["training_iteration"]) == (2, 6.0)
    assert monitor.stream.getvalue() == ""  # type: ignore[attr-defined]
    monitor.on_checkpoint(0, [], trial_of("trial", result(6)), SimpleNamespace(path=tmp_path / "c"))
    assert called[-1] == Checkpoint(tmp_path / "c", 6, 6000, 2.5, "digest")
    monitor.on_checkpoint(0, [], trial_of("trial", {}), SimpleNamespace(path=tmp_path / "c"))
    assert called[-1] == Checkpoint(tmp_path / "c", 0, 0, 0.0, "digest")
    monitor.close()
    assert called[-1] == ("close log", "run")
    fresh = monitor_of(tmp_path)
    fresh.on_trial_result(0, [], trial_of("trial"), result(1))
    assert called[-4] == ("log", tmp_path / "run", 0, 0)


def test_each_trial_of_a_search_is_logged_in_a_folder_of_its_own(tmp_path: Path, called: list[Any]) -> None:
    monitor = monitor_of(tmp_path, single=False)
    for folder, attempts in ((tmp_path / "run", [1, 2]), (tmp_path / "run" / "trials" / "trial_1", [0])):
        folder.mkdir(parents=True)
        record = {"digest": f"of {folder.name}", "attempts": attempts, "configuration": {}}
        (folder / "run.json").write_text(json.dumps(record))
    RunFolder(tmp_path / "run" / "trials" / "trial_1").write_parameters({"lr": 0.01}, 5)
    monitor.on_trial_start(0, [], trial_of("trial_1"))
    assert monitor.stream.getvalue() == "trial_1  lr 0.01, seed 5\n"  # type: ignore[attr-defined]
    record = json.loads((tmp_path / "run" / "trials" / "trial_1" / "run.json").read_text())
    assert record["attempts"] == [0, 2]
    monitor.on_trial_result(0, [], trial_of("trial_1"), result(4, seed=11))
    monitor.on_trial_result(0, [], trial_of("trial_2"), result(1, seed=12))
    monitor.on_trial_result(0, [], trial_of("trial_1"), result(5, seed=11))
    trials_folder = tmp_path / "run" / "trials"
    assert called == [
        ("log", trials_folder / "trial_1", 3), ("line", monitor.stop, "trial_1"), ("add", "trial_1", 4.0, 11.0),
        ("show", 4.0), ("log", trials_folder / "trial_2", 0), ("line", monitor.stop, "trial_2"),
        ("add", "trial_2", 1.0, 12.0), ("show", 1.0), ("add", "trial_1", 5.0, 11.0), ("show", 5.0),
    ]  # fmt: skip
    monitor.on_checkpoint(
        0, [], trial_of("trial", result(5)), SimpleNamespace(path=trials_folder / "trial_1" / "checkpoint_0")
    )
    assert called[-1] == Checkpoint(trials_folder / "trial_1" / "checkpoint_0", 5, 5000, 2.5, "of trial_1")


def test_a_training_ends_at_the_first_of_its_limits(tmp_path: Path, called: list[Any]) -> None:
    monitor = monitor_of(tmp_path)
    assert [monitor("trial", result(k)) for k in (8, 9, 10)] == [False, True, True]
    assert monitor("trial", result(1, env_runners={"return": 5.0}))
    assert not monitor("trial", result(1, env_runners={"return": 4.9}))
    monitor.on_trial_result(0, [], trial_of("trial"), result(1))
    monitor.interrupt(signal.SIGINT)
    assert monitor("trial", result(1))


def test_a_pickle_refers_to_the_monitor_of_the_training(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monitor, started = monitor_of(tmp_path, single=False), list[str]()
    text = pickle.dumps(monitor)
    assert pickle.loads(text) is None

    def start(name: str | None, **more: Any) -> None:
        trial = trial_of(name)
        vars(trial).update(more)
        with pytest.raises(CheckpointError):  # there is no record
            monitor.on_trial_start(0, [], trial)

    def fly() -> None:
        assert pickle.loads(text) is copy.deepcopy(monitor) is monitor
        assert monitor.stop_all() is False
        start("kept")
        start(None)
        start(None, config={})
        raise ValueError("by the way")

    monkeypatch.setattr(RunFolder, "copy_attempt", lambda own, search: started.append(own.path.name))
    with pytest.raises(ValueError, match="by the way"), monitored(monitor):
        fly()
    assert started == ["kept", "trial_00012", "trial_9"]
    assert pickle.loads(text) is None


def test_the_error_of_a_training_is_that_of_its_cause(tmp_path: Path) -> None:
    path = tmp_path / "failure.json"
    for name, kind in (("PluginValueError", PluginValueError), ("Unknown", SafeInspectError)):
        path.write_text(json.dumps({"error": name, "message": "m"}))
        with pytest.raises(kind, match=r"^m$"):
            tune_run._raise_failure(path, ValueError("other"))
    path.unlink()
    inner, middle, outer = ConfigError([]), RuntimeError("middle"), RuntimeError("outer")
    middle.__cause__ = inner
    outer.cause = middle  # type: ignore[attr-defined]  # as Ray names it
    with pytest.raises(ConfigError):
        tune_run._raise_failure(path, outer)
    with pytest.raises(RuntimeError, match="plain"):
        tune_run._raise_failure(path, RuntimeError("plain"))


def test_a_process_that_died_is_told_from_one_that_could_not_begin() -> None:
    from ray.exceptions import RayActorError

    died, begun = RayActorError(), RayActorError()
    begun._actor_init_failed = True
    assert (died.actor_init_failed, begun.actor_init_failed) == (False, True)
    outer = RuntimeError("outer")
    outer.__cause__ = begun
    assert not tune_run.process_died(outer)
    assert not tune_run.process_died(None)
    begun.cause = died
    assert tune_run.process_died(outer)


def test_the_best_checkpoint_is_the_best_of_those_with_a_figure() -> None:
    def kept(*values: Any) -> Any:
        pairs = [
            (SimpleNamespace(path=f"c{k}"), {"env_runners": {} if value is None else {"x": value}})
            for k, value in enumerate(values)
        ]
        return [SimpleNamespace(best_checkpoints=pairs)]

    largest = {"checkpoint_score_attribute": "env_runners/x"}
    results = kept(2.0, None, 5.0, math.nan, -1.0)
    assert tune_run._best(results, largest) == Path("c2")
    assert tune_run._best(results, {**largest, "checkpoint_score_order": "max"}) == Path("c2")
    assert tune_run._best(results, {**largest, "checkpoint_score_order": "min"}) == Path("c4")
    assert tune_run._best(kept(None, math.inf), largest) is None
    assert tune_run._best(results, {}) is None
    assert tune_run._best([SimpleNamespace(best_checkpoints=None)], largest) is None


def test_the_best_trial_is_that_by_which_trials_are_ranked() -> None:
    asked: list[Any] = []

    def best(*given: Any) -> Any:
        asked.append(given)
        if given[0] == "unknown":
            raise RuntimeError("no trial has it")
        return SimpleNamespace(path="here")

    results = SimpleNamespace(get_best_result=best)
    assert tune_run._best_trial(results, {"metric": "x", "mode": "min"}) == Path("here")
    assert tune_run._best_trial(results, {"metric": "y", "mode": "max"}) == Path("here")
    assert tune_run._best_trial(results, {"metric": "unknown", "mode": "max"}) is None
    assert asked[:2] == [("x", "min"), ("y", "max")]


class Board:
    """A stand-in for TensorBoard's writer."""

    made: list[Any] = []  # noqa: RUF012

    def __init__(self, folder: str, *, purge_step: int | None, flush_secs: int) -> None:
        self.made.append((Path(folder).name, purge_step))

    def add_scalar(self, *given: Any) -> None:
        self.made.append(given)

    def flush(self) -> None: ...
    def close(self) -> None: ...


def test_a_log_goes_on_after_the_steps_of_its_checkpoint(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import tensorboardX

    monkeypatch.setattr(tensorboardX, "SummaryWriter", Board)
    Board.made.clear()
    log = TrainingLog(tmp_path / "new")
    log.add(
        {"training_iteration": 1.0, "num_env_steps_sampled_lifetime": 50.0, "pid": 3.0, "a/b": math.nan, "a/c": 2.0}
    )
    later = TrainingLog(tmp_path / "new", 1, 50)
    assert later._rows[0]["iteration"] == 1.0
    anew = TrainingLog(tmp_path / "new", 0)
    assert Board.made == [
        ("tensorboard", None), ("run/training_iteration", 1.0, 50), ("run/num_env_steps_sampled_lifetime", 50.0, 50),
        ("a/c", 2.0, 50), ("tensorboard", 51), ("tensorboard", None),
    ]  # fmt: skip
    assert (tmp_path / "new" / "result.json").read_text() == ""  # started again
    assert read_progress(tmp_path / "new" / "progress.csv") == []
    anew.add({"training_iteration": 1.0, "num_env_steps_sampled_lifetime": 60.0})
    assert [row["steps"] for row in read_progress(tmp_path / "new" / "progress.csv")] == [60.0]
    assert read_progress(tmp_path / "nowhere.csv") == []


def test_lines_that_are_no_iterations_are_left_out(tmp_path: Path) -> None:
    path = tmp_path / "result.json"
    kept = ['{"training_iteration": 1, "a": 2}', '{"training_iteration": 2}']
    path.write_text("\n".join([kept[0], '{"a": 1}', '{"training_iteration": 3}', kept[1], '{"trai']))
    progress._keep_lines(path, 2)
    assert path.read_text() == "\n".join(kept) + "\n"
    progress._keep_lines(tmp_path / "nowhere", 2)
    assert not (tmp_path / "nowhere").exists()
    rows = tmp_path / "progress.csv"
    rows.write_text("iteration,a,b\n1,,2.5\n,3,4\n2,5\n3,6,7,8\n")
    first, last = read_progress(rows)
    assert (first["iteration"], first["b"], last) == (1.0, 2.5, {"iteration": 3.0, "a": 6.0, "b": 7.0})
    assert math.isnan(first["a"])


def test_the_table_of_trials(tmp_path: Path) -> None:
    results = [
        TrialResult(Path("trial_00000"), {"lr": 0.01, "seed": 3}, 12, 5, -1.25, 0.954, Path("x/checkpoint_3")),
        TrialResult(Path("trial_00001"), {"seed": 4, "longer_name": [1, 2]}, 0, 0, math.nan, math.nan, None),
    ]
    assert trial_table(results) == [
        "trial        lr    seed  longer_name  iterations  return  success  checkpoint",
        "trial_00000  0.01  3     null         12          -1.250  95 %     checkpoint_3",
        "trial_00001  null  4     [1, 2]       0           -       -        -",
    ]


def test_what_came_of_each_trial_is_in_its_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folders = [tmp_path / "trials" / f"trial_{number}" for number in range(2)]
    for number, folder in enumerate(folders):
        folder.mkdir(parents=True)
        RunFolder(folder).write_parameters({"lr": number}, 3)
    (folders[0] / "progress.csv").write_text("iteration,steps,return_mean,success_rate\n1,10,0.5,0.1\n2,20,1.5,\n")
    newest = {folders[0]: Checkpoint(folders[0] / "c", 2), folders[1]: None}
    monkeypatch.setattr(trials, "find_newest", lambda folder: (newest[folder], []))
    first, second = read_trials(RunFolder(tmp_path))
    assert (first.folder, first.parameters, first.iteration, first.steps) == (folders[0], {"lr": 0, "seed": 3}, 2, 20)
    assert (first.return_mean, first.checkpoint) == (1.5, folders[0] / "c")
    assert math.isnan(first.success_rate)
    assert (second.iteration, second.steps, second.checkpoint) == (0, 0, None)
    assert math.isnan(second.return_mean)


@pytest.mark.parametrize(
    ("text", "first"),
    [("# From here\nx: 1", ["# From here"]), ("x: 1\n# not the first", [])],
    ids=["first", "not first"],
)
def test_a_trial_is_written_before_it_trains(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str, first: list[str]
) -> None:
    written: list[Any] = []
    monkeypatch.setattr(trials, "experiment_of", lambda *given: {"z": 1, "a": list(given[0])})
    monkeypatch.setattr(trials, "learning_configuration", lambda *given: given)
    monkeypatch.setattr(RunFolder, "write_record", lambda own, **given: written.append((own.path, given)))
    run: Any = SimpleNamespace(text=text, experiment=("whole",))
    settings: Any = SimpleNamespace(policies="policies")
    rllib: Any = SimpleNamespace(settings={"lr": 0.5})
    folder = RunFolder(tmp_path / "run")
    for seed, recorded in ((4, 4), (None, 0)):
        trials.write_trial(folder, run, settings, Trial("trial_00002", rllib, seed, {"lr": 0.5}))
        path, given = written.pop()
        assert path == tmp_path / "run" / "trials" / "trial_00002"
        assert (given["seed"], given["configuration"][1:]) == (recorded, ({"lr": 0.5}, "policies"))
        assert given["configuration"][0] == {"z": 1, "a": ["whole"]}
        shown = "null" if seed is None else seed
        assert given["text"].splitlines() == [
            *first, f"# trial_00002 of a search: lr 0.5, seed {shown}", "z: 1", "a:", "- whole",
        ]  # fmt: skip
        assert json.loads((path / "params.json").read_text()) == {"lr": 0.5, "seed": seed}
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError):
        trials.write_trial(RunFolder(tmp_path / "file"), run, settings, Trial("trial_00002", rllib))
    assert not written


@pytest.mark.parametrize(
    ("found", "asked", "suggested", "refused"),
    [(2, 2, False, False), (2, 3, False, True), (3, 2, False, True), (2, 3, True, False), (3, 2, True, True)],
)
def test_a_search_is_resumed_with_its_trials(
    tmp_path: Path, found: int, asked: int, suggested: bool, refused: bool
) -> None:
    for number in range(found):
        folder = tmp_path / "trials" / f"trial_{number}"
        folder.mkdir(parents=True)
        RunFolder(folder).write_parameters({}, None)
    settings: Any = SimpleNamespace(trials=["trial"] * asked, suggested=suggested)
    if refused:
        with pytest.raises(CheckpointError, match="`num_samples`"):
            check_trials(RunFolder(tmp_path), settings)
    else:
        check_trials(RunFolder(tmp_path), settings)
