"""Types of command line arguments that are shared by several commands."""

from __future__ import annotations

import argparse
import math
from pathlib import Path


def add_output_folder(parser: argparse.ArgumentParser, about: str, *, required: bool = False) -> None:
    """Add ``--output`` for a folder that `safe_inspect.outputs.new_folder` writes, and ``--force``.

    Args:
        parser: Parser of the command.
        about: Contents of the folder, for the help text.
        required: Whether the option is required.
    """
    parser.add_argument(
        "--output", type=Path, required=required, metavar="FOLDER", help=f"write {about} into this new folder"
    )
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
