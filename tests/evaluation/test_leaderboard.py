"""`safe-inspect leaderboard`: its files, its rows and its page."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest

from safe_inspect.cli.commands import leaderboard as command
from safe_inspect.cli.main import main
from safe_inspect.config.data import configs_root
from safe_inspect.errors import SafeInspectError
from safe_inspect.evaluation.results.leaderboard import FlownRow, Standing, leaderboard_page, read_leaderboard
from safe_inspect.evaluation.results.results import Block, Evaluation
from safe_inspect.evaluation.shipped import shipped_policies, shipped_policy

TASK = configs_root() / "translational-inspection" / "experiment-seed.yml"
BOARDS = f"""
episodes: 4
seed: 3
boards:
  - title: Small
    task: {TASK}
    overrides: [horizon=30]
    rows:
      - {{source: zero-thrust, note: coasts}}
    published:
      - {{name: "A | B", reference: arXiv 0000.00000, success: 0.5, points: 98.82, time: 1234.4}}
"""
MORE = "boards: [{title: Small, rows: [{source: random, name: mine, training_steps: 12, wall_time: 3 min}]}]"


@pytest.fixture
def typed(tmp_path, monkeypatch, capsys):
    """Return a function that types the command in an empty folder."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "boards.yml").write_text(BOARDS)
    (tmp_path / "more.yml").write_text(MORE)

    def run(*words: str) -> tuple[int, str, str]:
        code = main(["leaderboard", *words])
        return code, *capsys.readouterr()

    return run


def evaluation(wins: int, **figures: list[float]) -> Evaluation:
    count = len(figures["length"])
    status = np.array(["win"] * wins + ["lose"] * (count - wins), dtype=object)
    arrays = {name.replace("_", " "): np.array(values) for name, values in figures.items()}
    return Evaluation("x", Block(status, arrays), {}, {}, {}, {"task": {"step_size": 10.0}})


def test_a_row_by_hand():
    found = evaluation(
        3, length=[10, 20, 30, 40], inspected_points=[1, 2, 3, 4], phi_sun=[0.1, -0.1, 0, 1], phi_PSM=[1, -1, 1, 1]
    )
    found.team.figures["delta-v"] = np.array([0.1, 0.2, 0.3, 0.4])  # type: ignore[index]
    card = {"environment steps": "5,013,504", "wall time": "18.8 min"}
    cells = Standing.of_evaluation(FlownRow(source="s", note="n"), found, card).cells
    assert cells == (
        "`s` (n)", "75.0 % (30.1 to 95.4)", "2.50", "0.250", "250", "25.0", "25.0 %", "5,013,504", "18.8 min",
    )  # fmt: skip


def test_decisions_and_team_figures_stand_where_they_are_known():
    found = evaluation(1, length=[100], decisions=[7])
    found.team.figures["delta-v per deputy"] = np.array([0.5])  # type: ignore[index]
    standing = Standing.of_evaluation(FlownRow(source="s", training_steps=9), found, {"environment steps": "5"})
    figures = standing.figures
    assert [figures[name] for name in ("decisions", "delta-v [m/s]", "training steps")] == [7.0, 0.5, 9]
    assert FlownRow(source="untrained", training_steps=0).training_steps == 0
    assert figures["violations"] is None
    assert figures["points"] is None


def test_the_best_stands_first(tmp_path):
    (tmp_path / "boards.yml").write_text(BOARDS)
    rows = [
        Standing("worse", {"success": 0.5, "delta-v [m/s]": 0.1}),
        Standing("dear", {"success": 0.9, "delta-v [m/s]": 0.4}),
        Standing("cheap", {"success": 0.9, "delta-v [m/s]": 0.2}),
    ]
    page = leaderboard_page(read_leaderboard([tmp_path / "boards.yml"]), [rows], "command")
    places = [page.index(name) for name in ("| cheap", "| dear", "| worse", "| *A \\| B* (arXiv 0000.00000)")]
    assert places == sorted(places)
    assert "4 episodes of seed 3" in page
    assert "| 50.0 % | 98.82 | - | 1,234 | - | - | - | - |" in page


