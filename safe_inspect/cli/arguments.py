"""Command line arguments that several commands have, the types of their values, and what they mean."""

from __future__ import annotations

import argparse
import math
import os
from collections.abc import Mapping
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import Any

from safe_inspect.errors import SafeInspectError
from safe_inspect.outputs import new_folder


def add_option(
    parser: argparse.ArgumentParser,
    flag: str,
    metavar: str,
    about: str,
    kind: Any = None,
    default: Any = None,
    **more: Any,
) -> None:
    """Add an option with a value; the help text ends with the default.

    Args:
        parser: Parser of the command.
        flag: The option, such as ``--seed``.
        metavar: Name of its value.
        about: The help text; it states a default that is not a value itself.
        kind: Function that converts the text. Default: the text itself is the value.
        default: The default.
        more: Further keyword arguments of `argparse.ArgumentParser.add_argument`.
    """
    text = about if default in (None, []) else f"{about} (default: {default})"
    kind = _path if kind is Path else kind
    parser.add_argument(flag, metavar=metavar, help=text, type=kind, default=default, **more)


def _path(text: str) -> Path:
    """Return a path; an empty one, as of an unset variable of the shell, would be the working directory."""
    if not text:
        raise argparse.ArgumentTypeError("the path is empty; name a file or folder")
    return Path(text)


def add_output_folder(parser: argparse.ArgumentParser, about: str, *, required: bool = False) -> None:
    """Add ``--output`` for a folder that `safe_inspect.outputs.new_folder` writes, and ``--force``.

    Args:
        parser: Parser of the command.
        about: Contents of the folder, for the help text.
        required: Whether the option is required.
    """
    add_option(parser, "--output", "FOLDER", f"write {about} into this new folder", Path, required=required)
    parser.add_argument("--force", action="store_true", help="replace the folder if this command wrote all of it")


def output_folder(arguments: argparse.Namespace) -> AbstractContextManager[Path | None]:
    """Return a context with the folder of ``--output`` to write into, see `new_folder`, or None without that option.

    Args:
        arguments: Arguments of a command with `add_output_folder`.
    """
    if arguments.output is None:
        return nullcontext()
    return new_folder(arguments.output, arguments.command, force=arguments.force)


def add_experiment_arguments(parser: argparse.ArgumentParser, *, needed: bool = True, platform: bool = True) -> None:
    """Add an experiment, which the command line gives by ``--cfg`` or as a word, and overrides.

    `safe_inspect.cli.main.parse_arguments` distinguishes the words; the command then calls
    `safe_inspect.config.experiment.load_experiment`, or `load_rendezvous` for a rendezvous.

    Args:
        parser: Parser of the command.
        needed: Whether an experiment is required.
        platform: Whether the experiment has a compute platform; a rendezvous has none.
    """
    parser.add_argument(
        "overrides", nargs="*", default=[], metavar="FILE|KEY=VALUE", help="experiment file, or id of a task; "
        "KEY=VALUE replaces a value by its dotted path, ~KEY removes it",
    )  # fmt: skip
    add_option(parser, "--cfg", "FILE", "the experiment, as an option")
    parser.set_defaults(experiment_needed=needed)
    if platform:
        add_compute_platform(parser)


def add_overrides(parser: argparse.ArgumentParser) -> None:
    """Add overrides of a configuration that is given by another argument."""
    parser.add_argument(
        "overrides", nargs="*", default=[], metavar="KEY=VALUE", help="replaces a value of the configuration by its "
        "dotted path; ~KEY removes it",
    )  # fmt: skip


def add_compute_platform(parser: argparse.ArgumentParser) -> None:
    """Add the compute platform of an experiment."""
    add_option(parser, "--compute-platform", "NAME", "entry of the task's rllib_configs", default="local")


def is_override(word: str) -> bool:
    """Return whether a word of a command line is ``KEY=VALUE`` or ``~KEY``, and not a file."""
    return word.startswith("~") or ("=" in word and not os.path.exists(word))


def equals_hint(word: str) -> str:
    """Return a hint on how to write a word as an override."""
    key, colon, value = word.partition(":")
    return f"did you mean `{key}={value}`?" if colon and value else "write an override as KEY=VALUE"


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


def whole_number(text: str, expected: str, least: int = 0, most: float = math.inf) -> int:
    """Return a whole number within limits.

    Raises:
        ArgumentTypeError: The text is none; the message says what is expected.
    """
    try:
        number = int(text)
    except ValueError:
        number = -1
    if len(text) > 20 or not least <= number <= most:
        raise argparse.ArgumentTypeError(f"expected {expected}, not {text!r}")
    return number


def positive(text: str) -> int:
    """Return a whole number that is at least 1."""
    return whole_number(text, "a whole number of at least 1", least=1)


def natural(text: str) -> int:
    """Return a whole number that is at least 0."""
    return whole_number(text, "a whole number of at least 0")


def seed(text: str) -> int:
    """Return a seed."""
    return whole_number(text, "a whole number from 0 to 2**64 - 1", most=2**64 - 1)


def positive_number(text: str, expected: str = "a positive number") -> float:
    """Return a positive, finite number."""
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not 0.0 < number < math.inf:
        raise argparse.ArgumentTypeError(f"expected {expected}, not {text!r}")
    return number
