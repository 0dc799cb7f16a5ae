"""The command ``train``."""

from __future__ import annotations

import argparse
from pathlib import Path

from safe_inspect.cli.common import add_experiment_arguments


def add_train_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the training."""
    add_experiment_arguments(parser, needed=False)
    parser.add_argument("--output", type=Path, metavar="FOLDER", help="where run folders are made")
    parser.add_argument("--resume", type=Path, metavar="RUN", help="go on with the run in this folder")
    parser.add_argument(
        "--dry-run", action="store_true", help="validate, build, step and print the layout; Ray is not started"
    )
