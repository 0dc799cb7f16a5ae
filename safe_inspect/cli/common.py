"""What the commands share: how a command line is parsed, and what becomes of mistakes and interruptions."""

from __future__ import annotations

import argparse
import importlib
import io
import os
import re
import signal
import sys
import warnings
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NoReturn

from safe_inspect.errors import Problem, SafeInspectError, did_you_mean
from safe_inspect.interrupts import Interrupted, handled
from safe_inspect.outputs import NO_SPACE, cannot_write, new_folder

_USER_ERROR = 2
#: Names of parsed arguments that are no options.
_HIDDEN = {"--overrides", "--words", "--run", "--command", "--experiment-needed", "--source", "--sources"}


class Parser(argparse.ArgumentParser):
    """A parser whose mistakes are one line; those of subcommands are of this class too.

    Args:
        command: A module of `cli.commands` and the name of a command in it, of which ``add_NAME_arguments`` adds the
            arguments and ``run_NAME`` is what it does. The module is imported when a command line is parsed, so that
            neither other commands nor the list of all wait for what it needs. None for a parser with subcommands.
        options: Those of `argparse.ArgumentParser`.
    """

    def __init__(self, *, command: tuple[str, str] | None = None, **options: Any) -> None:
        super().__init__(**options)
        self._command = command

    def load(self) -> None:
        """Import the command and add its arguments; do nothing the second time."""
        if self._command is None:
            return
        (module, name), self._command = self._command, None
        commands, name = importlib.import_module(f"safe_inspect.cli.commands.{module}"), name.replace("-", "_")
        getattr(commands, f"add_{name}_arguments")(self)
        self.set_defaults(run=getattr(commands, f"run_{name}"))

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Load the command, then parse."""
        self.load()
        return super().parse_known_args(args, namespace)

    @property
    def has_commands(self) -> bool:
        """Whether it has subcommands."""
        return self._subparsers is not None

    def check_option(self, word: str) -> None:
        """Refuse an option in place of a command that is not one of the parser's own."""
        known = list(self._option_string_actions)
        if word != "--" and not any(option.startswith(word.partition("=")[0]) for option in known):
            near = did_you_mean(word, known) if word.startswith("--") else "known: --help, --version"
            self.error(f"unrecognized arguments: {word}; {near}")

    def error(self, message: str) -> NoReturn:
        """Print the mistake and where help is, and exit."""
        mistyped = re.fullmatch(r"argument COMMAND: invalid choice: '(.*?)' \(choose from (.*)\)", message)
        if mistyped:
            commands = [name.strip(" '") for name in mistyped[2].split(",")]
            message = f"there is no command {mistyped[1]!r}; {did_you_mean(mistyped[1], commands)}"
        self.exit(_USER_ERROR, f"error: {_shortened(message)}; see `{self.prog} --help`\n")


def parse_arguments(parser: Parser, argv: Sequence[str] | None) -> argparse.Namespace:
    """Parse a command line.

    Overrides may stand anywhere; argparse alone takes them before the options only. An experiment, see
    `add_experiment_file`, is given by ``--cfg`` or as the one word that is no override.
    """
    words = list(sys.argv[1:] if argv is None else argv)
    words = [*words[1:2], "--help"] if words[:1] == ["help"] and parser.has_commands else words
    if parser.has_commands and words and words[0].startswith("-"):
        parser.check_option(words[0])
    arguments: argparse.Namespace
    arguments, rest = parser.parse_known_args(words)
    verbatim = words[words.index("--") + 1 :] if "--" in words else []

    def is_option(word: str) -> bool:
        return word.startswith("-") and word not in verbatim

    unknown = [text for text in rest if is_option(text) or not hasattr(arguments, "overrides")]
    if not unknown and hasattr(arguments, "words"):
        arguments.words = [*arguments.words, *rest]
    elif not unknown and hasattr(arguments, "overrides"):
        words = [*arguments.overrides, *rest]
        arguments.overrides = [word for word in words if is_override(word)]
        unknown = [word for word in words if not is_override(word)]
    if hasattr(arguments, "experiment_needed"):
        if arguments.cfg is None and unknown and not is_option(unknown[0]):
            arguments.cfg = unknown.pop(0)
        if arguments.cfg is None and not unknown and arguments.experiment_needed:
            parser.error("no experiment: give its file")
    if getattr(arguments, "force", False) and getattr(arguments, "output", None) is None:
        parser.error("--force replaces what --output names; give --output, or leave --force out")
    if unknown:
        options = {f"--{name.replace('_', '-')}" for name in vars(arguments)}
        near = did_you_mean(unknown[0], options - _HIDDEN) if unknown[0].startswith("--") else ""
        hint = f"; {near}" if near.startswith("did you mean") else ""
        if unknown[0].startswith("--override"):
            hint = "; write KEY=VALUE alone"
        elif not is_option(unknown[0]):
            hint = f"; {equals_hint(unknown[0])}"
        parser.error(f"unrecognized arguments: {' '.join(unknown)}{hint}")
    return arguments


