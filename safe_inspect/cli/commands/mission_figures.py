"""Implementation of ``safe-inspect draw``, ``film`` and ``view`` for the folder of a rendezvous."""

from __future__ import annotations

import argparse
from pathlib import Path

from safe_inspect.cli.common import refuse_options
from safe_inspect.errors import SafeInspectError
from safe_inspect.evaluation.results.files import is_evaluation, read_evaluation, read_evaluation_record
from safe_inspect.evaluation.results.tables import ends
from safe_inspect.figures.drawing import save
from safe_inspect.figures.page import save_page
from safe_inspect.figures.rendezvous.campaign_figure import campaign_figure
from safe_inspect.figures.rendezvous.mission_figure import mission_figure, outcome_of
from safe_inspect.figures.rendezvous.mission_film import MissionFilm
from safe_inspect.figures.rendezvous.mission_page import mission_page
from safe_inspect.rendezvous.missions.record import MissionRecord, read_mission

#: Files in the folder of a mission, in addition to the resolved experiment.
_MISSION = ("events.jsonl", "log.npz")


def is_mission_source(arguments: argparse.Namespace) -> bool:
    """Return whether the command line names the folder of one mission, or of several missions to draw.

    Raises:
        SafeInspectError: It names the folder of several missions to film or view, or has options that do not apply to
            a mission.
    """
    folder = Path(arguments.source).expanduser()
    if _is_evaluation(folder):
        if arguments.command != "draw":
            raise SafeInspectError(
                f"{folder}: the evaluation of a rendezvous only has the results of its missions; run one of them with "
                "`rendezvous --episode N --output FOLDER`"
            )
    elif not any((folder / name).is_file() for name in _MISSION):
        return False
    options = {"--cfg": arguments.cfg, "KEY=VALUE": arguments.overrides, "--seed": arguments.seed}
    options["--episode"] = arguments.episode
    refuse_options(options, "has no effect on a recorded mission", source=folder)
    return True


def draw_mission(arguments: argparse.Namespace) -> int:
    """Draw a mission, or the distributions of several."""
    folder = Path(arguments.source).expanduser()
    if _is_evaluation(folder):
        return _draw_missions(arguments, folder)
    record = _record(arguments)
    save(mission_figure(record), arguments.output)
    return print_mission(arguments, record)


def _is_evaluation(folder: Path) -> bool:
    """Return whether a folder contains the evaluation of a rendezvous."""
    return is_evaluation(folder) and "rendezvous" in read_evaluation_record(folder)["task"]


def _draw_missions(arguments: argparse.Namespace, folder: Path) -> int:
    if arguments.until is not None:
        raise SafeInspectError(f"{folder}: --until is for one mission, not several; remove it")
    evaluation = read_evaluation(folder)
    save(campaign_figure(evaluation), arguments.output)
    print(f"{arguments.output}: {len(evaluation)} missions, {ends(evaluation.team)}")
    return 0


def mission_film(arguments: argparse.Namespace) -> MissionFilm:
    """Return the animation of a mission."""
    return MissionFilm(_record(arguments), arguments.frames, arguments.width, arguments.turn)


def view_mission(arguments: argparse.Namespace) -> int:
    """Write the page of a mission."""
    record = _record(arguments)
    title = arguments.title or f"Rendezvous {Path(arguments.source).resolve().name}"
    save_page(mission_page(record, title), arguments.output)
    return print_mission(arguments, record)


def print_mission(arguments: argparse.Namespace, record: MissionRecord) -> int:
    """Print the path of the output and the outcome of the mission."""
    path = arguments.output
    print(f"{path}: {outcome_of(record)}, {path.stat().st_size / 1000.0:.0f} kB")
    return 0


def _record(arguments: argparse.Namespace) -> MissionRecord:
    record = read_mission(arguments.source)
    if arguments.until is None:
        return record
    record = record.until(arguments.until)
    if len(record.arrays["t"]) < 2:
        raise SafeInspectError(f"--until {arguments.until:g}: no step has ended by then; give a later time in seconds")
    return record
