"""Leaderboards, sensor logs and pictures of missions by their commands, with flights and estimates replaced."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from safe_inspect.cli import shown_episode
from safe_inspect.cli.commands import characterise, draw, film, leaderboard, view
from safe_inspect.environments.registration import load_spec
from safe_inspect.errors import SafeInspectError
from safe_inspect.evaluation.shipped import shipped_policy

Typed = Callable[..., tuple[int, str, str]]
pytestmark = pytest.mark.usefixtures("here")
BOARDS = """
boards:
  - title: First
    task: safe_inspect/TranslationalInspectionSeed-v0
    overrides: [horizon=30]
    rows: [{source: random}, {source: inspector, overrides: [seed=3]}, {source: optimiser}]
  - title: Second
    task: safe_inspect/Docking-v0
    rows: [{source: zero-thrust}]
"""


@pytest.fixture
def boards(here: Path) -> str:
    """Return a file of two boards."""
    (here / "boards.yml").write_text(BOARDS)
    return "boards.yml"


def test_every_row_of_the_chosen_boards_has_its_place_on_the_page(
    boards: str, typed: Typed, monkeypatch: pytest.MonkeyPatch, here: Path
) -> None:
    flown: list[Any] = []

    def standing(arguments: Any, entry: Any, whole: Any) -> str:
        flown.append((entry.board.title, entry.row.title, entry.overrides, entry.candidate is None, whole.episodes))
        return entry.row.title

    monkeypatch.setattr(leaderboard, "_standing", standing)
    monkeypatch.setattr(leaderboard, "leaderboard_page", lambda whole, rows, command: f"{rows} by {command}")
    code, out, err = typed("leaderboard", boards, "--episodes", "7")
    assert (code, out) == (
        0,
        "[['random', 'inspector', 'optimiser'], ['zero-thrust']] by safe-inspect leaderboard boards.yml --episodes 7\n",
    )
    assert err.splitlines() == [
        "[1/4] First: random", "[2/4] First: inspector", "[3/4] First: optimiser", "[4/4] Second: zero-thrust",
    ]  # fmt: skip
    assert flown == [
        ("First", "random", ("horizon=30",), False, 7), ("First", "inspector", ("horizon=30", "seed=3"), False, 7),
        ("First", "optimiser", ("horizon=30",), True, 7), ("Second", "zero-thrust", (), False, 7),
    ]  # fmt: skip
    code, out, err = typed("leaderboard", boards, "--board", "Second", "--output", "page.md")
    assert (code, out, err) == (0, "the leaderboard: page.md\n", "[1/1] Second: zero-thrust\n")
    assert (here / "page.md").read_text().startswith("[['zero-thrust']] by safe-inspect leaderboard boards.yml --board")
    shown = "error: --board: there is no board 'Secnd'; did you mean `Second`?\n"
    assert typed("leaderboard", boards, "--board", "Secnd")[2] == shown

    def stop(*_: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(leaderboard, "_standing", stop)
    code, _, err = typed("leaderboard", boards, "--board", "Second", "--results", "kept")
    shown = "interrupted; the finished rows are in kept, and the same command continues"
    assert (code, err.splitlines()[-1]) == (130, shown)


@pytest.mark.parametrize(
    ("row", "shown"),
    [
        ("{source: inspectr}", "row 'inspectr': no policy 'inspectr': it is neither"),
        ("{source: random, name: other, overrides: [horizon=31]}", "row 'other': its task differs from "),
        ("{source: optimiser, task: safe_inspect/Docking-v0}", "row 'optimiser': "),
    ],
)
def test_a_row_that_cannot_fly_is_reported_before_any_flies(here: Path, typed: Typed, row: str, shown: str) -> None:
    task = "safe_inspect/TranslationalInspectionSeed-v0"
    (here / "b.yml").write_text(f"boards: [{{title: B, task: {task}, rows: [{{source: random}}, {row}]}}]\n")
    code, out, err = typed("leaderboard", "b.yml")
    assert (code, out) == (2, "")
    assert err.startswith(f"error: leaderboard, board 'B', {shown}")


def test_a_row_is_flown_where_it_is_not_known(monkeypatch: pytest.MonkeyPatch, here: Path) -> None:
    calls: list[Any] = []
    known = iter([False, True])
    monkeypatch.setattr(leaderboard, "_is_known", lambda *_: next(known))
    monkeypatch.setattr(leaderboard, "fly_candidates", lambda *given: calls.append(given))
    monkeypatch.setattr(leaderboard, "default_metrics", lambda spec: [f"metrics of {spec}"])
    monkeypatch.setattr(leaderboard, "read_evaluation", lambda folder: folder)
    monkeypatch.setattr(leaderboard, "Standing", SimpleNamespace(of_evaluation=lambda *given: given))
    candidate = SimpleNamespace(source={"kind": "shipped", "text": "--policy docking"})
    entry: Any = SimpleNamespace(
        board=SimpleNamespace(title="A Board"),
        row=SimpleNamespace(title="A Row"),
        candidate=candidate,
        spec="spec",
        overrides=("a=1",),
    )
    arguments = argparse.Namespace(results=here, command="leaderboard", num_envs=3)
    board: Any = SimpleNamespace(episodes=9, seed=4)
    folder, card = here / leaderboard.slug("A Board") / leaderboard.slug("A Row"), shipped_policy("docking").training
    for _ in range(2):
        assert leaderboard._standing(arguments, entry, board) == (entry.row, folder, card)
    ((wanted, candidates, metrics, reference),) = calls
    assert (candidates, metrics, reference) == ([candidate], ["metrics of spec"], None)
    assert vars(wanted) == {
        "command": "leaderboard", "output": folder, "force": True, "episodes": 9, "seed": 4, "num_envs": 3, "record": 0,
        "reference": None, "sampled": None, "overrides": ["a=1"],
    }  # fmt: skip


def test_plans_of_a_board_are_searched_with_its_seed(monkeypatch: pytest.MonkeyPatch, here: Path) -> None:
    asked: list[Any] = []
    monkeypatch.setattr(leaderboard, "complete", lambda *given, **more: asked.append((given, more)) or "record")
    monkeypatch.setattr(leaderboard, "Standing", SimpleNamespace(of_plans=lambda *given: given))
    row, board = SimpleNamespace(title="O"), SimpleNamespace(title="B")
    task, overrides = "safe_inspect/TranslationalInspectionSeed-v0", ("horizon=30",)
    spec = load_spec(task, overrides)
    entry: Any = SimpleNamespace(board=board, row=row, task=task, overrides=overrides, spec=spec, candidate=None)
    whole: Any = SimpleNamespace(episodes=9, seed=4)
    assert leaderboard._standing(argparse.Namespace(results=here), entry, whole) == (row, "record", 10.0)
    (((_, record, count), more),) = asked
    assert (record.seed, record.effort, count) == (4, "quick", 9)
    assert (more["path"], more["force"]) == (here / leaderboard.slug("B") / f"{leaderboard.slug('O')}.json", True)
    assert more["path"].parent.is_dir()
    assert record.about["overrides"] == ["horizon=30"]


@pytest.mark.parametrize(
    ("words", "front_end", "shown"),
    [
        ((), "GicpSubmapFrontEnd", ""),
        (("--target", "t.yml"), "ModelFrontEnd", ""),
        (("--target", "t.yml", "--front-end", "GicpSubmapFrontEnd"), "GicpSubmapFrontEnd", ""),
        (("--output", "o"), "GicpSubmapFrontEnd", "the estimate is in o\n"),
    ],
)  # fmt: skip
def test_a_log_is_characterised_and_its_estimate_written(
    typed: Typed, monkeypatch: pytest.MonkeyPatch, here: Path, words: tuple[str, ...], front_end: str, shown: str
) -> None:
    used: list[Any] = []
    monkeypatch.setattr(characterise, "read_sensor_log", lambda folder: [folder])
    monkeypatch.setattr(characterise, "check_log", lambda log: ["doubt"])
    monkeypatch.setattr(characterise, "read_target", lambda path: f"target of {path}")
    monkeypatch.setattr(characterise, "PipelineEstimator", lambda front_end: type(front_end).__name__)
    monkeypatch.setattr(
        characterise, "estimate_log", lambda log, front, target, _: used.append((front, target)) or "found"
    )
    monkeypatch.setattr(characterise, "estimate_table", lambda summary: f"table of {summary}")
    monkeypatch.setattr(characterise, "summary_of", lambda log, estimate: (log, estimate))
    monkeypatch.setattr(
        characterise, "write_estimate", lambda folder, log, estimate: (folder / "e").write_text(estimate)
    )
    monkeypatch.setattr(characterise, "estimate_figure", lambda log, estimate: "figure")
    monkeypatch.setattr(characterise, "save", lambda figure, path: path.write_text(figure))
    code, out, err = typed("characterise", "log", *words)
    assert (code, out) == (0, f"table of (['log'], 'found')\n{shown}")
    assert err.splitlines()[1] == "warning: doubt"
    assert used == [(front_end, "target of t.yml" if "--target" in words else None)]
    if "--output" in words:
        files = {path.name: path.read_text() for path in (here / "o").iterdir() if path.suffix in ("", ".png")}
        assert {key: files[key] for key in ("e", "estimate.png")} == {"e": "found", "estimate.png": "figure"}


class Record(SimpleNamespace):
    """Replacement of a `MissionRecord` with some steps of 0.2 s."""

    def until(self, time: float) -> Any:
        return Record(arrays={"t": self.arrays["t"][self.arrays["t"] <= time]})


def test_one_mission_is_drawn_filmed_and_viewed(here: Path, typed: Typed, monkeypatch: pytest.MonkeyPatch) -> None:
    (here / "m").mkdir()
    (here / "m" / "log.npz").write_text("")
    monkeypatch.setattr(shown_episode, "read_mission", lambda path: Record(arrays={"t": 0.2 * np.arange(9)}))
    monkeypatch.setattr(shown_episode, "outcome_of", lambda record: f"{len(record.arrays['t'])} steps")
    monkeypatch.setattr(draw, "mission_figure", lambda record: record)
    monkeypatch.setattr(draw, "save", lambda record, path: path.write_text("x" * 1600))
    titles: list[str] = []
    monkeypatch.setattr(view, "mission_page", lambda record, title: titles.append(title))
    monkeypatch.setattr(view, "save_page", lambda page, path: path.write_text(""))
    assert typed("draw", "m")[:2] == (0, "mission.png: 9 steps, 2 kB\n")
    assert typed("draw", "m", "--until", "0.4", "--output", "d.svg")[:2] == (0, "d.svg: 3 steps, 2 kB\n")
    assert typed("draw", "m", "--until", "0.2")[:2] == (0, "mission.png: 2 steps, 2 kB\n")
    shown = "error: --until 0.1: no step has ended by then; give a later time in seconds\n"
    assert typed("draw", "m", "--until", "0.1")[::2] == (2, shown)
    assert typed("view", "m")[:2] == (0, "mission.html: 9 steps, 0 kB\n")
    assert typed("view", "m", "--title", "Mine")[0] == 0
    assert titles == ["Rendezvous m", "Mine"]
    given: list[Any] = []
    monkeypatch.setattr(film, "MissionFilm", lambda *film: given.append(film))
    monkeypatch.setattr(film, "save_film", lambda film, path, fps, show: path.write_text("x"))
    assert typed("film", "m", "--frames", "3", "--width", "400", "--turn", "9")[:2] == (
        0,
        "mission.gif: 9 steps, 0 kB\n",
    )
    assert given[0][1:] == (3, 400, 9.0)


def test_an_evaluation_of_environments_is_no_mission(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    arguments = argparse.Namespace(source=str(here), cfg=None, overrides=[], seed=0, episode=0, command="view")
    monkeypatch.setattr(shown_episode, "is_evaluation", lambda folder: True)
    monkeypatch.setattr(shown_episode, "read_evaluation_record", lambda folder: {"task": {"horizon": 1}})
    assert not shown_episode.is_mission_source(arguments)
    monkeypatch.setattr(shown_episode, "read_evaluation_record", lambda folder: {"task": {"rendezvous": 1}})
    with pytest.raises(SafeInspectError, match=r"run one of them with `rendezvous --episode N --output FOLDER`$"):
        shown_episode.is_mission_source(arguments)
    arguments.command = "draw"
    assert shown_episode.is_mission_source(arguments)
