"""What ``safe-inspect rendezvous`` does."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from safe_inspect.cli.episode_bar import EpisodeBar
from safe_inspect.errors import ConfigError, Problem
from safe_inspect.outputs import new_folder
from safe_inspect.rendezvous.campaign.folder import CampaignFolder
from safe_inspect.rendezvous.campaign.missions import Flights, LocalFlights, fly_missions, write_missions
from safe_inspect.rendezvous.campaign.tables import mission_table, missions_table
from safe_inspect.rendezvous.coordination.coordinator import Phase
from safe_inspect.rendezvous.experiment import Rendezvous, load_rendezvous
from safe_inspect.rendezvous.mission import Mission
from safe_inspect.rendezvous.scenario import checked_target


def run_rendezvous(arguments: argparse.Namespace) -> int:
    """Fly one mission or several and print the table; return 1 when a mission has failed."""
    address, overrides = _address(arguments.overrides)
    experiment = load_rendezvous(arguments.cfg, overrides)
    if arguments.dry_run:
        print(experiment.text, end="")
        return 0
    checked_target(experiment.config)
    if arguments.missions is None:
        if address is not None:
            raise ConfigError(Problem("Ray flies several missions", "address", hint="give --missions N, or remove it"))
        return _fly_one(experiment, arguments.output)
    flights: Flights = LocalFlights(arguments.workers)
    if address is not None:
        from safe_inspect.experiments.runs.missions import RayFlights  # Ray is loaded for those who ask for it

        flights = RayFlights(address, arguments.workers, arguments.output)
    return _fly_many(experiment, arguments.missions, flights, arguments.output)


def _address(overrides: Sequence[str]) -> tuple[str | None, list[str]]:
    """Return the value of `address`, which is no part of the experiment, and the other overrides."""
    addresses = [text.partition("=")[2] for text in overrides if text.startswith("address=")]
    return addresses[-1] if addresses else None, [text for text in overrides if not text.startswith("address=")]


def _fly_one(experiment: Rendezvous, output: Path | None) -> int:
    if output is not None:
        CampaignFolder.check_absent(output)
    is_terminal = sys.stderr.isatty()

    def show(time: float, before: Phase, guard: str, after: Phase) -> None:
        line = f"{time:8.1f} s  {before.value} -> {after.value} ({guard})"
        sys.stderr.write(f"\r{line}\x1b[K" if is_terminal else f"{line}\n")
        sys.stderr.flush()

    result = Mission(experiment.config, progress=show).run()
    if is_terminal:
        sys.stderr.write("\r\x1b[K")
    if output is not None:
        with new_folder(output) as folder:
            result.log.write(folder, experiment.text, result.summary)
    print(mission_table(result.summary))
    if output is not None:
        print(f"the log is in {output}")
    return 0 if result.summary["success"] else 1


def _fly_many(experiment: Rendezvous, missions: int, flights: Flights, output: Path | None) -> int:
    bar = EpisodeBar("missions", sys.stderr)
    try:
        summaries = fly_missions(experiment, missions, flights, output, bar.show)
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
