from __future__ import annotations

import pytest

from safe_inspect import errors
from safe_inspect.errors import ConfigError, Location, Problem, SafeInspectError, did_you_mean


def test_location_says_file_and_line() -> None:
    assert str(Location("agent.yml", 41)) == "agent.yml:41"
    assert str(Location("command line", 0, text="a.b=1")) == "command line: a.b=1"


@pytest.mark.parametrize(
    ("problem", "text"),
    [
        (Problem("it is wrong"), "it is wrong"),
        (Problem("it is wrong", hint="fix it"), "it is wrong; fix it"),
        (Problem("it is wrong", "rewards[0].config.scael"), "rewards[0].config.scael: it is wrong"),
        (
            Problem("it is wrong", "rewards[0]", Location("agent.yml", 7), "fix it"),
            "agent.yml:7 rewards[0]: it is wrong; fix it",
        ),
        (Problem("it is wrong", location=Location("agent.yml", 7)), "agent.yml:7: it is wrong"),
    ],
)
def test_problem_says_where_what_and_what_to_do(problem: Problem, text: str) -> None:
    assert str(problem) == text


def test_config_error_states_every_problem_in_a_line() -> None:
    problems = [Problem("one", "a"), Problem("two", "b")]
    error = ConfigError(problems)
    assert error.problems == tuple(problems)
    assert str(error) == "a: one\nb: two"
    assert str(ConfigError("alone")) == "alone"
    assert ConfigError(Problem("alone", "a")).problems == (Problem("alone", "a"),)


@pytest.mark.parametrize(
    ("name", "parent"),
    [
        ("ConfigError", Exception),
        ("RegistryError", LookupError),
        ("UnitError", ValueError),
        ("InitialStateError", RuntimeError),
        ("PluginValueError", ArithmeticError),
        ("CheckpointError", RuntimeError),
        ("OutputError", OSError),
    ],
)
def test_every_error_is_one_of_the_package(name: str, parent: type[Exception]) -> None:
    cls = getattr(errors, name)
    assert issubclass(cls, SafeInspectError)
    assert issubclass(cls, parent)


class TestDidYouMean:
    def test_nearest(self) -> None:
        assert did_you_mean("scael", ["scale", "mode"]) == "did you mean `scale`?"

    def test_the_shortest_with_the_same_start(self) -> None:
        assert did_you_mean("dock", ["DockingAutopilot", "docking"]) == "did you mean `docking`?"

    def test_case_counts_little_and_the_known_spelling_is_shown(self) -> None:
        assert did_you_mean("observedpointsreward", ["ObservedPointsReward"]) == "did you mean `ObservedPointsReward`?"

    def test_nothing_near(self) -> None:
        assert did_you_mean("xyz", ["scale", "mode"]) == "known: `mode`, `scale`"

    def test_nothing_known(self) -> None:
        assert did_you_mean("xyz", []) == "there is none"

    def test_long_lists_are_cut(self) -> None:
        text = did_you_mean("?", (f"name{index:02d}" for index in range(13)))
        assert text.count("`name") == 12
        assert text.endswith(", ...")
        assert not did_you_mean("?", (f"name{index:02d}" for index in range(12))).endswith("...")
