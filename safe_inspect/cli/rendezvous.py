"""The command ``safe-inspect rendezvous``."""

from __future__ import annotations

import argparse

from safe_inspect.cli.arguments import add_output_folder, positive
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
    parser.add_argument("--workers", type=positive, metavar="N", help="missions flown at a time (default: 1)")
    add_output_folder(parser, "the log, or the logs of --missions, which continue in the same folder,")
    parser.add_argument("--dry-run", action="store_true", help="print the resolved experiment, and fly nothing")
