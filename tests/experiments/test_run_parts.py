"""Parts of runs without Ray's processes: seeds and slots, labels of recipes, missions as tasks, spaces of searches."""

from __future__ import annotations

import contextlib
import json
import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from safe_inspect.errors import SafeInspectError
from safe_inspect.experiments.runs import cluster, progress, trials
from safe_inspect.experiments.sampling.environment import first_slot, seed_of, stream_seed

pytestmark = pytest.mark.ray


@pytest.mark.parametrize(
    ("seed", "attempt", "evaluation", "stream"),
    [
        (0, 0, False, 0), (7, 0, False, 7), (2**64 + 7, 0, False, 7),
        # The first outputs of the reference implementation of SplitMix64, begun with 0.
        (0, 0, True, 0xE220A8397B1DCDAF), (0, 1, False, 0x6E789E6AA1B965F4), (0, 1, True, 0x06C45D188009454F),
    ],
)  # fmt: skip
def test_attempts_and_evaluations_have_their_own_streams(
    seed: int, attempt: int, evaluation: bool, stream: int
) -> None:
    assert stream_seed(seed, attempt, evaluation) == stream
    assert seed_of({"seed": seed, "attempt": attempt}, evaluation) == stream
    assert seed_of({"seed": None}, False) == 0


@pytest.mark.parametrize(("worker", "slot"), [(0, 0), (1, 0), (2, 64), (5, 256)])
def test_a_runner_has_the_slots_behind_those_before_it(worker: int, slot: int) -> None:
    assert first_slot(worker, 64) == slot