def equals_hint(word: str) -> str:
    """Return how to write a word as an override."""
    key, colon, value = word.partition(":")
    return f"did you mean `{key}={value}`?" if colon and value else "values are replaced by KEY=VALUE"


def is_override(word: str) -> bool:
    """Return whether a word of a command line is ``KEY=VALUE`` or ``~KEY``, and no file."""
    return word.startswith("~") or ("=" in word and not os.path.exists(word))


def add_experiment_file(parser: argparse.ArgumentParser, *, needed: bool = True) -> None:
    """Add an experiment, which `parse_arguments` takes from ``--cfg`` or from the words, and overrides.

    Args:
        parser: The command's.
        needed: Whether the command line is refused without one.
    """
    parser.add_argument(
        "overrides", nargs="*", default=[], metavar="FILE|KEY=VALUE", help="experiment file, or id of a task; "
        "KEY=VALUE replaces a value by its dotted path, ~KEY removes it",
    )  # fmt: skip
    parser.add_argument("--cfg", metavar="FILE", help="the experiment, as an option")
    parser.set_defaults(experiment_needed=needed)


def add_overrides(parser: argparse.ArgumentParser) -> None:
    """Add overrides of a configuration that another argument names."""
    parser.add_argument(
        "overrides", nargs="*", default=[], metavar="KEY=VALUE", help="replaces a value of the configuration by its "
        "dotted path; ~KEY removes it",
    )  # fmt: skip


def add_experiment_arguments(parser: argparse.ArgumentParser, *, needed: bool = True) -> None:
    """Add what names an experiment, see `add_experiment_file`, and the compute platform."""
    add_experiment_file(parser, needed=needed)
    parser.add_argument(
        "--compute-platform", default="local", metavar="NAME", help="entry of the task's rllib_configs (default: local)"
    )


def print_loading() -> None:
    """Print on the standard error that a command which flies missions needs some time before it does."""
    with suppress(OSError):
        print("loading; compiling takes a minute where this machine has not done it yet", file=sys.stderr, flush=True)


@contextmanager
def output_folder(arguments: argparse.Namespace) -> Iterator[Path | None]:
    """Give the folder of ``--output`` to write into, see `new_folder`; None without that option.

    Args:
        arguments: Those of a command with `add_output_folder`.
    """
    if arguments.output is None:
        yield None
        return
    with new_folder(arguments.output, arguments.command, force=arguments.force) as folder:
        yield folder


def run_command(parser: Parser, argv: Sequence[str] | None) -> int:
    """Run a command line; return its exit code, which is 128 and the number of the signal that has stopped it.

    A mistake of the user's, a full disk and an interruption are printed without a traceback.

    Args:
        parser: Its parser.
        argv: Its words; None for those of the process.
    """
    _open_closed_streams()
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # an ASCII terminal and a name with an umlaut
            stream.reconfigure(errors="backslashreplace")
    try:
        with handled(), _plain_warnings():
            arguments = parse_arguments(parser, argv)
            _check_working_directory()
            code: int = arguments.run(arguments)
            sys.stdout.flush()
            return code
    except SafeInspectError as error:
        _print_error(f"error: {error}" if "\n" not in str(error) else f"errors:\n{error}")
        return _USER_ERROR
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
        return _USER_ERROR


def _check_working_directory() -> None:
    try:
        os.getcwd()
    except FileNotFoundError:
        raise SafeInspectError("the working directory has been removed; change to one that exists") from None


@contextmanager
def _plain_warnings() -> Iterator[None]:
    """Print warnings to users as one line, without the place in the source code that raised them."""
    before = warnings.formatwarning

    def line(message: Warning | str, category: type[Warning], *place: Any) -> str:
        is_plain = issubclass(category, UserWarning | FutureWarning)
        return f"warning: {message}\n" if is_plain else before(message, category, *place)

    warnings.formatwarning = line  # type: ignore[assignment]
    try:
        yield
    finally:
        warnings.formatwarning = before


def print_doubts(doubts: Iterable[Problem]) -> None:
    """Print what is allowed and may be a mistake, a line each, on the standard error."""
    for doubt in doubts:
        _print_error(f"warning: {doubt}")


def _open_closed_streams() -> None:
    """Let what is printed to a closed standard output or error go nowhere; no file may take its descriptor."""
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115


def _print_error(text: str) -> None:
    with suppress(OSError):  # nobody may be there to read it
        print(_shortened(text), file=sys.stderr)


def _shortened(text: str) -> str:
    """Return a message without words of a thousand letters or more, such as the digits of a number."""
    return re.sub(r"\S{1000,}", lambda word: f"{word[0][:57]}...", text)


def _discard_output() -> None:
    """Let what is still to be printed go nowhere: Python writes it at its end, and would complain."""
    with suppress(OSError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
