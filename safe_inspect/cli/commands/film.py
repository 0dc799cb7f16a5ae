"""The command ``safe-inspect film``."""

from __future__ import annotations

import argparse

from safe_inspect.cli.arguments import add_option, positive
from safe_inspect.cli.episode_bar import EpisodeBar
from safe_inspect.cli.shown_episode import add_episode_arguments, episode_of, prepare_output, report_file
from safe_inspect.errors import SafeInspectError
from safe_inspect.figures.drawing import require_matplotlib
from safe_inspect.figures.film import Film
from safe_inspect.figures.mission_film import MissionFilm
from safe_inspect.figures.pictures import find_ffmpeg, save_film

_FILMS = (".gif", ".mp4")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add all arguments of ``film``."""
    add_episode_arguments(parser, "episode.gif", "film (.gif or .mp4)")
    add_option(parser, "--frames", "N", "number of frames", positive, 200)
    add_option(parser, "--fps", "N", "frames per second", positive, 25)
    add_option(parser, "--width", "N", "width in pixels", positive, 800)
    add_option(parser, "--turn", "DEGREES", "rotate the camera by this angle over the film", float, 0.0)


def run(arguments: argparse.Namespace) -> int:
    """Write an animation of an episode (GIF or MP4).

    MP4 needs the extra [film].

    Example:
        safe-inspect film inspector --seed 1 --output episode.gif
    """
    is_mission = prepare_output(arguments, "gif", _FILMS, "film")
    require_matplotlib()
    if not 2 <= arguments.frames <= 20_000 or not 320 <= arguments.width <= 3840 or arguments.fps > 100:
        raise SafeInspectError("a film has 2 to 20,000 --frames, a --width of 320 to 3840 pixels and at most 100 --fps")
    if arguments.output.suffix.lower() == ".mp4":
        find_ffmpeg()
    with EpisodeBar("pictures") as bar:
        bar.show(0, arguments.frames)
        shown, _ = episode_of(arguments, is_mission=is_mission)
        film = MissionFilm if is_mission else Film
        save_film(
            film(shown, arguments.frames, arguments.width, arguments.turn), arguments.output, arguments.fps, bar.show
        )
    return report_file(arguments.output, shown, is_mission)
