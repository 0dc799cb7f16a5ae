"""The command ``safe-inspect baseline``."""

from __future__ import annotations

import argparse
from pathlib import Path

from safe_inspect.cli.arguments import positive, seed
from safe_inspect.cli.common import add_overrides

#: The task that is flown unless another is given.
_DEFAULT_CFG = "safe_inspect/TranslationalInspectionSeed-v0"


def add_baseline_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the baselines."""
    parser.add_argument(
        "kind", metavar="BASELINE", help="optimiser (open-loop plans made with perfect knowledge), zero-thrust, "
        "random, inspector, or the name of any scripted policy",
    )  # fmt: skip
    parser.add_argument(
        "--cfg", metavar="CFG", default=_DEFAULT_CFG, help="experiment file or id (default: %(default)s)"
    )
    add_overrides(parser)
    parser.add_argument("--episodes", type=positive, default=100, help="number of episodes (default: 100)")
    parser.add_argument("--seed", type=seed, default=0, help="seed of the episodes (default: 0)")
    parser.add_argument(
        "--effort", choices=("quick", "normal", "thorough"), help="how long the optimiser searches (default: normal)"
    )
    parser.add_argument("--output", type=Path, metavar="FILE", help="write the result to this file, or go on with it")
    parser.add_argument("--force", action="store_true", help="replace a file that is of another task, seed or effort")
