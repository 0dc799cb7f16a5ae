"""The commands ``safe-inspect draw``, ``film``, ``view`` and ``curves``: figures of episodes and of trainings."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from safe_inspect.cli.arguments import add_option, positive, positive_number, seed, whole_number
from safe_inspect.cli.common import add_overrides, refuse_options
from safe_inspect.cli.episode_bar import EpisodeBar
from safe_inspect.errors import SafeInspectError
from safe_inspect.evaluation.episodes import Trajectory
from safe_inspect.evaluation.results.files import (
    TRAJECTORIES,
    is_evaluation,
    read_evaluation,
    read_evaluation_record,
    read_trajectories,
)
from safe_inspect.evaluation.results.tables import ends
from safe_inspect.evaluation.rollouts import record_episode
from safe_inspect.experiments.modules.run_folder import RunFolder
from safe_inspect.experiments.modules.sources import Wanted, open_candidates
from safe_inspect.experiments.runs.trials import learning_curves_in, recipes_of
from safe_inspect.figures.drawing import FIGURE_ENDINGS, require_matplotlib, save
from safe_inspect.figures.film import Film
from safe_inspect.figures.learning_curves import curves_figure
from safe_inspect.figures.page import episode_page, save_page
from safe_inspect.figures.pictures import find_ffmpeg, save_film
from safe_inspect.figures.rendezvous.campaign_figure import campaign_figure
from safe_inspect.figures.rendezvous.mission_figure import mission_figure, outcome_of
from safe_inspect.figures.rendezvous.mission_film import MissionFilm
from safe_inspect.figures.rendezvous.mission_page import mission_page
from safe_inspect.figures.trajectory_figure import trajectory_figure
from safe_inspect.missions.record import read_mission
from safe_inspect.outputs import check_ending

_FILMS = (".gif", ".mp4")
_PAGES = (".html", ".htm")
#: Files in the folder of a mission, in addition to the resolved experiment.
_MISSION = ("events.jsonl", "log.npz")


def add_draw_arguments(parser: argparse.ArgumentParser) -> None:
    """Add all arguments of ``draw``."""
    _add_episode_arguments(parser, "episode.png", "figure (.png, .pdf or .svg)")


def add_film_arguments(parser: argparse.ArgumentParser) -> None:
    """Add all arguments of ``film``."""
    _add_episode_arguments(parser, "episode.gif", "film (.gif or .mp4)")
    add_option(parser, "--frames", "N", "number of frames", positive, 200)
    add_option(parser, "--fps", "N", "frames per second", positive, 25)
    add_option(parser, "--width", "N", "width in pixels", positive, 800)
    add_option(parser, "--turn", "DEGREES", "rotate the camera by this angle over the film", float, 0.0)


def add_view_arguments(parser: argparse.ArgumentParser) -> None:
    """Add all arguments of ``view``."""
    _add_episode_arguments(parser, "episode.html", "page (.html)")
    add_option(parser, "--title", "TEXT", "title of the page (default: source and episode)")


def add_curves_arguments(parser: argparse.ArgumentParser) -> None:
    """Add all arguments of ``curves``."""
    runs = "folder of a training run, a search or a trial; runs that differ only in their seed are one recipe"
    parser.add_argument("runs", nargs="*", metavar="RUN", help=runs)
    label = "label: once for each RUN (runs with equal labels are one recipe), or once for each recipe"
    add_option(parser, "--label", "TEXT", label, action="append", default=[])
    centre = "mean or interquartile mean over seeds (default: mean)"
    parser.add_argument("--centre", choices=("mean", "iqm"), default="mean", help=centre)
    parser.add_argument("--each", action="store_true", help="also draw a line for each seed")
    add_option(parser, "--output", "FILE", "figure", Path, Path("curves.png"))


def _add_episode_arguments(parser: argparse.ArgumentParser, output: str, what: str) -> None:
    add_option(
        parser, "source", "SOURCE", "folder of a checkpoint or a training run, ONNX file, name of a policy, or the "
        "output of `evaluate --record` or `rendezvous --output`",
    )  # fmt: skip
    add_overrides(parser)
    add_option(parser, "--cfg", "FILE", "experiment file, or id of a task (default: the policy's own task)")
    add_option(parser, "--episode", "N", "number of the episode", _number, 0)
    add_option(parser, "--seed", "N", "seed of the episodes", seed, 0)
    add_option(parser, "--until", "SECONDS", "show the episode, or the mission, up to this time", _seconds)
    default = f"(default: {output}, or mission{Path(output).suffix} of a rendezvous)"
    add_option(parser, "--output", "FILE", f"{what} {default}", Path)


def _number(text: str) -> int:
    return whole_number(text, "the number of an episode, from 0", most=2**31 - 1)


def _seconds(text: str) -> float:
    return positive_number(text, "a time above 0 in seconds")


def run_draw(arguments: argparse.Namespace) -> int:
    """Draw an episode: the trajectory and its quantities over time.

    Writes a PNG, PDF or SVG file.

    Example:
        safe-inspect draw inspector --seed 1 --output episode.png
    """
    is_mission = _prepare(arguments, "png", FIGURE_ENDINGS, "figure")
    require_matplotlib()
    folder = Path(arguments.source).expanduser()
    if is_mission and _is_campaign(folder):
        return _draw_campaign(arguments, folder)
    shown, _ = _episode(arguments, is_mission=is_mission)
    save(mission_figure(shown) if is_mission else trajectory_figure(shown), arguments.output)
    return _report(arguments.output, shown, is_mission)


def run_film(arguments: argparse.Namespace) -> int:
    """Write an animation of an episode (GIF or MP4).

    MP4 needs the extra [film].

    Example:
        safe-inspect film inspector --seed 1 --output episode.gif
    """
    is_mission = _prepare(arguments, "gif", _FILMS, "film")
    require_matplotlib()
    if not 2 <= arguments.frames <= 20_000 or not 320 <= arguments.width <= 3840 or arguments.fps > 100:
        raise SafeInspectError("a film has 2 to 20,000 --frames, a --width of 320 to 3840 pixels and at most 100 --fps")
    if arguments.output.suffix.lower() == ".mp4":
        find_ffmpeg()
    with EpisodeBar("pictures") as bar:
        bar.show(0, arguments.frames)
        shown, _ = _episode(arguments, is_mission=is_mission)
        film = MissionFilm if is_mission else Film
        save_film(
            film(shown, arguments.frames, arguments.width, arguments.turn), arguments.output, arguments.fps, bar.show
        )
    return _report(arguments.output, shown, is_mission)


def run_view(arguments: argparse.Namespace) -> int:
    """Write an episode as an interactive HTML page.

    The page opens without a server and without a network.

    Example:
        safe-inspect view inspector --seed 1 --output episode.html
    """
    is_mission = _prepare(arguments, "html", _PAGES, "page")
    shown, title = _episode(arguments, is_mission=is_mission)
    page = mission_page if is_mission else episode_page
    save_page(page(shown, arguments.title or title), arguments.output)
    return _report(arguments.output, shown, is_mission)


def run_curves(arguments: argparse.Namespace) -> int:
    """Draw learning curves with bands over training seeds.

    Runs that differ only in their seed become one curve.

    Example:
        safe-inspect curves output/RUN_1 output/RUN_2 --output curves.png
    """
    check_ending(arguments.output, FIGURE_ENDINGS, "figure")
    runs = arguments.runs
    if len(runs) > 1 and not arguments.label:  # as in `curves output/*`
        without = [run for run in runs if Path(run).is_dir() and not learning_curves_in(run)]
        for run in without:
            print(f"note: {run} is left out, because it has no progress.csv", file=sys.stderr)
        runs = [run for run in runs if run not in without]
    if not runs:
        raise SafeInspectError("no learning curves: give folders of training runs")
    recipes = recipes_of(runs, arguments.label)
    for label, paths in recipes.items():
        if len({path.resolve() for path in paths}) < len(paths):
            raise SafeInspectError(f"{label}: a run is given twice, but must count once in a band over seeds")
        records = [RunFolder(path.parent).record for path in paths]
        seeds = [json.loads(file.read_text(encoding="utf-8")).get("seed") for file in records if file.is_file()]
        if len(set(seeds)) < len(seeds):
            print(f"note: {label}: runs with the same seed do not count as several seeds; repeat one", file=sys.stderr)
    save(curves_figure(recipes, arguments.centre, each=arguments.each), arguments.output)
    shown = ", ".join(f"{label} ({len(paths)})" for label, paths in recipes.items())
    print(f"{arguments.output}: {shown}")
    return 0


def _episode(arguments: argparse.Namespace, *, is_mission: bool = False) -> tuple[Any, str]:
    """Return the episode of the command line, evaluated or recorded, or the recorded mission, and a title."""
    source = Path(arguments.source).expanduser()
    if is_mission:
        shown: Any = read_mission(arguments.source)
        title = f"Rendezvous {source.resolve().name}"
    elif source.suffix == ".npz" or (source / TRAJECTORIES).is_file() or is_evaluation(source):
        shown = _recorded(arguments, source)
        title = f"{source.name}, episode {shown.slot}"
    else:
        (candidate,) = open_candidates([arguments.source], Wanted(arguments.cfg, tuple(arguments.overrides)))
        shown = record_episode(candidate.spec, candidate.policies, arguments.episode, arguments.seed)
        task = candidate.experiment.config.config.config.env_config.TrialName
        title = f"{source.name}, {task}, episode {shown.slot} of seed {arguments.seed}"
    if arguments.until is not None:
        shown = shown.until(arguments.until)
        if len(shown.arrays["t"] if is_mission else shown.time) < 2:
            text = f"--until {arguments.until:g}: no step has ended by then; give a later time in seconds"
            raise SafeInspectError(text)
    return shown, title


def _recorded(arguments: argparse.Namespace, source: Path) -> Trajectory:
    options = {"--cfg": arguments.cfg, "KEY=VALUE": arguments.overrides, "--seed": arguments.seed}
    refuse_options(options, "has no effect on a recorded episode", source=source)
    episodes = {episode.slot: episode for episode in read_trajectories(source)}
    if arguments.episode not in episodes:
        last = max(episodes, default=-1)
        raise SafeInspectError(f"{source}: episode {arguments.episode} is not recorded; the last one is {last}")
    return episodes[arguments.episode]


def _draw_campaign(arguments: argparse.Namespace, folder: Path) -> int:
    if arguments.until is not None:
        raise SafeInspectError(f"{folder}: --until is for one mission, not several; remove it")
    evaluation = read_evaluation(folder)
    save(campaign_figure(evaluation), arguments.output)
    print(f"{arguments.output}: {len(evaluation)} missions, {ends(evaluation.team)}")
    return 0


def _outcome(episode: Trajectory) -> str:
    points = int((episode.inspected_at < float("inf")).sum())
    inspected = f"{points} of {len(episode.points)} points, " if len(episode.points) else ""
    minutes, delta_v = episode.time[-1] / 60.0, episode.delta_v[-1].sum()
    return f"episode {episode.slot}, {minutes:.1f} min, {inspected}delta-v {delta_v:.3f} m/s"


def _report(path: Path, shown: Any, is_mission: bool) -> int:
    outcome = outcome_of(shown) if is_mission else _outcome(shown)
    print(f"{path}: {outcome}, {path.stat().st_size / 1000.0:.0f} kB")
    return 0


def _prepare(arguments: argparse.Namespace, ending: str, endings: tuple[str, ...], what: str) -> bool:
    """Return whether the source is the folder of a mission; raise an error if the output cannot be written."""
    flown = is_mission_source(arguments)
    if arguments.output is None:
        arguments.output = Path(f"{'mission' if flown else 'episode'}.{ending}")
    check_ending(arguments.output, endings, what)
    return flown


def is_mission_source(arguments: argparse.Namespace) -> bool:
    """Return whether the command line names the folder of one mission, or of several missions to draw.

    Raises:
        SafeInspectError: It names the folder of several missions to film or view, or has options that do not apply to
            a mission.
    """
    folder = Path(arguments.source).expanduser()
    if _is_campaign(folder):
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


def _is_campaign(folder: Path) -> bool:
    """Return whether a folder contains the evaluation of a rendezvous."""
    return is_evaluation(folder) and "rendezvous" in read_evaluation_record(folder)["task"]
