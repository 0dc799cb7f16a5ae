"""The command ``safe-inspect rendezvous``."""

from __future__ import annotations

import argparse
import math

import numpy as np

from safe_inspect.cli.arguments import add_experiment_arguments, add_option, add_output_folder, natural, output_folder
from safe_inspect.cli.streams import print_doubts, print_error, print_loading
from safe_inspect.missions.mission import Mission
from safe_inspect.missions.scenario import check_scenario
from safe_inspect.missions.summary import mission_table
from safe_inspect.rendezvous.coordination.context import MissionContext, Phase
from safe_inspect.rendezvous.experiment import load_rendezvous

#: Mission time between two lines of progress [s].
_PERIOD = 10.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``rendezvous``."""
    add_experiment_arguments(parser, platform=False)
    add_option(parser, "--episode", "N", "fly episode N of an evaluation", natural, 0)
    add_output_folder(parser, "the log")
    parser.add_argument("--dry-run", action="store_true", help="print the resolved experiment and stop")


def run(arguments: argparse.Namespace) -> int:
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
