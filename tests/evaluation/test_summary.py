from __future__ import annotations

import json

import numpy as np

from safe_inspect.evaluation import AgentEpisodes, Episodes, summarise


def episodes(count: int) -> Episodes:
    ramp = np.arange(1.0, count + 1.0)
    return Episodes(
        seed=5,
        returns=ramp,
        terms={"A": -ramp},
        length=np.arange(10, 10 + count),
        status=np.array([1, 2, 1, 3, 1][:count], dtype=np.int8),
        info={"inspected_fraction": ramp / count},
        delta_v=np.full(count, 2.0),
    )


def test_figures_by_hand():
    summary = summarise(episodes(5))
    assert summary.success_rate == 0.6
    assert summary.statuses == {"win": 3, "lose": 1, "draw": 1}
    assert summary.statistics["return"].mean == 3.0
    assert summary.statistics["return"].standard_deviation == np.sqrt(2.5)
    assert summary.statistics["reward/A"].mean == -3.0
    assert (summary.statistics["delta-v"].mean, summary.statistics["delta-v"].unit) == (2.0, "m/s")


def test_each_agent_has_its_own_figures():
    agents = {
        name: AgentEpisodes(
            returns=np.array(returns), terms={}, length=np.array([3, 4, 5]),
            status=np.array(status, dtype=np.int8), delta_v=np.array([1.0, 2.0, 6.0]),
        )
        for name, returns, status in (("red", [1.0, 2.0, 3.0], [1, 1, 2]), ("blue", [4.0, 4.0, 7.0], [2, 3, 1]))
    }  # fmt: skip
    summary = summarise(
        Episodes.of(agents, seed=1, length=np.array([3, 4, 5]), status=np.array([1, 2, 1], dtype=np.int8))
    )
    red, blue = summary.agents.values()
    assert (red.success_rate, blue.success_rate) == (2 / 3, 1 / 3)
    assert red.statuses == {"win": 2, "lose": 1}
    assert blue.statuses == {"win": 1, "lose": 1, "draw": 1}
    assert (red.statistics["return"].mean, blue.statistics["return"].mean) == (2.0, 5.0)
    assert red.statistics["delta-v"].mean == 3.0
    text = str(summary)
    assert "red: " in text
    assert "66.7 % (win 2, lose 1)" in text
    assert "33.3 % (win 1, lose 1, draw 1)" in text


def test_the_table_has_a_line_for_each_figure():
    lines = str(summarise(episodes(5))).splitlines()
    assert lines[0] == "5 episodes, seed 5: success rate 60.0 % (win 3, lose 1, draw 1)"
    assert "  delta-v              2.0000  0.0000  m/s" in lines
    assert len(lines) == 2 + 5


def test_json_has_no_nan_for_a_single_episode():
    summary = summarise(episodes(1))
    told = json.loads(json.dumps(summary.as_dict(), allow_nan=False))
    assert told["statistics"]["return"] == {"mean": 1.0, "standard_deviation": None, "unit": "-"}
    assert told["success_rate"] == 1.0
    assert " - " in str(summary)
