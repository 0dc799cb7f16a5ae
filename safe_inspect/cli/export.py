"""The command ``safe-inspect export``."""

from __future__ import annotations

import argparse
from pathlib import Path

from safe_inspect.cli.common import add_overrides


def add_export_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the export."""
    parser.add_argument("checkpoint", metavar="CHECKPOINT", help="folder of a checkpoint, or of a run: its newest one")
    parser.add_argument("--policy", metavar="NAME", help="which policy, where the checkpoint holds several")
    parser.add_argument(
        "--output", type=Path, metavar="FILE", help="the file (default: the policy's name with .onnx, here)"
    )
    parser.add_argument(
        "--cfg", metavar="CFG", help="experiment that it was trained with (default: that of the checkpoint's run)"
    )
    add_overrides(parser)
