"""The table of a baseline and the row of plans on the leaderboard, from entries by hand."""

from __future__ import annotations

import pytest
from scipy.stats import binomtest

from safe_inspect.evaluation.baselines import baseline_table
from safe_inspect.evaluation.results.leaderboard import FlownRow, Standing
from safe_inspect.policies.plan_record import Entry, Record

#: Won, delta-v, steps, points, burns; what the search planned, what the inspector spends, whether the plan is own.
ROWS = [
    (True, 0.10, 30, 100, 4.0, 0.10, 0.20, True),
    (True, 0.20, 50, 100, 6.0, 0.25, 0.20, False),
    (True, 0.30, 40, 100, 8.0, None, 0.40, False),
    (False, 0.40, 80, 90, 2.0, 0.40, None, True),
]


def record(effort: str) -> Record:
    names = ("success", "delta_v", "steps", "inspected", "burns", "planned", "inspector", "own")
    entries = tuple(Entry(key=key, **dict(zip(names, row, strict=True))) for key, row in enumerate(ROWS))
    return Record(seed=5, effort=effort, task={}, about={}, entries=entries)


def test_the_table_compares_the_plans_with_the_inspector():
    assert baseline_table(record("thorough")).splitlines() == [
        "optimiser, 4 episodes of seed 5, effort thorough",
        "success    75.00 %   (3 of 4)",
        "inspected  97.50 points on average",
        "                   mean   median    least     most",
        "delta-v [m/s]    0.2500   0.2500   0.1000   0.4000",
        "burns               5.0      5.0      2.0      8.0",
        "steps              50.0     45.0     30.0     80.0",
        "plans     1 not found; 1 not confirmed by the simulator, or costlier than the inspector;",
        "          the inspector's flight is used in 2 episodes",
        "inspector 0.2667 m/s on average over 3 episodes; plans 0.2000 (-25.0 %)",
    ]


@pytest.mark.parametrize("spent", [0.0, None])
def test_plans_without_an_inspector_to_compare_with_have_no_share(spent):
    whole = record("quick")
    entries = tuple(Entry(**{**vars(entry), "inspector": spent}) for entry in whole.entries)
    text = baseline_table(Record(seed=5, effort="quick", task={}, about={}, entries=entries))
    assert "%)" not in text.splitlines()[-1]
    assert ("inspector 0.0000 m/s on average over 3 episodes" in text) == (spent is not None)


def test_the_row_of_plans_on_the_leaderboard():
    row = Standing.of_plans(FlownRow(source="optimiser"), record("quick"), step_size=10.0)
    low, high = binomtest(3, 4).proportion_ci(0.95, method="wilson")
    assert row.figures["success"] == 0.75
    assert (row.interval.low, row.interval.high) == pytest.approx((low, high), rel=1e-12)
    names = ("points", "delta-v [m/s]", "time [s]", "decisions")
    assert [row.figures[name] for name in names] == pytest.approx([97.5, 0.25, 500.0, 5.0])
    assert "violations" not in row.figures
