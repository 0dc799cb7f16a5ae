"""Code that the commands share: parsing of the command line, and handling of mistakes and interruptions."""

from __future__ import annotations

import argparse
import importlib
import inspect
import os
import re
import signal
import sys
import traceback
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NoReturn

from safe_inspect.cli.arguments import add_option
from safe_inspect.cli.streams import discard_output, lasting_streams, print_error, without_long_words
from safe_inspect.errors import RAISED_IN, Problem, SafeInspectError, did_you_mean
from safe_inspect.interrupts import Interrupted, handled
from safe_inspect.outputs import NO_SPACE, cannot_write, new_folder

EXIT_CODES = "Exit codes: 0 success; 1 negative result; 2 mistake in the input; 128 + N after signal N (130: Ctrl-C)."
_USER_ERROR = 2
_PACKAGE = os.path.dirname(os.path.dirname(__file__)) + os.sep
#: Names of parsed arguments that are not options.
_HIDDEN = {"--overrides", "--words", "--run", "--command", "--experiment-needed", "--source", "--sources"}


class Parser(argparse.ArgumentParser):
    """A parser that prints a mistake as one line; the parsers of subcommands are of this class too.

    Args:
        command: Name of a command, whose module in `cli.commands` adds its arguments by ``add_arguments``, or by
            `add_experiment_arguments` if there is none, and runs it by ``run``; the docstring of the latter is the help
            of the command. The module is imported when a command line is parsed, so that other commands and the list of
            commands do not import it. None for a parser with subcommands.
        options: Keyword arguments of `argparse.ArgumentParser`.
    """

    def __init__(self, *, command: str | None = None, **options: Any) -> None:
        super().__init__(formatter_class=argparse.RawDescriptionHelpFormatter, **options)
        self._command = command

    def load(self) -> None:
        """Import the command and add its arguments, unless this has been done."""
        if self._command is None:
            return
        name, self._command = self._command, None
        module = importlib.import_module(f"safe_inspect.cli.commands.{name.replace('-', '_')}")
        getattr(module, "add_arguments", add_experiment_arguments)(self)
        self.set_defaults(run=module.run)
        self.description, _, example = (inspect.getdoc(module.run) or "").partition("\n\nExample:\n")
        self.epilog = f"Example:\n{example}\n\n{EXIT_CODES}\nDocumentation: docs/cli.md#{name}"

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Load the command, then parse."""
        self.load()
        return super().parse_known_args(args, namespace)

    @property
    def has_commands(self) -> bool:
        """Whether the parser has subcommands."""
        return self._subparsers is not None

    def check_option(self, word: str) -> None:
        """Raise an error for an unknown option in place of a command."""
        known = list(self._option_string_actions)
        if word != "--" and not any(option.startswith(word.partition("=")[0]) for option in known):
            near = did_you_mean(word, known) if word.startswith("--") else "known: --help, --version"
            self.error(f"unrecognized arguments: {word}; {near}")

    def error(self, message: str, command: str = "") -> NoReturn:
        """Print the mistake and a reference to the help, of a subcommand if it is given, and exit."""
        mistyped = re.fullmatch(r"argument COMMAND: invalid choice: '(.*?)' \(choose from (.*)\)", message)
        if mistyped:
            commands = [name.strip(" '") for name in mistyped[2].split(",")]
            message = f"there is no command {mistyped[1]!r}; {did_you_mean(mistyped[1], commands)}"
        named = f"{self.prog} {command}" if command and self.has_commands else self.prog
        self.exit(_USER_ERROR, f"error: {without_long_words(message)}; see `{named} --help`\n")


def parse_arguments(parser: Parser, argv: Sequence[str] | None) -> argparse.Namespace:
    """Parse a command line.

    Overrides may be given anywhere; argparse itself only accepts them before the options. The experiment, see
    `add_experiment_file`, is given by ``--cfg`` or as the only word that is not an override.
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
            parser.error("no experiment: give an experiment file")
    if getattr(arguments, "force", False) and getattr(arguments, "output", None) is None:
        parser.error("--force needs --output; give --output, or remove --force")
    if unknown:
        options = {f"--{name.replace('_', '-')}" for name in vars(arguments)}
        near = did_you_mean(unknown[0], options - _HIDDEN) if unknown[0].startswith("--") else ""
        hint = f"; {near}" if near.startswith("did you mean") else ""
        if unknown[0].startswith("--override"):
            hint = "; write only KEY=VALUE"
        elif unknown[0].partition("=")[0] == "--policy" and not hint:
            hint = "; write the name of the policy, or its file or folder, without --policy"
        elif not hint and unknown[0].startswith("--") and hasattr(arguments, "overrides"):
            key, _, value = unknown[0].lstrip("-").partition("=")
            hint = f"; to override a value, write {key}={value or 'VALUE'} without dashes"
        elif not is_option(unknown[0]):
            hint = f"; {equals_hint(unknown[0])}"
        parser.error(f"unrecognized arguments: {' '.join(unknown)}{hint}", getattr(arguments, "command", ""))
    return arguments


def equals_hint(word: str) -> str:
    """Return a hint on how to write a word as an override."""
    key, colon, value = word.partition(":")
    return f"did you mean `{key}={value}`?" if colon and value else "write an override as KEY=VALUE"


