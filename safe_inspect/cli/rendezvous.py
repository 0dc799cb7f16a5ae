"""The command ``safe-inspect rendezvous``."""

from __future__ import annotations

import argparse
from pathlib import Path

from safe_inspect.cli.arguments import positive


def add_rendezvous_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of a rendezvous."""
    parser.add_argument("cfg", metavar="FILE", help="experiment file")
    parser.add_argument(
        "overrides",
        nargs="*",
        metavar="KEY=VALUE",
        help="replaces a value, by its dotted path; address=auto (or HOST:PORT, or local) flies missions by Ray",
    )
    parser.add_argument("--missions", type=positive, metavar="N", help="fly N missions, each with its own random draws")
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
