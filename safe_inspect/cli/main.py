"""The command ``safe-inspect``: train, evaluate and draw policies, check experiments and safety filters.

`run_command` parses the words, imports the module of the command from `safe_inspect.cli.commands` and calls its
``run``. It also prints mistakes and interruptions.
"""

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
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Any, NoReturn

from safe_inspect.cli.arguments import add_experiment_arguments, equals_hint, is_override
from safe_inspect.cli.streams import discard_output, lasting_streams, print_error, without_long_words
from safe_inspect.compiling import announce_compiling
from safe_inspect.errors import RAISED_IN, SafeInspectError, did_you_mean
from safe_inspect.interrupts import Interrupted, handled
from safe_inspect.outputs import NO_SPACE, cannot_write
from safe_inspect.version import __version__

_ABOUT = "Train, evaluate and draw policies, check experiments and safety filters."

#: Description of each command; the docstring of ``run`` in its module of `cli.commands` describes it further.
_COMMANDS = {
    "list": "list tasks, policies, or plugins with their fields, defaults and units",
    "validate": "check an experiment file without loading Ray",
    "schema": "write the JSON schema of a configuration file, for editors",
    "train": "train a policy; the same as python -m safe_inspect.train_rl",
    "warm": "compile ahead what environments need, for a container image or CI",
    "safety": "run adversaries against the safety filter and count violations",
    "bounds": "print what disturbs the motion that the safety filter assumes, and whether that is tolerated",
    "acceptance": "print the share of random initial states that is safe",
    "evaluate": "run episodes of policies and print what they achieve",
    "compare": "compare policies on the same episodes",
    "leaderboard": "run baselines, trained policies and yours on the same episodes, and write a table",
    "baseline": "optimise open-loop plans",
    "rendezvous": "fly to a point on a tumbling target",
    "record-log": "record depth images and inertial samples of a simulated tumbling target",
    "characterise": "estimate from a sensor log how a target tumbles",
    "draw": "draw an episode: the trajectory and its quantities over time",
    "film": "write an animation of an episode (GIF or MP4)",
    "view": "write an episode as an interactive HTML page",
    "curves": "draw learning curves with bands over training seeds",
    "export": "write a trained policy as an ONNX file",
}
_EXIT_CODES = "Exit codes: 0 success; 1 negative result; 2 mistake in the input; 128 + N after signal N (130: Ctrl-C)."
_USER_ERROR = 2
_PACKAGE = os.path.dirname(os.path.dirname(__file__)) + os.sep
#: Names of parsed arguments that are not options.
_HIDDEN = {"--overrides", "--words", "--run", "--command", "--experiment-needed", "--source"}


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; return its exit code: 0, 2 for a mistake of the user, else see `run_command`."""
    with suppress(FileNotFoundError):  # as `python -m` does, for modules with plugins next to the configuration
        sys.path.insert(0, os.getcwd())
    announce_compiling()
    return run_command(command_parser(), argv)


def command_parser() -> Parser:
    """Return the parser of all commands."""
    epilog = f"`safe-inspect COMMAND --help` shows the options of a command and an example.\n\n{_EXIT_CODES}"
    parser = Parser(prog="safe-inspect", description=_ABOUT, epilog=epilog)
    parser.add_argument("--version", action="version", version=f"safe_inspect {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for name, about in _COMMANDS.items():
        commands.add_parser(name, help=about, command=name)
    return parser


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
        self.epilog = f"Example:\n{example}\n\n{_EXIT_CODES}\nDocumentation: docs/cli.md#{name}"

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

    Overrides may be given anywhere; argparse itself only accepts them before the options. The experiment
    (`cli.arguments.add_experiment_arguments`) is given by ``--cfg`` or as the only word that is not an override.
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
        text = f"error: {error}" if "\n" not in str(error) else f"errors:\n{error}"
        print_error("; ".join([text, *_notes(error)]))
        return _USER_ERROR
    except KeyboardInterrupt as stop:
        print_error("; ".join(["interrupted", *_notes(stop)]))
        return 128 + (stop.number if isinstance(stop, Interrupted) else signal.SIGINT)
    except Exception as error:  # raised again, unless it is a mistake of the user
        text = _explained(error)
        if text:
            print_error(text)
            return _USER_ERROR
        if isinstance(error, BrokenPipeError):  # the reader of standard error has left
            return 0
        raise


def _explained(error: Exception) -> str:
    """Return the message for an error that a plugin raised, or for a full disk; empty for any other error."""
    notes = _notes(error)
    raised = next((note for note in notes if note.startswith(RAISED_IN)), "")
    if raised:  # with the calls in files of the user
        own = (_PACKAGE, f"{os.sep}site-packages{os.sep}", f"{os.sep}lib{os.sep}python", "<")
        frames = traceback.extract_tb(error.__traceback__)
        calls = traceback.format_list([call for call in frames if not any(part in call.filename for part in own)])
        fix = "fix it, and test it with safe_inspect.testing.check_plugin"
        message = f"{''.join(calls)}error: {type(error).__name__}: {error}"
        first = [] if raised in message else [raised]  # Ray repeats the notes in the text of an error
        return "; ".join([message, *first, fix, *(note for note in notes if note != raised)])
    if isinstance(error, OSError) and error.errno in NO_SPACE:
        discard_output()
        text = cannot_write(error.filename or "standard output", error, "write elsewhere")
        return "; ".join([f"error: {text}", *notes])
    return ""


def _notes(error: BaseException) -> list[str]:
    """Return the notes that were added to an error."""
    return getattr(error, "__notes__", [])


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


if __name__ == "__main__":
    sys.exit(main())
