"""The command ``safe-inspect rendezvous``."""

from __future__ import annotations

import argparse
import math
import sys
from typing import TextIO

import numpy as np

from safe_inspect.cli.arguments import add_option, add_output_folder, natural
from safe_inspect.cli.common import add_experiment_file, output_folder, print_doubts, print_loading
from safe_inspect.errors import SafeInspectError
from safe_inspect.rendezvous.coordination.context import MissionContext, Phase
from safe_inspect.rendezvous.experiment import load_rendezvous
from safe_inspect.rendezvous.missions.mission import Mission
from safe_inspect.rendezvous.missions.scenario import check_scenario
from safe_inspect.rendezvous.missions.summary import mission_table

#: Mission time between two progress updates [s], on a terminal and elsewhere.
_TERMINAL_PERIOD, _PERIOD = 1.0, 10.0


def add_rendezvous_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``rendezvous``."""
    add_experiment_file(parser)
    add_option(parser, "--episode", "N", "fly episode N of an evaluation", natural, 0)
    parser.add_argument("--missions", metavar="N", help=argparse.SUPPRESS)
    add_output_folder(parser, "the log")
    parser.add_argument("--dry-run", action="store_true", help="print the resolved experiment and stop")


def run_rendezvous(arguments: argparse.Namespace) -> int:
    """Run one mission and print its table; return 1 if it has failed."""
    if arguments.missions is not None:
        raise SafeInspectError(
            f"--missions has been removed; run several with `safe-inspect evaluate --cfg {arguments.cfg} --episodes "
            f"{arguments.missions}`, with --workers and --output as before"
        )
    print_loading()
    experiment = load_rendezvous(arguments.cfg, arguments.overrides)
    print_doubts(check_scenario(experiment, arguments.episode + 1))
    if arguments.dry_run:
        print(experiment.text, end="")
        return 0
    with output_folder(arguments) as folder:
        lines = _MissionLines(sys.stderr)
        try:
            result = Mission(experiment.config, arguments.episode, lines.change, lines.step).run()
        finally:
            lines.close()
        if folder is not None:
            result.log.write(folder, experiment.text, result.summary)
    print(mission_table(result.summary))
    if arguments.output is not None:
        print(f"the log is in {arguments.output}")
    return 0 if result.summary["success"] else 1


class _MissionLines:
    """Progress of a mission: on a terminal one line that is updated, elsewhere a line every ten seconds of mission."""

    def __init__(self, stream: TextIO) -> None:
        self._stream, self._is_terminal = stream, stream.isatty()
        self._next = 0.0

    def change(self, time: float, before: Phase, guard: str, after: Phase) -> None:
        """Show a change of state."""
        self._show(f"{time:8.1f} s  {before.value} -> {after.value} ({guard})")

    def step(self, context: MissionContext) -> None:
        """Show the state of the mission, if an update is due."""
        if context.time < self._next:
            return
        self._next = context.time + (_TERMINAL_PERIOD if self._is_terminal else _PERIOD)
        estimate = context.estimate
        distance = float(np.linalg.norm(estimate.relative[:3]))
        known = estimate.problem or (
            f"attitude within {math.degrees(estimate.errors.attitude):.2g} deg, "
            f"rate within {math.degrees(estimate.errors.rate):.2g} deg/s"
        )
        self._show(f"{context.time:8.1f} s  {context.phase.value}, {distance:.2f} m from the target's centre; {known}")

    def close(self) -> None:
        """Remove the line from a terminal."""
        if self._is_terminal:
            self._stream.write("\r\x1b[K")
            self._stream.flush()

    def _show(self, line: str) -> None:
        self._stream.write(f"\r{line}\x1b[K" if self._is_terminal else f"{line}\n")
        self._stream.flush()
