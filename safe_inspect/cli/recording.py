"""The commands ``safe-inspect record-log`` and ``safe-inspect characterise``."""

from __future__ import annotations

import argparse

from safe_inspect.cli.arguments import add_output_folder, natural, positive_number
from safe_inspect.cli.common import add_experiment_file


def add_record_log_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the recording of a sensor log."""
    add_experiment_file(parser)
    add_output_folder(parser, "the log", required=True)
    parser.add_argument("--seconds", type=positive_number, default=120.0, metavar="S", help="length (default: 120)")
    parser.add_argument(
        "--period", type=positive_number, default=1.0, metavar="S", help="time between two frames (default: 1)"
    )
    parser.add_argument(
        "--mission", type=natural, default=0, metavar="N", help="draw the tumble of mission N (default: 0)"
    )
    parser.add_argument("--images", choices=("npz", "png"), default="npz", help="format of the frames (default: npz)")


def add_characterise_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the estimation on a sensor log."""
    parser.add_argument("folder", metavar="FOLDER", help="folder of a sensor log")
    parser.add_argument(
        "--target",
        metavar="FILE",
        help="known target: a YAML file with the key `target`, such as an experiment, or a mesh (STL, PLY or OBJ)",
    )
    parser.add_argument(
        "--front-end", metavar="NAME", help="front end (default: ModelFrontEnd with a target, else GicpSubmapFrontEnd)"
    )
    parser.add_argument(
        "--pick",
        metavar="FRAME,COLUMN,ROW,DISTANCE",
        help="print the mating point at a distance [m] above what a pixel of a frame sees",
    )
    add_output_folder(parser, "estimate, tables and figure")
