"""The commands ``safe-inspect safety`` and ``safe-inspect acceptance``."""

from __future__ import annotations

import argparse
from pathlib import Path

from safe_inspect.cli.arguments import positive, seed


def add_safety_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the safety report, beside those that name an experiment."""
    parser.add_argument("--steps", type=positive, default=1_000_000, help="filtered steps (default: 1000000)")
    parser.add_argument("--num-envs", type=positive, default=1024, help="environments at a time (default: 1024)")
    parser.add_argument("--seed", type=seed, default=0, help="seed of initial states and adversaries (default: 0)")
    parser.add_argument("--off", action="store_true", help="leave the filter as configured instead of enabling it")
    parser.add_argument("--plot", type=Path, metavar="FILE", help="draw the worst episode's safety quantities")
    parser.add_argument(
        "--audit", type=positive, metavar="N",
        help="instead fly states that graze the limits, under this filter and N of random parameters and constraints",
    )  # fmt: skip


def add_acceptance_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the acceptance rates, beside those that name an experiment."""
    parser.add_argument("--draws", type=positive, default=100_000, help="initial states (default: 100000)")
    parser.add_argument("--seed", type=seed, default=0, help="seed of the draws (default: 0)")
    parser.add_argument("--plot", type=Path, metavar="FILE", help="draw the drawn and the accepted states")
