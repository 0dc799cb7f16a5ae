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


def positive(text: str) -> int:
    """Return a whole number that is at least 1."""
    try:
        number = int(text)
    except ValueError:
        number = 0
    if number < 1:
        raise argparse.ArgumentTypeError(f"expected a whole number of at least 1, not {text!r}")
    return number


def seed(text: str) -> int:
    """Return a seed."""
    if not text.isdecimal() or len(text) > 20 or int(text) >= 2**64:
        raise argparse.ArgumentTypeError(f"expected a whole number from 0 to 2**64 - 1, not {text!r}")
    return int(text)


def natural(text: str) -> int:
    """Return a whole number that is at least 0."""
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"expected a whole number of at least 0, not {text!r}")
    return int(text)


def positive_number(text: str) -> float:
    """Return a positive, finite number."""
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not 0.0 < number < math.inf:
        raise argparse.ArgumentTypeError(f"expected a positive number, not {text!r}")
    return number
