"""The commands ``safe-inspect rendezvous``, ``record-log`` and ``characterise``."""

from __future__ import annotations

import argparse
import math

import numpy as np

from safe_inspect.cli.arguments import add_option, add_output_folder, natural, positive_number
from safe_inspect.cli.common import add_experiment_file, output_folder, print_doubts, print_loading
from safe_inspect.cli.episode_bar import EpisodeBar
from safe_inspect.cli.streams import print_error
from safe_inspect.errors import SafeInspectError
from safe_inspect.figures.drawing import save
from safe_inspect.figures.rendezvous.estimate_figure import estimate_figure
from safe_inspect.missions.log_checks import check_log
from safe_inspect.missions.log_estimate import (
    estimate_log,
    estimate_table,
    summary_of,
    write_estimate,
)
from safe_inspect.missions.mission import Mission
from safe_inspect.missions.scenario import check_scenario
from safe_inspect.missions.sensor_log import read_sensor_log
from safe_inspect.missions.sensor_log_writer import record_watch
from safe_inspect.missions.summary import mission_table
from safe_inspect.plugins.registry import registry
from safe_inspect.rendezvous.coordination.context import MissionContext, Phase
from safe_inspect.rendezvous.experiment import load_rendezvous, read_target
from safe_inspect.rendezvous.plugins import FrontEnd, PipelineEstimator

#: Mission time between two lines of progress [s].
_PERIOD = 10.0


def add_rendezvous_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``rendezvous``."""
    add_experiment_file(parser)
    add_option(parser, "--episode", "N", "fly episode N of an evaluation", natural, 0)
    add_output_folder(parser, "the log")
    parser.add_argument("--dry-run", action="store_true", help="print the resolved experiment and stop")


def run_rendezvous(arguments: argparse.Namespace) -> int:
    """Fly to a point on a tumbling target.

    Prints the course of the mission and its result; exits with 1 if it has failed. `evaluate` flies many.

    Example:
        safe-inspect rendezvous configs/tumbling-rendezvous/experiment-truth.yml --output output/mission
    """
    print_loading()
    experiment = load_rendezvous(arguments.cfg, arguments.overrides)
    print_doubts(check_scenario(experiment, arguments.episode + 1))
    if arguments.dry_run:
        print(experiment.text, end="")
        return 0
    with output_folder(arguments) as folder:
        lines = _MissionLines()
        result = Mission(experiment.config, arguments.episode, lines.change, lines.step).run()
        if folder is not None:
            result.log.write(folder, experiment.text, result.summary)
    print(mission_table(result.summary))
    if arguments.output is not None:
        print(f"the log is in {arguments.output}")
    return 0 if result.summary["success"] else 1


class _MissionLines:
    """Progress of a mission on standard error: changes of state, and a line for every ten seconds of the mission."""

    def __init__(self) -> None:
        self._next = 0.0

    def change(self, time: float, before: Phase, guard: str, after: Phase) -> None:
        """Print a change of state."""
        print_error(f"{time:8.1f} s  {before.value} -> {after.value} ({guard})")

    def step(self, context: MissionContext) -> None:
        """Print the state of the mission, if a line is due."""
        if context.time < self._next:
            return
        self._next = context.time + _PERIOD
        estimate = context.estimate
        distance = float(np.linalg.norm(estimate.relative[:3]))
        known = estimate.problem or (
            f"attitude within {math.degrees(estimate.errors.attitude):.2g} deg, "
            f"rate within {math.degrees(estimate.errors.rate):.2g} deg/s"
        )
        print_error(f"{context.time:8.1f} s  {context.phase.value}, {distance:.2f} m from the target's centre; {known}")


FIGURE = "estimate.png"


def add_record_log_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``record-log``."""
    add_experiment_file(parser)
    add_output_folder(parser, "the log", required=True)
    add_option(parser, "--seconds", "SECONDS", "length of the log", positive_number, 120.0)
    add_option(parser, "--period", "SECONDS", "time between two frames", positive_number, 1.0)
    add_option(parser, "--mission", "N", "draw the tumble of mission N", natural, 0)
    parser.add_argument("--images", choices=("npz", "png"), default="npz", help="format of the frames (default: npz)")


def add_characterise_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``characterise``."""
    add_option(parser, "folder", "FOLDER", "folder of a sensor log")
    target = "known target: a YAML file with the key `target`, such as an experiment, or a mesh (STL, PLY or OBJ)"
    add_option(parser, "--target", "FILE", target)
    front_end = "front end (default: ModelFrontEnd with a target, else GicpSubmapFrontEnd)"
    add_option(parser, "--front-end", "NAME", front_end)
    add_output_folder(parser, "estimate, tables and figure")


def run_record_log(arguments: argparse.Namespace) -> int:
    """Record depth images and inertial samples of a simulated tumbling target.

    The log is the input of `characterise`; docs/rendezvous.md describes its format.

    Example:
        safe-inspect record-log configs/tumbling-rendezvous/experiment.yml --output output/log --seconds 30
    """
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
            save(estimate_figure(log, estimate), folder / FIGURE)
    print(estimate_table(summary_of(log, estimate)))
    if arguments.output is not None:
        print(f"the estimate is in {arguments.output}")
    return 0
