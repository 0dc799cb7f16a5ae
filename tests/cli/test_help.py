"""The help of each command says what its options do, with the defaults that they have."""

from __future__ import annotations

import argparse
import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import pytest

from safe_inspect.cli.main import Parser, command_parser, main, parse_arguments


def options() -> Iterator[tuple[str, argparse.Action]]:
    """Return the actions of all commands, each with its name."""
    waiting: list[tuple[str, Parser]] = [("", command_parser())]
    while waiting:
        command, parser = waiting.pop()
        parser.load()
        for action in parser._actions:
            if isinstance(action, argparse._SubParsersAction):
                waiting += [(f"{command} {name}", inner) for name, inner in action.choices.items()]
            else:
                yield f"{command} {'/'.join(action.option_strings) or action.dest}", action


OPTIONS = dict(options())


@pytest.mark.parametrize("name", OPTIONS)
def test_the_help_states_the_default(name: str) -> None:
    action = OPTIONS[name]
    assert action.help
    told = re.search(r"\(default: ([^;,)]+?)(?: \w+)?\)", action.help)
    number = re.match(r"[\d,]+(\.\d+)?$", told[1]) if told else None
    if number and action.default is not None:
        assert float(number[0].replace(",", "")) == float(action.default)


def commands() -> dict[str, argparse.ArgumentParser]:
    """Return the parser of each command."""
    (found,) = (action for action in command_parser()._actions if isinstance(action, argparse._SubParsersAction))
    return dict(found.choices)


@pytest.mark.parametrize("name", commands())
def test_the_example_of_a_command_parses_and_its_documentation_exists(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        main([name, "--help"])
    told = capsys.readouterr().out
    example = re.search(r"^Example:\n  (.*)$", told, re.MULTILINE)
    assert example
    words = shlex.split(example[1])
    assert words[:2] == ["safe-inspect", name]
    parse_arguments(command_parser(), words[1:])
    assert "Exit codes: 0 success" in told
    page = (Path(__file__).parents[2] / "docs" / "cli.md").read_text(encoding="utf-8")
    assert f"docs/cli.md#{name}" in told
    assert f"\n### {name}\n" in page


def test_an_argument_is_called_the_same_everywhere() -> None:
    words = {action.metavar or action.dest for action in OPTIONS.values() if action.nargs != 0 and not action.choices}
    assert words == {
        "FILE", "FOLDER", "N", "NAME", "KIND", "KEY=VALUE", "FILE|KEY=VALUE", "SOURCE", "BASELINE", "RUN",
        "CHECKPOINT", "TEXT", "SECONDS", "DEGREES",
    }  # fmt: skip
