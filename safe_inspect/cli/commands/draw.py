"""The command ``safe-inspect draw``."""

from __future__ import annotations

import argparse
from pathlib import Path

from safe_inspect.cli.shown_episode import add_episode_arguments, episode_of, is_campaign, prepare_output, report_file
from safe_inspect.errors import SafeInspectError
from safe_inspect.evaluation.results.files import (
    read_evaluation,
)
from safe_inspect.evaluation.results.tables import ends
from safe_inspect.figures.campaign_figure import campaign_figure
from safe_inspect.figures.drawing import FIGURE_ENDINGS, require_matplotlib, save
from safe_inspect.figures.mission_figure import mission_figure
from safe_inspect.figures.trajectory_figure import trajectory_figure


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add all arguments of ``draw``."""
    add_episode_arguments(parser, "episode.png", "figure (.png, .pdf or .svg)")


def run(arguments: argparse.Namespace) -> int:
    """Draw an episode: the trajectory and its quantities over time.

    Writes a PNG, PDF or SVG file.

    Example:
        safe-inspect draw inspector --seed 1 --output episode.png
    """
    is_mission = prepare_output(arguments, "png", FIGURE_ENDINGS, "figure")
    require_matplotlib()
    folder = Path(arguments.source).expanduser()
    if is_mission and is_campaign(folder):
        return _draw_campaign(arguments, folder)
    shown, _ = episode_of(arguments, is_mission=is_mission)
    save(mission_figure(shown) if is_mission else trajectory_figure(shown), arguments.output)
    return report_file(arguments.output, shown, is_mission)


def _draw_campaign(arguments: argparse.Namespace, folder: Path) -> int:
    if arguments.until is not None:
        raise SafeInspectError(f"{folder}: --until is for one mission, not several; remove it")
    evaluation = read_evaluation(folder)
    save(campaign_figure(evaluation), arguments.output)
    print(f"{arguments.output}: {len(evaluation)} missions, {ends(evaluation.team)}")
    return 0
