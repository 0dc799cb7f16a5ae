"""Types of command line arguments that are shared by several commands."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import Any


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
    parser.add_argument(flag, metavar=metavar, help=text, type=kind, default=default, **more)


def add_output_folder(parser: argparse.ArgumentParser, about: str, *, required: bool = False) -> None:
    """Add ``--output`` for a folder that `safe_inspect.outputs.new_folder` writes, and ``--force``.

    Args:
        parser: Parser of the command.
        about: Contents of the folder, for the help text.
        required: Whether the option is required.
    """
    add_option(parser, "--output", "FOLDER", f"write {about} into this new folder", Path, required=required)
    parser.add_argument("--force", action="store_true", help="replace the folder if this command wrote all of it")


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
