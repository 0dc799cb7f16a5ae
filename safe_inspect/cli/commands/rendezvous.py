"""The command ``safe-inspect rendezvous``."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TextIO

import numpy as np

from safe_inspect.cli.arguments import add_output_folder, positive
from safe_inspect.cli.common import add_experiment_file, output_folder, print_doubts, print_loading
from safe_inspect.cli.episode_bar import EpisodeBar
from safe_inspect.errors import ConfigError, OutputError, Problem, SafeInspectError
from safe_inspect.rendezvous.coordination.context import MissionContext
from safe_inspect.rendezvous.coordination.coordinator import Phase
from safe_inspect.rendezvous.experiment import Rendezvous, load_rendezvous
from safe_inspect.rendezvous.missions.campaign import Flights, LocalFlights, fly_missions, write_missions
from safe_inspect.rendezvous.missions.mission import Mission
from safe_inspect.rendezvous.missions.tables import mission_table, missions_table
from safe_inspect.rendezvous.scenario import check_scenario

#: Time of a mission between two lines of progress [s], on a terminal and elsewhere.
_TERMINAL_PERIOD, _PERIOD = 1.0, 10.0


def add_rendezvous_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of a rendezvous."""
    add_experiment_file(parser)
    parser.add_argument(
        "--missions",
        type=positive,
        metavar="N",
        help="fly N missions, each with its own random draws; by Ray with address=auto (or HOST:PORT, or local)",
    )
    parser.add_argument("--workers", type=positive, metavar="N", help="missions flown at a time (default: 1)")
    add_output_folder(parser, "the log, or the logs of --missions, which continue in the same folder,")
    parser.add_argument("--dry-run", action="store_true", help="print the resolved experiment, and fly nothing")


def run_rendezvous(arguments: argparse.Namespace) -> int:
    """Fly one mission or several and print the table; return 1 when a mission has failed."""
    print_loading()
    address, overrides = _address(arguments.overrides)
    experiment = load_rendezvous(arguments.cfg, overrides)
    print_doubts(check_scenario(experiment, arguments.missions or 1))
    if arguments.dry_run:
        print(experiment.text, end="")
        return 0
    if arguments.missions is None:
        if arguments.workers is not None:
            raise SafeInspectError("--workers flies several missions; give --missions N, or leave it out")
        if address is not None:
            raise ConfigError(Problem("Ray flies several missions", "address", hint="give --missions N, or remove it"))
        return _fly_one(experiment, arguments)
    if arguments.force:
        raise OutputError("--force replaces the folder of one mission; --missions continue in theirs, so leave it out")
    flights: Flights = LocalFlights(arguments.workers or 1)
    if address is not None:
        from safe_inspect.experiments.runs.missions import RayFlights  # Ray is loaded for those who ask for it

        flights = RayFlights(address, arguments.workers or 1, arguments.output)
    return _fly_many(experiment, arguments.missions, flights, arguments.output)


def _address(overrides: Sequence[str]) -> tuple[str | None, list[str]]:
    """Return the value of `address`, which is no part of the experiment, and the other overrides."""
    addresses = [text.partition("=")[2] for text in overrides if text.startswith("address=")]
    return addresses[-1] if addresses else None, [text for text in overrides if not text.startswith("address=")]


def _fly_one(experiment: Rendezvous, arguments: argparse.Namespace) -> int:
    with output_folder(arguments) as folder:
        lines = _MissionLines(sys.stderr)
        try:
            result = Mission(experiment.config, progress=lines.change, watch=lines.step).run()
        finally:
            lines.close()
        if folder is not None:
            result.log.write(folder, experiment.text, result.summary)
    print(mission_table(result.summary))
    if arguments.output is not None:
        print(f"the log is in {arguments.output}")
    return 0 if result.summary["success"] else 1


class _MissionLines:
    """The progress of a mission: one line that is redrawn on a terminal, elsewhere a line every ten seconds of it."""

    def __init__(self, stream: TextIO) -> None:
        self._stream, self._is_terminal = stream, stream.isatty()
        self._next = 0.0

    def change(self, time: float, before: Phase, guard: str, after: Phase) -> None:
        """Show a change of state."""
        self._show(f"{time:8.1f} s  {before.value} -> {after.value} ({guard})")

    def step(self, context: MissionContext) -> None:
        """Show how the mission stands, when it is time to."""
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


def _fly_many(experiment: Rendezvous, missions: int, flights: Flights, output: Path | None) -> int:
    bar = EpisodeBar("missions", sys.stderr)

    def show(ended: int, count: int) -> None:
        if ended == 0:
            print(f"flying {count} missions; each takes from seconds to a minute", file=sys.stderr, flush=True)
        bar.show(ended, count)

    try:
        summaries = fly_missions(experiment, missions, flights, output, show)
        if output is not None:
            write_missions(output / "missions.parquet", summaries)
    except KeyboardInterrupt as stop:
        if output is not None:
            stop.add_note(f"the same command goes on with the missions in {output}")
        raise
    finally:
        bar.close()
    print(missions_table(summaries))
    if output is not None:
        print(f"the missions are in {output}")
    return 0 if all(summary["success"] for summary in summaries) else 1
