"""The commands ``safe-inspect record-log`` and ``safe-inspect characterise``."""

from __future__ import annotations

import argparse
import math

from safe_inspect.cli.arguments import add_output_folder, natural, positive_number
from safe_inspect.cli.common import add_experiment_file, output_folder, print_doubts, print_loading
from safe_inspect.cli.episode_bar import EpisodeBar
from safe_inspect.errors import SafeInspectError
from safe_inspect.figures.drawing import save
from safe_inspect.figures.rendezvous.estimate_figure import estimate_figure
from safe_inspect.plugins.registry import registry
from safe_inspect.rendezvous.experiment import load_rendezvous, read_target
from safe_inspect.rendezvous.missions.scenario import check_scenario
from safe_inspect.rendezvous.plugins import FrontEnd, PipelineEstimator
from safe_inspect.rendezvous.recording.estimation import (
    estimate_log,
    estimate_table,
    in_principal_axes,
    mating_point_text,
    pick_point,
    summary_of,
    write_estimate,
)
from safe_inspect.rendezvous.recording.plausibility import check_log
from safe_inspect.rendezvous.recording.reader import read_sensor_log
from safe_inspect.rendezvous.recording.record import record_watch

FIGURE = "estimate.png"


def add_record_log_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``record-log``."""
    add_experiment_file(parser)
    add_output_folder(parser, "the log", required=True)
    parser.add_argument(
        "--seconds", type=positive_number, default=120.0, metavar="SECONDS", help="length of the log (default: 120)"
    )
    parser.add_argument(
        "--period", type=positive_number, default=1.0, metavar="SECONDS", help="time between two frames (default: 1)"
    )
    parser.add_argument(
        "--mission", type=natural, default=0, metavar="N", help="draw the tumble of mission N (default: 0)"
    )
    parser.add_argument("--images", choices=("npz", "png"), default="npz", help="format of the frames (default: npz)")


def add_characterise_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``characterise``."""
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


def run_record_log(arguments: argparse.Namespace) -> int:
    """Record the sensors during a simulated observation of a target."""
    print_loading()
    experiment = load_rendezvous(arguments.cfg, arguments.overrides)
    print_doubts(check_scenario(experiment))
    config = experiment.config
    steps = arguments.period / config.mission.step
    if round(steps) < 1 or abs(steps - round(steps)) > 1e-6:
        raise SafeInspectError(
            f"--period {arguments.period:g} is not a multiple of the control step, {config.mission.step:g} s; round it"
        )
    sensors = config.sensors.model_copy(update={"frame_period": arguments.period})
    config = config.model_copy(update={"sensors": sensors})
    with EpisodeBar("frames") as bar, output_folder(arguments) as folder:
        assert folder is not None, "--output is required"
        count = record_watch(folder, config, arguments.mission, arguments.seconds, arguments.images, bar.show)
    print(f"{count} frames are in {arguments.output}")
    return 0


def run_characterise(arguments: argparse.Namespace) -> int:
    """Estimate the tumbling motion of a target, and write and print the results."""
    print_loading()
    log = read_sensor_log(arguments.folder)
    print_doubts(check_log(log))
    target = None if arguments.target is None else read_target(arguments.target)
    name = arguments.front_end or ("GicpSubmapFrontEnd" if target is None else "ModelFrontEnd")
    front_end: FrontEnd = registry.get("front_end", name)()
    picked = None if arguments.pick is None else _picked(arguments.pick)
    above = None if picked is None else pick_point(log, *picked)
    with output_folder(arguments) as folder:
        with EpisodeBar("frames") as bar:
            bar.show(0, len(log))
            estimate = estimate_log(log, PipelineEstimator(front_end=front_end), target, bar.show)
        if folder is not None:
            write_estimate(folder, log, estimate)
            save(estimate_figure(log, estimate), folder / FIGURE)
    print(estimate_table(summary_of(log, estimate)))
    if picked is not None and above is not None:
        point = in_principal_axes(log, estimate, picked[0], above)
        print(f"mating_point: {mating_point_text(point)}  # in the estimated principal axes")
    if arguments.output is not None:
        print(f"the estimate is in {arguments.output}")
    return 0


def _picked(text: str) -> tuple[int, int, int, float]:
    parts = text.split(",")
    try:
        frame, column, row = (int(part) for part in parts[:3])
        (distance,) = (float(part) for part in parts[3:])
        if not math.isfinite(distance):
            raise ValueError
    except ValueError:
        raise SafeInspectError(
            f"--pick {text!r}: expected frame, column, row and distance, such as --pick 12,80,90,0.3"
        ) from None
    return frame, column, row, distance