@pytest.fixture
def runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Return a function that makes the folder of a run with a configuration, or without a record."""

    def make(name: str, configuration: Any = None) -> Path:
        folder = tmp_path / name
        folder.mkdir(parents=True)
        (folder / "progress.csv").write_text("")
        if configuration is not None:
            (folder / "run.json").write_text(json.dumps({"configuration": configuration}))
        return folder

    monkeypatch.setattr(trials.RunFolder, "read_record", lambda run: json.loads(run.record.read_text()))
    return make


def test_runs_that_differ_in_their_seed_are_one_recipe(runs: Any) -> None:
    base = {"rllib_configs": {"lr": 1e-3, "seed": 1}, "agents": [{"seed": 3, "a": 1}], "list": [1, 2]}
    folders = [
        runs("one", base), runs("two", {**base, "rllib_configs": {"lr": 1e-3, "seed": 2}}),
        runs("three", {**base, "rllib_configs": {"lr": 1e-4, "seed": 1}}),
    ]  # fmt: skip
    found = trials.recipes_of(folders)
    assert {label: [path.parent.name for path in paths] for label, paths in found.items()} == {
        "lr 0.001": ["one", "two"], "lr 0.0001": ["three"],
    }  # fmt: skip
    assert list(trials.recipes_of(folders, ["a", "b", "a"])) == ["a", "b"]
    assert [len(paths) for paths in trials.recipes_of(folders, ["a", "b", "a"]).values()] == [2, 1]
    assert [len(paths) for paths in trials.recipes_of(folders, ["a", "b"]).values()] == [2, 1]
    with pytest.raises(SafeInspectError) as caught:
        trials.recipes_of(folders, ["a"])
    assert str(caught.value) == (
        "1 labels are given for 3 runs of 2 recipes; give a label for each run or for each recipe"
    )


@pytest.mark.parametrize(
    ("changes", "labels"),
    [
        ([{"a": 1}, {"a": 2}], ["a 1", "a 2"]),
        ([{"a": 1, "b": {"c": 1}}, {"a": 2, "b": {"c": 3}}], ["a 1, c 1", "a 2, c 3"]),
        ([{"a": 1}, {}], ["a 1", "a none"]),
        ([dict.fromkeys("abcd", 1), dict.fromkeys("abcd", 2)], ["r0", "r1"]),
        ([{"a": "x" * 60}, {"a": "y"}], ["r0", "r1"]),
        ([{"agents": [{"lr": 1}, {"lr": 1}]}, {"agents": [{"lr": 2}, {"lr": 2}]}], ["lr 1", "lr 2"]),
        ([{"experiment": {"agent_config": [{"policy": {"config": {"num_sgd_iter": 1}}}]},
           "rllib_configs": {"num_epochs": 1}},
          {"experiment": {"agent_config": [{"policy": {"config": {"num_sgd_iter": 2}}}]},
           "rllib_configs": {"num_epochs": 2}}], ["num_epochs 1", "num_epochs 2"]),
    ],
)  # fmt: skip
def test_a_recipe_is_named_by_what_differs(runs: Any, changes: list[Any], labels: list[str]) -> None:
    folders = [runs(f"r{index}_2026-01-0{index + 1}_00-00-00", change) for index, change in enumerate(changes)]
    assert list(trials.recipes_of(folders)) == labels


def test_runs_without_a_record_are_named_by_their_folders(runs: Any, tmp_path: Path) -> None:
    first, second = runs("a_2026-01-01_00-00-00"), runs("a_2026-01-02_00-00-00_1")
    assert {label: len(paths) for label, paths in trials.recipes_of([first, second]).items()} == {"a": 2}
    searched = [runs(f"s_2026-01-01_00-00-00/trials/trial_0000{index}", {"lr": index}) for index in (0, 1)]
    search = searched[0].parents[1]
    assert list(trials.recipes_of([search])) == ["lr 0", "lr 1"]
    assert trials._name(searched[0] / "progress.csv") == "s_2026-01-01_00-00-00 trial_00000"
    assert trials._stem(searched[0] / "progress.csv") == "s trial_00000"
    assert trials.one_recipe(first) == [first / "progress.csv"]
    assert trials.one_recipe(searched[1] / "progress.csv") == [searched[1] / "progress.csv"]
    with pytest.raises(SafeInspectError) as caught:
        trials.one_recipe(search)
    assert str(caught.value) == (
        f"{search}: the trials of this search differ in more than their seed (lr 0; lr 1); give the folders of single "
        "trials, trials/NAME"
    )
    (tmp_path / "empty").mkdir()
    for folder, what in (("empty", "there is no progress.csv in this folder"), ("nowhere", "there is no such folder")):
        with pytest.raises(SafeInspectError) as caught:
            trials.recipes_of([tmp_path / folder])
        assert str(caught.value) == f"{tmp_path / folder}: {what}; give the folder of a training run"


class FakeTasks:
    """Replacement of Ray in which tasks end in the order in which they were started."""

    def __init__(self) -> None:
        self.flying, self.most, self.cancelled = list[int](), 0, list[int]()

    def remote(self, num_cpus: int) -> Any:
        assert num_cpus == 1

        def begin(tree: Any, source: str, number: int) -> int:
            assert (tree, source) == ({"a": 1}, "file")
            self.flying.append(number)
            self.most = max(self.most, len(self.flying))
            return number

        return lambda function: SimpleNamespace(remote=begin)

    def wait(self, tasks: list[int]) -> tuple[list[int], list[int]]:
        self.flying.remove(tasks[0])
        return tasks[:1], tasks[1:]


@pytest.mark.parametrize(("workers", "most"), [(1, 1), (2, 2), (9, 5)])
def test_missions_fly_as_tasks_as_many_at_a_time_as_asked(
    monkeypatch: pytest.MonkeyPatch, workers: int, most: int
) -> None:
    import ray

    fake, started = FakeTasks(), list[Any]()
    monkeypatch.setattr(ray, "remote", fake.remote)
    monkeypatch.setattr(ray, "put", lambda tree: tree)
    monkeypatch.setattr(ray, "wait", fake.wait)
    monkeypatch.setattr(ray, "get", lambda task: (task, {"flown": task}))
    monkeypatch.setattr(ray, "cancel", lambda task, force: fake.cancelled.append(task))

    @contextlib.contextmanager
    def started_cluster(settings: Any, cpus: float, folder: Any) -> Any:
        started.append((settings["address"], settings["num_cpus"], cpus, folder))
        yield

    monkeypatch.setattr(cluster, "ray_cluster", started_cluster)
    flights = cluster.RayFlights("local", workers)
    assert list(flights({"a": 1}, "file", range(3, 8))) == [(number, {"flown": number}) for number in range(3, 8)]
    assert (fake.most, fake.cancelled, started) == (most, [], [("local", workers, cluster.Claim({"CPU": 1.0}), None)])
    stopped = flights({"a": 1}, "file", range(5))
    next(stopped)
    stopped.close()
    assert fake.cancelled == list(range(1, most))


def test_a_mission_that_fails_raises_its_own_error(monkeypatch: pytest.MonkeyPatch) -> None:
    import ray

    def fail(task: Any) -> Any:
        raise ray.exceptions.RayTaskError("fly", "trace", SafeInspectError("lost"))

    fake = FakeTasks()
    for name, function in (("remote", fake.remote), ("put", lambda tree: tree), ("wait", fake.wait), ("get", fail)):
        monkeypatch.setattr(ray, name, function)
    monkeypatch.setattr(ray, "cancel", lambda task, force: fake.cancelled.append(task))
    monkeypatch.setattr(cluster, "ray_cluster", lambda *_: contextlib.nullcontext())
    with pytest.raises(SafeInspectError, match=r"^lost$"):
        list(cluster.RayFlights("local", 2)({"a": 1}, "file", range(5)))
    assert fake.cancelled == [1]  # the other mission


def test_tune_searches_the_number_of_the_trial_alone() -> None:
    from ray.tune.search.sample import Function

    from safe_inspect.experiments.runs.tune_objects import _value_of_trial, search_space, tune_space

    configs: Any = [
        SimpleNamespace(to_dict=lambda lr=lr: {"lr": lr, "env_config": {"seed": lr + 1}}) for lr in (10, 20, 30)
    ]
    space = search_space(configs)
    assert space.keys() == {"lr", "env_config"}
    assert space["env_config"]["trial"] == {"grid_search": [0, 1, 2]}
    assert isinstance(space["lr"], Function)
    trial = {"env_config": {"trial": 2}}
    assert space["lr"].func(trial) == 30
    assert space["env_config"]["seed"].func(trial) == 31
    assert _value_of_trial([5, 6], {"env_config": {"trial": 1}}) == 6
    found = tune_space(
        {"a": {"choice": [1, 2]}, "b": {"uniform": [0, 3]}, "c": {"loguniform": [1, 4]}, "d": {"randint": [2, 5]}}
    )
    assert found["a"].categories == [1, 2]
    assert [(found[name].lower, found[name].upper) for name in "bcd"] == [(0, 3), (1, 4), (2, 5)]
    assert [type(found[name]).__name__ for name in "bcd"] == ["Float", "Float", "Integer"]
    assert type(found["c"].sampler).__name__ == "_LogUniform"


def test_a_searcher_gets_known_figures_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    from ray.tune.search import Searcher

    from safe_inspect.experiments.runs.tune_objects import Suggestions

    class Noting(Searcher):
        calls: list[Any] = []  # noqa: RUF012
        accepts = True

        def set_search_properties(self, metric: Any, mode: Any, config: Any, **_: Any) -> bool:
            self.calls.append((metric, mode, sorted(config)))
            return self.accepts

        def suggest(self, trial_id: str) -> Any:
            return {"one": {"lr": 1}, "two": None, "three": Searcher.FINISHED}[trial_id]

        def on_trial_result(self, trial_id: str, result: Any) -> None:
            self.calls.append((trial_id, result))

        def on_trial_complete(self, trial_id: str, result: Any = None, error: bool = False) -> None:
            self.calls.append((trial_id, result, error))

        def save(self, path: str) -> None: ...
        def restore(self, path: str) -> None: ...

    own = Noting()
    found = Suggestions(own, {"lr": {"uniform": [0, 1]}}, "m", "max")
    make: Any = lambda number, values: {**values, "env_config": {"number": number}}  # noqa: E731
    monkeypatch.setattr(Suggestions, "make", make, raising=False)
    assert found.suggest("one") == {"lr": 1, "env_config": {"number": 0, "trial": 0}}
    assert (found.suggest("two"), found.suggest("three")) == (None, Searcher.FINISHED)
    assert found.suggest("one")["env_config"] == {"number": 1, "trial": 1}
    assert found.get_state() == {"count": 2}
    found.set_state({"count": 7})
    assert found.get_state() == {"count": 7}
    for value in (1.0, math.nan, math.inf):
        found.on_trial_result("t", {"m": value})
        found.on_trial_complete("t", {"m": value}, error=value == 1.0)
    found.on_trial_complete("t")
    assert own.calls == [
        ("m", "max", ["lr"]), ("t", {"m": 1.0}), ("t", {"m": 1.0}, True), ("t", None, False), ("t", None, False),
        ("t", None, False),
    ]  # fmt: skip
    own.accepts = False
    with pytest.raises(ValueError, match="it accepts no search space; remove its own"):
        Suggestions(own, {}, "m", "max")


def test_the_columns_of_an_iteration() -> None:
    flat = {
        "training_iteration": 3.0, "env_runners/reward/b": 2.0, "env_runners/reward/a": 1.0,
        "env_runners/interventions": 5.0, "env_runners/agents/red/return": 4.0, "learners/default_policy/entropy": 0.5,
        "learners/own/vf_loss": 0.25, "learners/own/other": 9.0, "num_env_steps_sampled_lifetime": 7.0,
    }  # fmt: skip
    row = progress.row_of(flat)
    known = {key: value for key, value in row.items() if not math.isnan(value)}
    assert known == {
        "iteration": 3.0, "steps": 7.0, "reward/a": 1.0, "reward/b": 2.0, "interventions": 5.0,
        "agents/red/return": 4.0, "entropy": 0.5, "policies/own/vf_loss": 0.25,
    }  # fmt: skip
    assert list(row)[: len(progress.COLUMNS)] == list(progress.COLUMNS)
    assert list(row)[len(progress.COLUMNS) :][:3] == ["reward/a", "reward/b", "interventions"]
