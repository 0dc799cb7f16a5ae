"""The command ``safe-inspect curves``."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from safe_inspect.cli.arguments import add_option
from safe_inspect.errors import SafeInspectError
from safe_inspect.experiments.modules.run_folder import RunFolder
from safe_inspect.experiments.runs.trials import learning_curves_in, recipes_of
from safe_inspect.figures.drawing import FIGURE_ENDINGS, save
from safe_inspect.figures.learning_curves import curves_figure
from safe_inspect.outputs import check_ending


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add all arguments of ``curves``."""
    runs = "folder of a training run, a search or a trial; runs that differ only in their seed are one recipe"
    parser.add_argument("runs", nargs="*", metavar="RUN", help=runs)
    label = "label: once for each RUN (runs with equal labels are one recipe), or once for each recipe"
    add_option(parser, "--label", "TEXT", label, action="append", default=[])
    centre = "mean or interquartile mean over seeds (default: mean)"
    parser.add_argument("--centre", choices=("mean", "iqm"), default="mean", help=centre)
    parser.add_argument("--each", action="store_true", help="also draw a line for each seed")
    add_option(parser, "--output", "FILE", "figure", Path, Path("curves.png"))


def run(arguments: argparse.Namespace) -> int:
    """Draw learning curves with bands over training seeds.

    Runs that differ only in their seed become one curve.

    Example:
        safe-inspect curves output/RUN_1 output/RUN_2 --output curves.png
    """
    check_ending(arguments.output, FIGURE_ENDINGS, "figure")
    runs = arguments.runs
    if len(runs) > 1 and not arguments.label:  # as in `curves output/*`
        without = [run for run in runs if Path(run).is_dir() and not learning_curves_in(run)]
        for run in without:
            print(f"note: {run} is left out, because it has no progress.csv", file=sys.stderr)
        runs = [run for run in runs if run not in without]
    if not runs:
        raise SafeInspectError("no learning curves: give folders of training runs")
    recipes = recipes_of(runs, arguments.label)
    for label, paths in recipes.items():
        if len({path.resolve() for path in paths}) < len(paths):
            raise SafeInspectError(f"{label}: a run is given twice, but must count once in a band over seeds")
        records = [RunFolder(path.parent).record for path in paths]
        seeds = [json.loads(file.read_text(encoding="utf-8")).get("seed") for file in records if file.is_file()]
        if len(set(seeds)) < len(seeds):
            print(f"note: {label}: runs with the same seed do not count as several seeds; repeat one", file=sys.stderr)
    save(curves_figure(recipes, arguments.centre, each=arguments.each), arguments.output)
    shown = ", ".join(f"{label} ({len(paths)})" for label, paths in recipes.items())
    print(f"{arguments.output}: {shown}")
    return 0
