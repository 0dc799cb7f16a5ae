"""The command ``safe-inspect leaderboard``."""

from __future__ import annotations

import argparse
from pathlib import Path

from safe_inspect.cli.arguments import positive


def add_leaderboard_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the leaderboard."""
    parser.add_argument(
        "files", nargs="*", type=Path, metavar="FILE", help="YAML files of boards; a further file adds its rows to the "
        "boards of the same title (default: configs/leaderboard.yml)",
    )  # fmt: skip
    parser.add_argument("--output", type=Path, metavar="FILE", help="write the page to this Markdown file")
    parser.add_argument(
        "--results", type=Path, metavar="FOLDER", default=Path("output/leaderboard"), help="where the episodes of "
        "every row are kept; a row that stands there and is the same is not flown again (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument("--board", action="append", default=[], metavar="TITLE", help="only this board")
    parser.add_argument("--episodes", type=positive, help="in place of the number of the files, for a quick look")
    parser.add_argument("--num-envs", type=positive, default=256, help="episodes at a time (default: 256)")
