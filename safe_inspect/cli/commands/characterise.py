"""The command ``safe-inspect characterise``."""

from __future__ import annotations

import argparse

from safe_inspect.cli.arguments import add_option, add_output_folder, output_folder
from safe_inspect.cli.episode_bar import EpisodeBar
from safe_inspect.cli.streams import print_doubts, print_loading
from safe_inspect.figures.drawing import save
from safe_inspect.figures.estimate_figure import estimate_figure
from safe_inspect.missions.log_checks import check_log
from safe_inspect.missions.log_estimate import estimate_log, estimate_table, summary_of, write_estimate
from safe_inspect.missions.sensor_log import read_sensor_log
from safe_inspect.plugins.registry import registry
from safe_inspect.rendezvous.experiment import read_target
from safe_inspect.rendezvous.plugins import FrontEnd, PipelineEstimator

_FIGURE = "estimate.png"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``characterise``."""
    add_option(parser, "folder", "FOLDER", "folder of a sensor log")
    target = "known target: a YAML file with the key `target`, such as an experiment, or a mesh (STL, PLY or OBJ)"
    add_option(parser, "--target", "FILE", target)
    front_end = "front end (default: ModelFrontEnd with a target, else GicpSubmapFrontEnd)"
    add_option(parser, "--front-end", "NAME", front_end)
    add_output_folder(parser, "estimate, tables and figure")


def run(arguments: argparse.Namespace) -> int:
    """Estimate from a sensor log how a target tumbles.

    Works on simulated logs and on your own, with or without a model of the target.

    Example:
        safe-inspect characterise output/log --target configs/tumbling-rendezvous/experiment.yml
    """
    print_loading()
    log = read_sensor_log(arguments.folder)
    print_doubts(check_log(log))
    target = None if arguments.target is None else read_target(arguments.target)
    name = arguments.front_end or ("GicpSubmapFrontEnd" if target is None else "ModelFrontEnd")
    front_end: FrontEnd = registry.get("front_end", name)()
    with output_folder(arguments) as folder:
        with EpisodeBar("frames") as bar:
            bar.show(0, len(log))
            estimate = estimate_log(log, PipelineEstimator(front_end=front_end), target, bar.show)
        if folder is not None:
            write_estimate(folder, log, estimate)
            save(estimate_figure(log, estimate), folder / _FIGURE)
    print(estimate_table(summary_of(log, estimate)))
    if arguments.output is not None:
        print(f"the estimate is in {arguments.output}")
    return 0
