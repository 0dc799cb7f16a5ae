"""The command ``safe-inspect rendezvous``."""

from __future__ import annotations

import argparse
from pathlib import Path

from safe_inspect.cli.arguments import positive
from safe_inspect.cli.common import add_experiment_file


def add_rendezvous_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of a rendezvous."""
    add_experiment_file(parser)
    parser.add_argument(
        "--missions",
        type=positive,
        metavar="N",
        help="fly N missions, each with its own random draws; by Ray with address=auto (or HOST:PORT, or local)",
    )
    parser.add_argument(
        "--workers", type=positive, default=1, metavar="N", help="missions flown at a time (default: 1)"
    )
    parser.add_argument(
        "--output",
        type=Path,
        metavar="DIR",
        help="write the logs into this folder; missions that are in it are not flown again",
    )
    parser.add_argument("--dry-run", action="store_true", help="print the resolved experiment, and fly nothing")
