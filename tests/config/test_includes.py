from __future__ import annotations

import pytest

from safe_inspect.config.data import configs_root
from safe_inspect.config.loading.loader import load, load_if_path
from safe_inspect.config.loading.located import locate
from safe_inspect.errors import ConfigError, Location


def problems(name: str) -> list[str]:
    with pytest.raises(ConfigError) as caught:
        load(name)
    return [str(problem) for problem in caught.value.problems]


def test_next_to_the_including_file(write):
    write(
        {
            "x/a.yml": "b: !include ./b.yml\nup: !include ../up.yml\n",
            "x/b.yml": "here: 1\n",
            "up.yml": "3",
            "b.yml": "0",
        }
    )
    assert load("x/a.yml") == {"b": {"here": 1}, "up": 3}


def test_working_directory_before_the_repository(write, monkeypatch):
    root = write(
        {
            "repo/configs/task/a.yml": "b: !include configs/task/b.yml\n",
            "repo/configs/task/b.yml": "of: repository\n",
            "work/configs/task/b.yml": "of: working directory\n",
            "elsewhere/file": "",
        }
    )
    a = root / "repo/configs/task/a.yml"
    monkeypatch.chdir(root / "work")
    assert load(a) == {"b": {"of": "working directory"}}
    monkeypatch.chdir(root / "elsewhere")
    assert load(a) == {"b": {"of": "repository"}}
    assert locate(load(a), ("b", "of")) == Location(str(root / "repo/configs/task/b.yml"), 1)


def test_an_experiment_next_to_configs_finds_them_from_anywhere(write, monkeypatch):
    root = write({"repo/mine/a.yml": "b: !include configs/b.yml\n", "repo/configs/b.yml": "1", "else/file": ""})
    monkeypatch.chdir(root / "else")
    assert load(root / "repo/mine/a.yml") == {"b": 1}


def test_the_data_of_the_package_come_last(write, monkeypatch):
    root = write(
        {
            "data/task/ppo.yml": "lr: 1e-4\n",
            "work/a.yml": "p: !include configs/task/ppo.yml\nq: !include task/ppo.yml\n",
        }
    )
    monkeypatch.setattr("safe_inspect.config.loading.loader.configs_root", lambda: root / "data")
    monkeypatch.chdir(root / "work")
    assert load("a.yml") == {"p": {"lr": 1e-4}, "q": {"lr": 1e-4}}
    assert load("configs/task/ppo.yml") == {"lr": 1e-4}


def test_the_configurations_of_the_package_exist():
    assert (configs_root() / "translational-inspection").is_dir()


def test_an_included_file_is_read_once(write):
    write({"a.yml": "x: !include b.yml\ny: !include b.yml\n", "b.yml": "k: {j: 1}\n"})
    tree = load("a.yml")
    assert tree["x"] is tree["y"]


def test_a_merge_key_takes_an_include(write):
    write({"a.yml": "<<: !include b.yml\nlr: 2\n", "b.yml": "lr: 1\nclip: 3\n"})
    tree = load("a.yml")
    assert tree == {"lr": 2, "clip": 3}
    assert locate(tree, ("clip",)) == Location("b.yml", 2)


def test_a_missing_include_is_reported_at_its_tag(write):
    write({"configs/task/a.yml": "x: 1\nagent:\n  !include configs/tsk/agent.yml\n", "configs/task/agent.yml": "{}"})
    (problem,) = problems("configs/task/a.yml")
    assert problem.startswith(
        "configs/task/a.yml:3: the included file does not exist: 'configs/tsk/agent.yml' "
        "(searched: configs/tsk/agent.yml, "
    )
    assert (configs_root() / "tsk/agent.yml").as_posix() in problem
    assert problem.endswith("; did you mean `configs/task/agent.yml`?")


def test_a_missing_include_next_to_the_file(write):
    write({"x/a.yml": "x: !include ./parameter.yml\ny: !include parameters.yml\n", "x/parameters.yml": "{}"})
    first, second = problems("x/a.yml")
    assert first == (
        "x/a.yml:1: the included file does not exist: './parameter.yml' (searched: x/parameter.yml); "
        "did you mean `./parameters.yml`?"
    )
    assert second.startswith("x/a.yml:2: ")
    assert second.endswith("; to include the file next to this one, write `./parameters.yml`")


def test_a_circle_of_includes_shows_the_chain(write):
    write({"a.yml": "x: !include b.yml\n", "b.yml": "y: 1\nz: !include c.yml\n", "c.yml": "- !include b.yml\n"})
    assert problems("a.yml") == ["c.yml:1: circular `!include`: b.yml -> c.yml -> b.yml; remove one `!include`"]
    write({"d.yml": "x: !include ./d.yml\n"})
    assert problems("d.yml") == ["d.yml:1: circular `!include`: d.yml -> d.yml; remove one `!include`"]


def test_mistakes_of_several_files_are_reported_together(write):
    write(
        {
            "a.yml": "x: !include b.yml\ny: !include c.yml\nz: !include b.yml\n",
            "b.yml": "k: [1\n",
            "c.yml": "",
            "d/e": "",
        }
    )
    first, second = problems("a.yml")
    assert first.startswith("b.yml:1: not valid YAML: the brackets")
    assert second.startswith("c.yml:1: the file is empty")


def test_an_included_directory_is_reported_at_its_tag(write):
    write({"a.yml": "x: 1\ny: !include d\n", "d/e.yml": "{}"})
    assert problems("a.yml") == ["a.yml:2: 'd' is a directory; name one of its files: e.yml"]


def test_load_if_path_takes_plain_texts(write):
    write(
        {
            "x/a.yml": "config: configs/task.yml\nagent: ./agent.yml\nname: blue0\n",
            "x/agent.yml": "k: 1",
            "configs/task.yml": "j: 2",
        }
    )
    tree = load("x/a.yml")
    assert load_if_path(tree["config"], locate(tree, ("config",))) == {"j": 2}
    assert load_if_path(tree["agent"], locate(tree, ("agent",))) == {"k": 1}
    assert load_if_path(tree["name"]) == "blue0"
    assert load_if_path(3) == 3
    with pytest.raises(ConfigError, match=r"^x/a.yml:1: the included file does not exist: 'nowhere.yml'"):
        load_if_path("nowhere.yml", locate(tree, ("config",)))


def test_a_name_that_is_too_long_for_a_file_is_no_file(write):
    for name in ("x" * 5000, "x" * 5000 + "/a.yml"):
        write({"x/a.yml": f"a: !include {name}\n"})
        with pytest.raises(ConfigError, match="the included file does not exist"):
            load("x/a.yml")
