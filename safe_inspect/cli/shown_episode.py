"""The episode or the mission that a command shows, and the file that it writes."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from safe_inspect.cli.arguments import add_option, add_overrides, positive_number, refuse_options, seed, whole_number
from safe_inspect.errors import SafeInspectError
from safe_inspect.evaluation.recorder import Trajectory
from safe_inspect.evaluation.results.files import (
    TRAJECTORIES,
    is_evaluation,
    read_evaluation_record,
    read_trajectories,
)
from safe_inspect.evaluation.rollouts import record_episode
from safe_inspect.experiments.modules.sources import Wanted, open_candidates
from safe_inspect.figures.mission_figure import outcome_of
from safe_inspect.missions.record import read_mission
from safe_inspect.outputs import check_ending

#: Files in the folder of a mission, in addition to the resolved experiment.
_MISSION = ("events.jsonl", "log.npz")


def add_episode_arguments(parser: argparse.ArgumentParser, output: str, what: str) -> None:
    """Add the arguments that determine the episode and the file.

    Args:
        parser: Parser of the command.
        output: Default name of the file.
        what: What the file is, and its possible endings.
    """
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


def episode_of(arguments: argparse.Namespace, *, is_mission: bool = False) -> tuple[Any, str]:
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


def _outcome(episode: Trajectory) -> str:
    points = int((episode.inspected_at < float("inf")).sum())
    inspected = f"{points} of {len(episode.points)} points, " if len(episode.points) else ""
    minutes, delta_v = episode.time[-1] / 60.0, episode.delta_v[-1].sum()
    return f"episode {episode.slot}, {minutes:.1f} min, {inspected}delta-v {delta_v:.3f} m/s"


def report_file(path: Path, shown: Any, is_mission: bool) -> int:
    """Print what the written file shows; return the exit code."""
    outcome = outcome_of(shown) if is_mission else _outcome(shown)
    print(f"{path}: {outcome}, {path.stat().st_size / 1000.0:.0f} kB")
    return 0


def prepare_output(arguments: argparse.Namespace, ending: str, endings: tuple[str, ...], what: str) -> bool:
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
    if is_campaign(folder):
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


def is_campaign(folder: Path) -> bool:
    """Return whether a folder contains the evaluation of a rendezvous."""
    return is_evaluation(folder) and "rendezvous" in read_evaluation_record(folder)["task"]
