"""Rows of a leaderboard, the table of a baseline and the table of a model card, from episodes flown again."""

from __future__ import annotations

import json

import numpy as np
import pytest
from model_cards import CardData, model_card

from safe_inspect.evaluation.baselines import baseline_table
from safe_inspect.policies.plan_record import read_record

from .figures import bootstrap_bounds, cells, iqm, wilson
from .flown import EPISODES, EXPERIMENT, HORIZON, TASK, typed
from .one_deputy import DT, OneDeputy, fly

BOARDS = f"""
episodes: {EPISODES}
seed: 11
boards:
  - title: Small
    task: {EXPERIMENT}
    overrides: [horizon={HORIZON}]
    rows:
      - {{source: inspector, training_steps: 1234567, wall_time: 3.4 min}}
      - {{source: random}}
"""


def rows_of(text: str) -> list[list[str]]:
    """Return the cells of the tables of a Markdown text."""
    lines = [line for line in text.splitlines() if line.startswith("| ")]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]


def success(won: np.ndarray) -> str:
    """Return the share of the episodes that were won as a leaderboard has it."""
    low, high = wilson(int(won.sum()), len(won))
    return f"{100.0 * won.mean():.1f} % ({100.0 * low:.1f} to {100.0 * high:.1f})"


def test_the_rows_of_policies(flown, tmp_path):
    (tmp_path / "boards.yml").write_text(BOARDS)
    page = typed("leaderboard", tmp_path / "boards.yml", "--results", tmp_path / "kept")
    head, _, *rows = rows_of(page)
    columns = "success", "points", "delta-v [m/s]", "time [s]", "decisions", "violations", "training steps", "wall time"
    assert head == ["", *columns]
    assert [row[0] for row in rows] == ["`inspector`", "`random`"]
    for row, training in zip(rows, (("1,234,567", "3.4 min"), ("-", "-")), strict=True):
        one = flown[row[0].strip("`")]
        figures = one.figures
        violated = np.min([values for name, values in figures.items() if name.startswith("phi ")], axis=0) < 0.0
        assert 0 < violated.sum() <= EPISODES
        assert tuple(row[1:]) == (
            success(one.status == "win"),
            f"{figures['inspected points'].mean():.2f}",
            f"{figures['delta-v'].mean():.3f}",
            f"{DT * figures['length'].mean():,.0f}",
            f"{figures['length'].mean():,.1f}",
            f"{100.0 * violated.mean():.1f} %",
            *training,
        )


def test_plans_and_their_table(flown, tmp_path):
    """The optimiser's plans, flown again burn by burn."""
    boards = BOARDS.replace("source: random", "source: optimiser").replace(f"episodes: {EPISODES}", "episodes: 3")
    (tmp_path / "boards.yml").write_text(boards)
    page = typed("leaderboard", tmp_path / "boards.yml", "--results", tmp_path / "kept")
    file = tmp_path / "kept" / "small" / "optimiser.json"
    record = json.loads(file.read_text())
    found = []
    for episode, plan in enumerate(record["plans"]):
        thrust = np.zeros((HORIZON, 3))
        for burn in plan:
            thrust[burn["step"] : burn["step"] + burn["steps"]] += burn["thrust"]
        start = flown["inspector"].flights[episode]
        deputy = OneDeputy(TASK, observes=False)
        deputy.reset(start.position[0], start.velocity[0], start.sun_angle[0])
        flight = fly(deputy, lambda flight, thrust=thrust: thrust[flight.steps])
        burns = len(plan)
        found.append((flight.status == "win", flight.count, flight.delta_v[-1], flight.steps, burns))
        assert (record["success"][episode], record["inspected"][episode]) == found[-1][:2]
        assert record["spent"][episode] == pytest.approx(flight.delta_v[-1], rel=1e-9)
        assert (record["steps"][episode], record["burns"][episode]) == (flight.steps, burns)
        assert record["own"][episode]
    won, points, spent, steps, burns = np.array(found, float).T
    (row,) = [row for row in rows_of(page) if row[0] == "`optimiser`"]
    assert row[1:] == [
        success(won), f"{points.mean():.2f}", f"{spent.mean():.3f}", f"{DT * steps.mean():,.0f}",
        f"{burns.mean():,.1f}", "-", "-", "-",
    ]  # fmt: skip
    lines = baseline_table(read_record(file)).splitlines()
    assert lines[1].split() == ["success", f"{100 * won.mean():.2f}", "%", f"({int(won.sum())}", "of", "3)"]
    assert f"{points.mean():.2f} points" in lines[2]
    assert lines[3].split() == ["mean", "median", "least", "most"]
    for line, values, digits in zip(lines[4:7], (spent, burns, steps), (4, 1, 1), strict=True):
        expected = [values.mean(), np.sort(values)[1], values.min(), values.max()]
        assert cells(line)[1:] == [f"{value:.{digits}f}" for value in expected]
    other = np.array(record["inspector"])  # its limits are those of the task, unlike the evaluated inspector's
    share = 100.0 * (spent.mean() / other.mean() - 1.0)
    text = f"inspector {other.mean():.4f} m/s on average over 3 episodes; plans {spent.mean():.4f} ({share:+.1f} %)"
    assert lines[-1] == text


def test_a_model_card(flown):
    """The card has four significant digits."""
    titles = {"One": flown["inspector"], "Two": flown["random"]}
    training = {"steps": 5_013_504, "seconds": 1127.9, "iteration": 306, "seed": 4900}
    evaluations = {title: one.record for title, one in titles.items()}
    card = model_card(CardData("name", "t", "c", "m", evaluations), training, [])
    facts = {row[0]: row[1] for row in rows_of(card) if len(row) == 2}
    assert facts["environment steps"] == "5,013,504"
    assert (facts["iterations"], facts["wall time"], facts["seed"]) == ("306", f"{1127.9 / 60:.1f} min", "4900")
    for title, one in titles.items():
        section = card.partition(f"### {title}")[2].partition("##")[0]
        assert f"{EPISODES} episodes, seed 11." in section
        low, high = wilson(int((one.status == "win").sum()), EPISODES)
        ends = ", ".join(
            f"{end} {(one.status == end).sum()}" for end in ("win", "lose", "draw") if (one.status == end).any()
        )
        rate = (
            f"Success {100 * (one.status == 'win').mean():.1f} % (95 % interval {100 * low:.4g} to {100 * high:.4g} %"
        )
        assert f"{rate}; {ends})." in section
        rows = {row[0]: row[1:] for row in rows_of(section)}
        assert rows.pop("figure") == ["mean", "std", "IQM", "95 % interval of the IQM", "unit"]
        assert set(rows) == set(one.figures) - {"inspected first"}
        for name, (average, spread, middle, interval, _) in rows.items():
            known = one.figures[name][~np.isnan(one.figures[name])]
            if not len(known):
                assert (average, spread, middle, interval) == ("-", "-", "-", "- to -")
                continue
            expected = (known.mean(), known.std(ddof=1), iqm(known))
            for cell, value in zip((average, spread, middle), expected, strict=True):
                assert float(cell) == pytest.approx(value, rel=6e-4, abs=1e-9), name
            for end, (low, high) in zip(interval.split(" to "), bootstrap_bounds([known], iqm), strict=True):
                slack = 6e-4 * abs(float(end)) + 1e-9
                assert low - slack <= float(end) <= high + slack, name
