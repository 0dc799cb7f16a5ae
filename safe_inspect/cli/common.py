"""What the commands share: how a command line is parsed, and what becomes of mistakes and interruptions."""

from __future__ import annotations

import argparse
import importlib
import os
import signal
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress

from safe_inspect.errors import SafeInspectError
from safe_inspect.interrupts import Interrupted, handled
from safe_inspect.outputs import NO_SPACE, cannot_write

USER_ERROR = 2


def parse_arguments(parser: argparse.ArgumentParser, argv: Sequence[str] | None) -> argparse.Namespace:
    """Parse a command line whose overrides may stand anywhere; argparse alone takes them before the options only."""
    arguments, rest = parser.parse_known_args(argv)
    unknown = [text for text in rest if text.startswith("-") or "=" not in text or not hasattr(arguments, "overrides")]
    if unknown:
        parser.error(f"unrecognized arguments: {' '.join(unknown)}")
    if rest:
        arguments.overrides = [*arguments.overrides, *rest]
    return arguments


def add_experiment_arguments(parser: argparse.ArgumentParser, *, positional: bool) -> None:
    """Add what names an experiment: its file, overrides and the compute platform."""
    if positional:
        parser.add_argument("cfg", metavar="CFG", help="experiment file")
    else:
        parser.add_argument("--cfg", metavar="CFG", help="experiment file")
    parser.add_argument("overrides", nargs="*", metavar="KEY=VALUE", help="replaces a value, by its dotted path")
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
