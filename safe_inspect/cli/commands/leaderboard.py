"""The command ``safe-inspect leaderboard``."""

from __future__ import annotations

import argparse
import json
import shlex
import sys
from dataclasses import dataclass
from pathlib import Path

from safe_inspect.cli.arguments import add_option, positive
from safe_inspect.cli.episode_bar import EpisodeBar
from safe_inspect.cli.flights import NUM_ENVS, fly_candidates
from safe_inspect.config.data import configs_root
from safe_inspect.config.spec import EnvironmentSpec
from safe_inspect.environments.registration import load_spec
from safe_inspect.errors import SafeInspectError, did_you_mean
from safe_inspect.evaluation.baselines import OPTIMISER, complete, empty_record
from safe_inspect.evaluation.optimiser import coverage_task
from safe_inspect.evaluation.results.files import is_evaluation, read_evaluation, read_evaluation_record
from safe_inspect.evaluation.results.leaderboard import (
    Board,
    FlownRow,
    Leaderboard,
    Standing,
    leaderboard_page,
    read_leaderboard,
    slug,
)
from safe_inspect.evaluation.results.results import EvaluationError
from safe_inspect.evaluation.shipped import shipped_policy
from safe_inspect.evaluation.task import default_metrics, differing_keys, task_of
from safe_inspect.experiments.modules.sources import SHIPPED, Candidate, Wanted, open_candidates
from safe_inspect.outputs import check_writable, new_file
from safe_inspect.version import __version__


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``leaderboard``."""
    parser.add_argument(
        "files", nargs="*", type=Path, metavar="FILE", help="YAML file of boards; further files add rows to boards of "
        "the same title (default: configs/leaderboard.yml)",
    )  # fmt: skip
    add_option(parser, "--output", "FILE", "write the page to this Markdown file", Path)
    results = "folder of the episodes of every row; rows that have not changed are not run again"
    add_option(parser, "--results", "FOLDER", results, Path, Path("output/leaderboard"))
    add_option(parser, "--board", "TEXT", "title of a board; the others are left out", action="append", default=[])
    add_option(parser, "--episodes", "N", "override the number of episodes", positive)
    add_option(parser, "--num-envs", "N", "number of episodes run at a time", positive, NUM_ENVS)


@dataclass(frozen=True)
class _Entry:
    """A row that is ready to run, with its task and overrides; `candidate` is None for open-loop plans."""

    board: Board
    row: FlownRow
    task: str
    overrides: tuple[str, ...]
    spec: EnvironmentSpec
    candidate: Candidate | None


def run(arguments: argparse.Namespace) -> int:
    """Run baselines, trained policies and yours on the same episodes, and write a table.

    Rows that have not changed since the last call are not run again.

    Example:
        safe-inspect leaderboard --episodes 100 --output leaderboard.md
    """
    leaderboard = read_leaderboard(arguments.files or [configs_root() / "leaderboard.yml"])
    titles = [board.title for board in leaderboard.boards]
    for title in arguments.board:
        if title not in titles:
            raise SafeInspectError(f"--board: there is no board {title!r}; {did_you_mean(title, titles)}")
    chosen = [board for board in leaderboard.boards if not arguments.board or board.title in arguments.board]
    leaderboard = leaderboard.model_copy(
        update={"boards": tuple(chosen), "episodes": arguments.episodes or leaderboard.episodes}
    )
    if arguments.output is not None:
        check_writable(arguments.output, [".md"])
    entries = [_entries(board, leaderboard) for board in chosen]  # mistakes are reported before anything runs
    total = sum(map(len, entries))
    standings: list[list[Standing]] = []
    try:
        for own in entries:
            standings.append([])
            for entry in own:
                number = sum(map(len, standings)) + 1
                print(f"[{number}/{total}] {entry.board.title}: {entry.row.title}", file=sys.stderr, flush=True)
                standings[-1].append(_standing(arguments, entry, leaderboard))
    except KeyboardInterrupt as stop:
        stop.add_note(f"the finished rows are in {arguments.results}, and the same command continues")
        raise
    page = leaderboard_page(leaderboard, standings, _command(arguments))
    if arguments.output is None:
        print(page)
        return 0
    with new_file(arguments.output) as work:
        work.write_text(page, encoding="utf-8")
    print(f"the leaderboard: {arguments.output}")
    return 0


def _command(arguments: argparse.Namespace) -> str:
    """Return the command that creates the page, without the folder of the stored rows."""
    words = [str(path) for path in arguments.files]
    words += [word for title in arguments.board for word in ("--board", title)]
    words += ["--episodes", str(arguments.episodes)] if arguments.episodes else []
    words += ["--output", str(arguments.output)] if arguments.output else []
    return shlex.join(["safe-inspect", "leaderboard", *words])


def _entries(board: Board, leaderboard: Leaderboard) -> list[_Entry]:
    """Return the rows of a board, ready to run.

    Raises:
        SafeInspectError: There is no such policy, or the task of a row differs from that of the board.
    """
    assert board.task is not None, "a leaderboard that was read has a task for each board"
    whole = task_of(load_spec(board.task, board.overrides))
    found = []
    for row in board.rows:
        where = f"leaderboard, board {board.title!r}, row {row.title!r}"
        task, overrides = row.task or board.task, (*board.overrides, *row.overrides)
        try:
            if row.source == OPTIMISER:
                candidate, spec = None, load_spec(task, overrides)
                coverage_task(spec)  # an error, if the optimiser does not support it
            else:
                (candidate,) = open_candidates([row.source], Wanted(task, overrides, seed=leaderboard.seed))
                spec = candidate.experiment.spec
        except SafeInspectError as error:
            raise SafeInspectError(f"{where}: {error}") from None
        differing = differing_keys(whole, task_of(spec))
        if differing:
            raise SafeInspectError(
                f"{where}: its task differs from that of the board: `{differing[0]}`; put the row into another board"
            )
        found.append(_Entry(board, row, task, overrides, spec, candidate))
    return found


def _standing(arguments: argparse.Namespace, entry: _Entry, leaderboard: Leaderboard) -> Standing:
    """Return the result of a row, stored or new."""
    folder = arguments.results / slug(entry.board.title) / slug(entry.row.title)
    if entry.candidate is None:
        return _plans(entry, folder.with_suffix(".json"), leaderboard)
    if _is_known(folder, entry, leaderboard):
        print(f"  stored in {folder}", file=sys.stderr)
    else:
        wanted = argparse.Namespace(
            command=arguments.command, output=folder, force=True, episodes=leaderboard.episodes, seed=leaderboard.seed,
            num_envs=arguments.num_envs, record=0, reference=None, sampled=None, overrides=list(entry.overrides),
        )  # fmt: skip
        fly_candidates(wanted, [entry.candidate], default_metrics(entry.spec), None)
    source = entry.candidate.source
    training = shipped_policy(source["text"].removeprefix(SHIPPED)).training if source["kind"] == "shipped" else {}
    return Standing.of_evaluation(entry.row, read_evaluation(folder), training)


def _is_known(folder: Path, entry: _Entry, leaderboard: Leaderboard) -> bool:
    """Return whether a folder contains exactly these episodes of this policy in this task."""
    if not is_evaluation(folder) or entry.candidate is None:
        return False
    try:
        record = read_evaluation_record(folder)
    except EvaluationError:
        return False
    wanted = __version__, leaderboard.episodes, leaderboard.seed, entry.candidate.experiment.resolved
    flown = [record.get(key) for key in ("safe_inspect", "episodes", "seed", "configuration")]
    same: bool = flown == json.loads(json.dumps(wanted, default=str))
    return same and record["source"]["sha256"] == entry.candidate.source["sha256"]


def _plans(entry: _Entry, path: Path, leaderboard: Leaderboard) -> Standing:
    """Return the result of open-loop plans, stored or new."""
    asked = empty_record(entry.spec, leaderboard.seed, "quick", entry.task, entry.overrides)
    path.parent.mkdir(parents=True, exist_ok=True)
    with EpisodeBar(OPTIMISER) as bar:
        record = complete(entry.spec, asked, leaderboard.episodes, path=path, force=True, progress=bar.show)
    if not bar.done:
        print(f"  stored in {path}", file=sys.stderr)
    return Standing.of_plans(entry.row, record, entry.spec.step_size)
