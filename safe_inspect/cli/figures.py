"""The commands ``safe-inspect draw``, ``film``, ``view`` and ``curves``: pictures of episodes and of trainings."""

from __future__ import annotations

import argparse
from pathlib import Path

from safe_inspect.cli.arguments import positive, seed
from safe_inspect.cli.common import add_overrides


def add_draw_arguments(parser: argparse.ArgumentParser) -> None:
    """Add all arguments of ``draw``."""
    _add_episode_arguments(parser, "episode.png", "figure (.png, .pdf or .svg)")


def add_film_arguments(parser: argparse.ArgumentParser) -> None:
    """Add all arguments of ``film``."""
    _add_episode_arguments(parser, "episode.gif", "film (.gif or .mp4)")
    parser.add_argument("--frames", type=positive, default=200, help="number of pictures (default: 200)")
    parser.add_argument("--fps", type=positive, default=25, help="pictures a second (default: 25)")
    parser.add_argument("--width", type=positive, default=800, help="width in pixels (default: 800)")
    parser.add_argument("--turn", type=float, default=0.0, metavar="DEGREES", help="let the camera go round so far")


def add_view_arguments(parser: argparse.ArgumentParser) -> None:
    """Add all arguments of ``view``."""
    _add_episode_arguments(parser, "episode.html", "page (.html)")
    parser.add_argument("--title", help="title of the page (default: the source, and the episode)")


def add_curves_arguments(parser: argparse.ArgumentParser) -> None:
    """Add all arguments of ``curves``."""
    parser.add_argument(
        "runs", nargs="*", metavar="RUN", help="folders of training runs, of a search or of its trials; those that "
        "differ in their seed alone are one recipe",
    )  # fmt: skip
    parser.add_argument(
        "--label", action="append", default=[], metavar="LABEL", help="once for each RUN, where equal labels make one "
        "recipe, or once for each recipe",
    )  # fmt: skip
    parser.add_argument(
        "--recipe", action="append", default=[], nargs="+", metavar="WORD", help="a label and the RUNs of one recipe"
    )
    parser.add_argument(
        "--centre",
        choices=("mean", "iqm"),
        default="mean",
        help="mean or interquartile mean over seeds (default: mean)",
    )
    parser.add_argument("--each", action="store_true", help="draw every seed too")
    parser.add_argument(
        "--output", type=Path, default=Path("curves.png"), metavar="FILE", help="figure (default: curves.png)"
    )


def _add_episode_arguments(parser: argparse.ArgumentParser, output: str, what: str) -> None:
    parser.add_argument(
        "source", metavar="SOURCE", help="a checkpoint's or a run's folder, an ONNX file, the name of a shipped policy "
        "or of a baseline (inspector, random, zero-thrust), or what `evaluate --record` or `rendezvous --output` wrote",
    )  # fmt: skip
    add_overrides(parser)
    parser.add_argument("--cfg", metavar="CFG", help="experiment file (default: the one the policy was trained with)")
    parser.add_argument("--episode", type=_number, default=0, metavar="K", help="number of the episode (default: 0)")
    parser.add_argument("--seed", type=seed, default=0, help="seed of the episodes (default: 0)")
    parser.add_argument(
        "--until", type=_seconds, metavar="SECONDS", help="show the episode, or the mission, up to this time"
    )
    default = f"(default: {output}, or mission{Path(output).suffix} of a rendezvous)"
    parser.add_argument("--output", type=Path, metavar="FILE", help=f"{what} {default}")


def _number(text: str) -> int:
    if not text.isdecimal() or int(text) >= 2**31:
        raise argparse.ArgumentTypeError(f"a number of an episode from 0 on is wanted, not {text!r}")
    return int(text)


def _seconds(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0.0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"a time above 0 in seconds is wanted, not {text!r}")
    return value
