"""The command ``safe-inspect view``."""

from __future__ import annotations

import argparse

from safe_inspect.cli.arguments import add_option
from safe_inspect.cli.shown_episode import add_episode_arguments, episode_of, prepare_output, report_file
from safe_inspect.figures.mission_page import mission_page
from safe_inspect.figures.page import episode_page, save_page

_PAGES = (".html", ".htm")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add all arguments of ``view``."""
    add_episode_arguments(parser, "episode.html", "page (.html)")
    add_option(parser, "--title", "TEXT", "title of the page (default: source and episode)")


def run(arguments: argparse.Namespace) -> int:
    """Write an episode as an interactive HTML page.

    The page opens without a server and without a network.

    Example:
        safe-inspect view inspector --seed 1 --output episode.html
    """
    is_mission = prepare_output(arguments, "html", _PAGES, "page")
    shown, title = episode_of(arguments, is_mission=is_mission)
    page = mission_page if is_mission else episode_page
    save_page(page(shown, arguments.title or title), arguments.output)
    return report_file(arguments.output, shown, is_mission)
