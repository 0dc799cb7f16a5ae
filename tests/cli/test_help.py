"""The help of each command says what its options do, with the defaults that they have."""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterator

import pytest

from safe_inspect.cli.main import command_parser


def options() -> Iterator[tuple[str, argparse.Action]]:
    """Return the actions of all commands, each with its name."""
    waiting: list[tuple[str, argparse.ArgumentParser]] = [("", command_parser())]
    while waiting:
        command, parser = waiting.pop()
        for action in parser._actions:
            if isinstance(action, argparse._SubParsersAction):
                waiting += [(f"{command} {name}", inner) for name, inner in action.choices.items()]
            else:
                yield f"{command} {'/'.join(action.option_strings) or action.dest}", action


OPTIONS = dict(options())


@pytest.mark.parametrize("name", OPTIONS)
def test_the_help_tells_the_default(name: str) -> None:
    action = OPTIONS[name]
    assert action.help
    told = re.search(r"\(default: ([^;,)]+?)(?: \w+)?\)", action.help)
    number = re.match(r"[\d,]+(\.\d+)?$", told[1]) if told else None
    if number and action.default is not None:
        assert float(number[0].replace(",", "")) == float(action.default)
