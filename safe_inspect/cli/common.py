"""What the commands share: how a command line is parsed, and what becomes of mistakes and interruptions."""

from __future__ import annotations

import argparse
import importlib
import io
import os
import re
import signal
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import NoReturn

from safe_inspect.errors import SafeInspectError, did_you_mean
from safe_inspect.interrupts import Interrupted, handled
from safe_inspect.outputs import NO_SPACE, cannot_write

USER_ERROR = 2
#: Names of parsed arguments that are no options.
_HIDDEN = {"--overrides", "--words", "--run", "--command", "--experiment-needed", "--source", "--sources"}


class Parser(argparse.ArgumentParser):
    """A parser whose mistakes are one line; subcommands get it too."""

    def error(self, message: str) -> NoReturn:
        """Print the mistake and where help is, and exit."""
        mistyped = re.fullmatch(r"argument command: invalid choice: '(.*?)' \(choose from (.*)\)", message)
        if mistyped:
            commands = [name.strip(" '") for name in mistyped[2].split(",")]
            message = f"there is no command {mistyped[1]!r}; {did_you_mean(mistyped[1], commands)}"
        self.exit(USER_ERROR, f"error: {message}; see `{self.prog} --help`\n")


def parse_arguments(parser: argparse.ArgumentParser, argv: Sequence[str] | None) -> argparse.Namespace:
    """Parse a command line.

    Overrides may stand anywhere; argparse alone takes them before the options only. An experiment, see
    `add_experiment_file`, is given by ``--cfg`` or as the one word that is no override.
    """
    arguments, rest = parser.parse_known_args(argv)
    unknown = [text for text in rest if text.startswith("-") or not hasattr(arguments, "overrides")]
    if not unknown and hasattr(arguments, "words"):
        arguments.words = [*arguments.words, *rest]
    elif not unknown and hasattr(arguments, "overrides"):
        words = [*arguments.overrides, *rest]
        arguments.overrides = [word for word in words if is_override(word)]
        unknown = [word for word in words if not is_override(word)]
    if hasattr(arguments, "experiment_needed"):
        if arguments.cfg is None and unknown and not unknown[0].startswith("-"):
            arguments.cfg = unknown.pop(0)
        if arguments.cfg is None and not unknown and arguments.experiment_needed:
            parser.error("no experiment: give its file")
    if unknown:
        options = {f"--{name.replace('_', '-')}" for name in vars(arguments)}
        near = did_you_mean(unknown[0], options - _HIDDEN) if unknown[0].startswith("--") else ""
        hint = f"; {near}" if near.startswith("did you mean") else ""
        if unknown[0].startswith("--override"):
            hint = "; write KEY=VALUE alone"
        parser.error(f"unrecognized arguments: {' '.join(unknown)}{hint}")
    return arguments


def is_override(word: str) -> bool:
    """Return whether a word of a command line is ``KEY=VALUE`` or ``~KEY``, and no file."""
    return word.startswith("~") or ("=" in word and not Path(word).exists())


def add_experiment_file(parser: argparse.ArgumentParser, *, needed: bool = True) -> None:
    """Add an experiment, which `parse_arguments` takes from ``--cfg`` or from the words, and overrides.

    Args:
        parser: The command's.
        needed: Whether the command line is refused without one.
    """
    parser.add_argument(
        "overrides", nargs="*", default=[], metavar="FILE|KEY=VALUE", help="experiment file, or id of a task; and "
        "KEY=VALUE to replace a value by its dotted path, or ~KEY to remove it",
    )  # fmt: skip
    parser.add_argument("--cfg", metavar="FILE", help="another way to give the experiment")
    parser.set_defaults(experiment_needed=needed)


def add_overrides(parser: argparse.ArgumentParser) -> None:
    """Add overrides of a configuration that another argument names."""
    parser.add_argument(
        "overrides", nargs="*", default=[], metavar="KEY=VALUE", help="replaces a value, by its dotted path; ~KEY "
        "removes it",
    )  # fmt: skip


def add_experiment_arguments(parser: argparse.ArgumentParser, *, needed: bool = True) -> None:
    """Add what names an experiment, see `add_experiment_file`, and the compute platform."""
    add_experiment_file(parser, needed=needed)
    parser.add_argument(
        "--compute-platform", default="local", metavar="NAME", help="which of the task's rllib_configs (default: local)"
    )


def command_of(module: str, function: str) -> Callable[[argparse.Namespace], int]:
    """Return a function of a module of `cli.commands`, which loads all that the command needs when it runs."""

    def run(arguments: argparse.Namespace) -> int:
        command: Callable[[argparse.Namespace], int] = getattr(
            importlib.import_module(f"safe_inspect.cli.commands.{module}"), function
        )
        return command(arguments)

    return run


def run_command(command: Callable[[argparse.Namespace], int], arguments: argparse.Namespace) -> int:
    """Run a command; return its exit code, which is 128 and the number of the signal that has stopped it.

    A mistake of the user's, a full disk and an interruption are printed without a traceback.
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # an ASCII terminal and a name with an umlaut
            stream.reconfigure(errors="backslashreplace")
    try:
        with handled():
            code = command(arguments)
            sys.stdout.flush()
            return code
    except SafeInspectError as error:
        _print_error(f"error: {error}" if "\n" not in str(error) else f"errors:\n{error}")
        return USER_ERROR
    except KeyboardInterrupt as stop:
        _print_error("; ".join(["interrupted", *getattr(stop, "__notes__", ())]))
        return 128 + (stop.number if isinstance(stop, Interrupted) else signal.SIGINT)
    except BrokenPipeError:  # of `| head`
        _discard_output()
        return 0
    except OSError as error:
        if error.errno not in NO_SPACE:
            raise
        _discard_output()
        _print_error(f"error: {cannot_write(error.filename or 'standard output', error, 'write elsewhere')}")
        return USER_ERROR


def _print_error(text: str) -> None:
    with suppress(OSError):  # nobody may be there to read it
        print(text, file=sys.stderr)


def _discard_output() -> None:
    """Let what is still to be printed go nowhere: Python writes it at its end, and would complain."""
    with suppress(OSError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
