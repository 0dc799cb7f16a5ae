"""What `load_experiment` takes in place of a file, what it refuses, and what an experiment says of itself."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import pytest
import yaml

from safe_inspect.config.data import configs_root
from safe_inspect.config.experiment import build_experiment, load_experiment
from safe_inspect.config.loading.located import LocatedDict, LocatedList, plain
from safe_inspect.config.report import functor_mistakes, message, shown
from safe_inspect.errors import ConfigError
from safe_inspect.plugins.functor import build
from safe_inspect.task_ids import ALL_TASKS
from safe_inspect.version import __version__

ONE = configs_root() / "translational-inspection" / "experiment.yml"


@pytest.mark.parametrize(
    ("path", "overrides", "shown"),
    [
        (3, (), "a configuration must be a file path or a task id, not 3"),
        ("", (), "a configuration must be a file path or a task id, not ''"),
        ({"config": {}}, (), "a configuration must be a file path or a task id, not {'config': {}}; "
         "use `build_spec` for a resolved configuration"),
        ("safe_inspect/Dokcing-v0", (), "there is no task with the id 'safe_inspect/Dokcing-v0'; "
         "did you mean `safe_inspect/Docking-v0`?"),
        ("Docking-v1", (), "no file or task 'Docking-v1'; did you mean `safe_inspect/Docking-v0`?"),
        (ONE, "lr=1", "overrides must be a list of strings; write ['lr=1']"),
        (ONE, (3,), "overrides: 3 is not a string; write 'path.of.keys=value'"),
        (ONE, (3, "x"), "overrides: 3 is not a string; write 'path.of.keys=value'\ncommand line: x: not an override; "
         "write it as `path.of.keys=value`, or as `~path.of.keys` to remove them"),
    ],
)  # fmt: skip
def test_what_is_no_experiment_is_refused(path: Any, overrides: Any, shown: str) -> None:
    with pytest.raises(ConfigError) as caught:
        load_experiment(path, overrides)
    assert str(caught.value) == shown


def test_a_name_that_is_near_no_task_is_looked_for_as_a_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("zzz", "Docking-v1.yml", "folder/Docking-v1"):
        with pytest.raises(ConfigError, match=f"no file '{name}'"):
            load_experiment(name)
    (tmp_path / "Docking-v1").write_text("- 1\n")
    with pytest.raises(ConfigError, match="not an experiment"):
        load_experiment("Docking-v1")


def test_a_former_id_means_the_present_one_with_a_warning() -> None:
    with pytest.warns(FutureWarning) as caught:
        experiment = load_experiment("safe_inspect/TranslationalInspection-v0")
    assert [str(one.message) for one in caught] == [
        "safe_inspect/TranslationalInspection-v0 is now called safe_inspect/TranslationalInspectionSeed-v0; use that "
        "name (version 1 is a different task, not a newer version)"
    ]
    assert Path(experiment.source) == configs_root() / ALL_TASKS["safe_inspect/TranslationalInspectionSeed-v0"]


def test_an_id_may_change_values_of_its_file_before_the_users() -> None:
    name, key = "safe_inspect/FilteredTranslationalInspection-v1", "RTAGlueCWHInspection1v1.config.enabled"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = [load_experiment(name, overrides).spec for overrides in ((), (f"{key}=False",))]
    assert [spec.agents[0].action_glues[0].enabled for spec in found] == [True, False]


def test_the_text_of_an_experiment_is_its_resolved_configuration() -> None:
    experiment = load_experiment(ONE, ["seed=7", "lr=0.25"])
    head, rest = experiment.text.split("\n", 1)
    assert head == f"# Resolved from {ONE} by safe_inspect {__version__}"
    assert yaml.safe_load(rest) == experiment.resolved
    assert list(yaml.safe_load(rest)) == list(experiment.tree)
    assert max(map(len, rest.splitlines())) <= 120
    assert type(experiment.resolved["agent_config"]) is list
    assert type(experiment.resolved["agent_config"][0]) is dict


@pytest.mark.parametrize(
    ("given", "seed"),
    [(0, 0), (7, 7), (2**32 - 1, 2**32 - 1), (2**64 - 1, 2**64 - 1), (2**64, 0), (-1, 0), ("seven", 0), (None, 0)],
)
def test_the_seed_of_the_environment_is_that_of_the_training(given: Any, seed: int) -> None:
    tree = load_experiment(ONE).resolved
    tree["config"]["config"]["rllib_configs"]["local"]["seed"] = given
    assert build_experiment(tree).spec.seed == seed


@pytest.mark.parametrize(
    ("own", "other", "horizon", "left"),
    [
        (100, None, 100, False), (None, 100, 100, False), (100, 100, 100, False), (100, 200, 100, True),
        (None, None, 1224, False),
    ],
)  # fmt: skip
def test_the_time_limit_of_the_environment_comes_before_that_of_rllib(
    own: int | None, other: int | None, horizon: int, left: bool
) -> None:
    tree = load_experiment(ONE).resolved
    body = tree["config"]["config"]
    body["env_config"]["horizon"] = own
    if other is not None:
        body["rllib_configs"]["local"]["horizon"] = other
    experiment = build_experiment(tree)
    (limit,) = [done.functor for done in experiment.spec.agents[0].dones if done.name == "EpisodeLengthDone"]
    assert limit.horizon == horizon
    assert ("horizon" in experiment.rllib) == left


@pytest.mark.parametrize(("name", "value"), [("local", 1), ("cluster", 2), ("elsewhere", 3)])
def test_a_compute_platform_that_is_not_there_is_the_default(name: str, value: int) -> None:
    tree = load_experiment(ONE).resolved
    tree["config"]["config"]["rllib_configs"] = {
        key: {"a": k} for k, key in enumerate(("local", "cluster", "default"), 1)
    }
    assert build_experiment(tree, compute_platform=name).rllib["a"] == value


def test_the_names_that_plugins_may_use() -> None:
    spec = load_experiment(ONE).spec
    names = spec.names(spec.agents[0])
    assert names["entity"] == {"blue0", "chief"}
    assert names["platform"] == {"blue0"}
    assert names["points"] == {"chief"}
    assert names["controller"] == {"X Thrust", "Y Thrust", "Z Thrust"}
    assert "Sensor_SunDirection" in names["sensor"]
    assert not names["sensor"] & names["controller"]
    assert "EpisodeLengthDone" in names["done"]


def test_located_containers_are_plain_ones_for_writers() -> None:
    tree = LocatedDict({"a": LocatedList([LocatedDict({"b": 1}), (2,)])})
    found = plain(tree)
    assert found == {"a": [{"b": 1}, (2,)]}
    assert [type(found), type(found["a"]), type(found["a"][0])] == [dict, list, dict]


LONG = ["x" * 10] * 9


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "nothing (`null`)"), (True, "`true`"), (False, "`false`"), ("a", "'a'"), (1.5, "1.5"),
        ("a" * 58, f"'{'a' * 58}'"), ("a" * 59, f"'{'a' * 56}..."), (LONG, "a list of 9"), (tuple(LONG), "a list of 9"),
        (dict.fromkeys(("a" * 30, "b" * 30), 1), "a mapping with 2 keys"), ([1], "[1]"),
    ],
)  # fmt: skip
def test_a_value_is_shown_shortly(value: Any, text: str) -> None:
    assert shown(value) == text


@pytest.mark.parametrize(
    ("kind", "said", "more", "shown"),
    [
        ("missing", "Field required", {"loc": ("a", 2)}, ("item 2 of the list is missing", "")),
        ("missing", "Field required", {"loc": ("a",)}, ("the key is missing", "")),
        ("missing", "Field required", {}, ("the key is missing", "")),
        ("functor_key", "As it is", {}, ("As it is", "")),
        ("value_error", "Value error, it is wrong", {}, ("it is wrong", "")),
        ("assertion_error", "Assertion failed, it is wrong", {}, ("it is wrong", "")),
        ("odd_type", "Input is odd", {"input": 3}, ("input is odd, got 3", "")),
        ("greater_than", "", {"input": -1, "ctx": {"gt": 0.0}}, ("expected a number above 0, got -1", "")),
        ("less_than_equal", "", {"input": 9, "ctx": {"le": 0.1}}, ("expected a number of 0.1 or less, got 9", "")),
        ("too_long", "", {"input": [1, 2], "ctx": {"max_length": 1}}, ("expected at most 1 items, got [1, 2]", "")),
        ("string_pattern_mismatch", "", {"input": "?", "ctx": {"pattern": "^a$"}},
         ("expected a string that matches the regular expression `^a$`, got '?'", "")),
        ("string_pattern_mismatch", "", {"input": "a b", "ctx": {"pattern": r"^[^/\s]+$"}},
         ("expected a name without spaces and slashes, got 'a b'", "")),
        ("literal_error", "", {"input": "lose", "ctx": {"expected": "'loose' or 'tight'"}},
         ("expected 'loose' or 'tight', got 'lose'", "did you mean `loose`?")),
        ("literal_error", "", {"input": "zzz", "ctx": {"expected": "'loose' or 'tight'"}},
         ("expected 'loose' or 'tight', got 'zzz'", "")),
        ("literal_error", "", {"input": 3, "ctx": {"expected": "'loose' or 'tight'"}},
         ("expected 'loose' or 'tight', got 3", "")),
    ],
)  # fmt: skip
def test_a_mistake_is_reported_in_plain_words(
    kind: str, said: str, more: dict[str, Any], shown: tuple[str, str]
) -> None:
    assert message({"type": kind, "msg": said, **more}) == shown


def test_the_mistakes_of_a_functor_that_no_file_names_are_one_text() -> None:
    from pydantic_core import PydanticCustomError

    with pytest.raises(PydanticCustomError) as caught:
        build("reward", {"functor": "ObservedPointsReward", "config": {"scale": "x", "weighted_priority": 3}})
    assert functor_mistakes(caught.value) == (
        "config.scale: expected a number, got 'x'; config.weighted_priority: expected `true` or `false`, got 3"
    )
    with pytest.raises(PydanticCustomError) as caught:
        build("reward", 3)
    assert functor_mistakes(caught.value) == "a reward must be a mapping with the key `functor`, not 3"