def test_rows_are_flown_once_and_others_can_add_theirs(typed, tmp_path, monkeypatch):
    code, _, err = typed("boards.yml", "more.yml", "--output", "board.md", "--results", "kept")
    assert code == 0, err
    page = (tmp_path / "board.md").read_text()
    assert "    safe-inspect leaderboard boards.yml more.yml --output board.md\n" in page
    assert "[1/2] Small: zero-thrust" in err
    assert page.index("\n## Small\n") < page.index(f"\nTask: `{TASK}`, with `horizon=30`.\n")
    assert "| `mine` |" in page
    assert "| 12 | 3 min |" in page
    assert json.loads((tmp_path / "kept/small/mine/evaluation.json").read_text())["episodes"] == 4
    monkeypatch.setattr(command, "fly_candidates", lambda *_: pytest.fail("a known row is flown again"))
    code, out, err = typed("boards.yml", "more.yml", "--results", "kept")
    assert code == 0
    assert "[2/2] Small: mine\n  stored in kept/small/mine\n" in err
    assert out.splitlines()[5:] == [*page.splitlines()[5:], ""]


def test_plans_are_made_once(typed, tmp_path):
    rows = f"task: {TASK}, overrides: [horizon=5], rows"
    (tmp_path / "plans.yml").write_text(MORE.replace("random", "optimiser").replace("rows", rows))
    words = ("plans.yml", "--results", "kept", "--episodes", "1")
    code, page, err = typed(*words)
    assert (code, "stored" in err) == (0, False)
    code, again, err = typed(*words)
    assert (code, again, err) == (0, page, "[1/1] Small: mine\n  stored in kept/small/mine.json\n")


def test_a_row_of_other_episodes_or_of_another_version_is_flown_again(typed, monkeypatch):
    assert typed("boards.yml", "--results", "kept")[0] == 0
    flown = []
    whole = command.fly_candidates
    monkeypatch.setattr(command, "fly_candidates", lambda *given: flown.append(given) or whole(*given))
    assert typed("boards.yml", "--results", "kept", "--episodes", "5")[0] == 0
    assert len(flown) == 1
    monkeypatch.setattr(command, "__version__", "99.0")
    assert typed("boards.yml", "--results", "kept", "--episodes", "5")[0] == 0
    assert len(flown) == 2


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (MORE, "the board 'Small' has no `task` in any file"),
        (BOARDS.replace("zero-thrust", "zero-trust"), "board 'Small', row 'zero-trust': no policy 'zero-trust'"),
        (BOARDS.replace("coasts", "coasts, nots: x"), r"rows\[0\].nots: unknown key `nots`; did you mean `note`"),
        (BOARDS.replace("success: 0.5", "success: 50"), r"published\[0\].success"),
        (BOARDS.replace("note: coasts", "overrides: [step_size=5]"), "row 'zero-thrust': .*step_size"),
        (BOARDS.replace("note: coasts", "overrides: [horizon=40]"), "its task differs from that of the board: ."),
        ("[1]", "a leaderboard must be a mapping with the key `boards`"),
    ],
)
def test_mistakes_are_one_message(typed, tmp_path, text, message):
    (tmp_path / "bad.yml").write_text(text)
    code, _, err = typed("bad.yml")
    assert code == 2
    assert re.search(message, err), err
    assert "Traceback" not in err


def test_two_rows_of_one_name_are_refused(tmp_path):
    (tmp_path / "boards.yml").write_text(BOARDS)
    with pytest.raises(SafeInspectError, match="two rows are named 'zero-thrust'"):
        read_leaderboard([tmp_path / "boards.yml"] * 2)


def test_the_shipped_file_has_every_policy_of_the_translational_tasks():
    boards = read_leaderboard([configs_root() / "leaderboard.yml"]).boards
    sources = {row.source for board in boards for row in board.rows}
    translational = {name for name in shipped_policies() if "translational" in name}
    assert {"optimiser", "inspector", "zero-thrust"} | translational <= sources
    assert all(shipped_policy(name).training["environment steps"] for name in translational)