def is_override(word: str) -> bool:
    """Return whether a word of a command line is ``KEY=VALUE`` or ``~KEY``, and not a file."""
    return word.startswith("~") or ("=" in word and not os.path.exists(word))


def add_experiment_file(parser: argparse.ArgumentParser, *, needed: bool = True) -> None:
    """Add an experiment, which `parse_arguments` reads from ``--cfg`` or from the words, and overrides.

    Args:
        parser: Parser of the command.
        needed: Whether an experiment is required.
    """
    parser.add_argument(
        "overrides", nargs="*", default=[], metavar="FILE|KEY=VALUE", help="experiment file, or id of a task; "
        "KEY=VALUE replaces a value by its dotted path, ~KEY removes it",
    )  # fmt: skip
    add_option(parser, "--cfg", "FILE", "the experiment, as an option")
    parser.set_defaults(experiment_needed=needed)


def add_overrides(parser: argparse.ArgumentParser) -> None:
    """Add overrides of a configuration that is given by another argument."""
    parser.add_argument(
        "overrides", nargs="*", default=[], metavar="KEY=VALUE", help="replaces a value of the configuration by its "
        "dotted path; ~KEY removes it",
    )  # fmt: skip


def add_experiment_arguments(parser: argparse.ArgumentParser, *, needed: bool = True) -> None:
    """Add an experiment, see `add_experiment_file`, and the compute platform."""
    add_experiment_file(parser, needed=needed)
    add_compute_platform(parser)


def add_compute_platform(parser: argparse.ArgumentParser) -> None:
    """Add the compute platform of an experiment."""
    add_option(parser, "--compute-platform", "NAME", "entry of the task's rllib_configs", default="local")


def refuse_options(options: Mapping[str, Any], why: str, *, source: object = "") -> None:
    """Raise an error for an option that is given but has no effect.

    Args:
        options: The value of each option by its name.
        why: Why it has none, after the option's name.
        source: File or folder to which this applies, if it is to be named.

    Raises:
        SafeInspectError: An option has a value that is true.
    """
    for option, value in options.items():
        if value:
            raise SafeInspectError(f"{source}{': ' if source else ''}{option} {why}; remove it")


def print_loading() -> None:
    """Print to standard error that a command with missions needs some time before it starts."""
    print_error("loading; the first run on a machine compiles for a minute")


@contextmanager
def output_folder(arguments: argparse.Namespace) -> Iterator[Path | None]:
    """Yield the folder of ``--output`` to write into, see `new_folder`, or None without that option.

    Args:
        arguments: Arguments of a command with `add_output_folder`.
    """
    if arguments.output is None:
        yield None
        return
    with new_folder(arguments.output, arguments.command, force=arguments.force) as folder:
        yield folder


def run_command(parser: Parser, argv: Sequence[str] | None) -> int:
    """Run a command line; return its exit code, which is 128 plus the number of the signal if one has stopped it.

    A mistake of the user, a full disk and an interruption are printed without a traceback.

    Args:
        parser: Parser of the command line.
        argv: Words of the command line. Default: those of the process.
    """
    try:
        with handled(), _plain_warnings(), lasting_streams():
            arguments = parse_arguments(parser, argv)
            _check_working_directory()
            return int(arguments.run(arguments))
    except SafeInspectError as error:
        print_error(f"error: {error}" if "\n" not in str(error) else f"errors:\n{error}")
        return _USER_ERROR
    except KeyboardInterrupt as stop:
        print_error("; ".join(["interrupted", *getattr(stop, "__notes__", ())]))
        return 128 + (stop.number if isinstance(stop, Interrupted) else signal.SIGINT)
    except BrokenPipeError:  # the reader of standard error has left
        return 0
    except Exception as error:  # raised again, unless it is a mistake of the user
        text = _explained(error)
        if not text:
            raise
        print_error(text)
        return _USER_ERROR


def _explained(error: Exception) -> str:
    """Return the message for an error that a plugin raised, or for a full disk; empty for any other error."""
    note = next((note for note in getattr(error, "__notes__", ()) if note.startswith(RAISED_IN)), "")
    if note:  # with the calls in files of the user
        own = (_PACKAGE, f"{os.sep}site-packages{os.sep}", f"{os.sep}lib{os.sep}python", "<")
        frames = traceback.extract_tb(error.__traceback__)
        calls = traceback.format_list([call for call in frames if not any(part in call.filename for part in own)])
        fix = "fix it, and test it with safe_inspect.testing.check_plugin"
        return f"{''.join(calls)}error: {type(error).__name__}: {error}; {note}; {fix}"
    if isinstance(error, OSError) and error.errno in NO_SPACE:
        discard_output()
        return f"error: {cannot_write(error.filename or 'standard output', error, 'write elsewhere')}"
    return ""


def _check_working_directory() -> None:
    try:
        os.getcwd()
    except FileNotFoundError:
        raise SafeInspectError("the working directory has been removed; change to an existing one") from None


@contextmanager
def _plain_warnings() -> Iterator[None]:
    """Print warnings to users as one line, without the location in the source code that raised them."""
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
    """Print permitted settings that may be mistakes to standard error, one per line."""
    for doubt in doubts:
        print_error(f"warning: {doubt}")
