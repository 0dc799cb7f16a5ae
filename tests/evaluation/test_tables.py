"""Every column of the tables of evaluations, computed a second time from the raw episodes with NumPy alone."""

from __future__ import annotations

import numpy as np
import pytest

from safe_inspect.evaluation.results.results import Block, Evaluation
from safe_inspect.evaluation.results.tables import compare, evaluation_table, pooled_table
from safe_inspect.metrics.statistics import paired_difference

EPISODES = 41  # no rate lies between two that are shown
UNITS = {"return": "-", "delta-v": "m/s", "closest deputies": "m", "spin": "rad/s"}
HEAD = ["", "mean", "std", "IQM", "95 % interval of the IQM", "min", "max", "unit"]


def raw(seed: int) -> dict[str, np.ndarray]:
    """Return skewed figures, so that no two of mean, median, spread, least and largest are alike."""
    generator = np.random.default_rng(seed)
    figures = {
        "return": generator.gamma(2.0, 3.0, EPISODES) - 4.0,
        "delta-v": 5.0 + generator.exponential(2.0, EPISODES),
        "closest deputies": generator.lognormal(3.0, 0.7, EPISODES),
        "spin": 1e-5 * generator.gamma(1.5, 2.0, EPISODES),
    }
    figures["closest deputies"][generator.choice(EPISODES, 7, replace=False)] = np.nan
    return figures


def evaluation(label: str, *seeds: int) -> Evaluation:
    team, *agents = (
        Block(np.random.default_rng(seed).choice(np.array(["win", "lose", "draw"], object), EPISODES), raw(seed))
        for seed in seeds
    )
    named = {f"blue{index}": agent for index, agent in enumerate(agents)}
    return Evaluation(label, team, named, UNITS, {}, {"seed": 1, "task": {}})


def cells(lines: list[str], head: list[str]) -> dict[str, dict[str, str]]:
    """Return the cells of a table by the name of the row and that of the column."""
    rows = [[cell.strip() for cell in line.strip().split("  ") if cell.strip()] for line in lines]
    return {row[0]: dict(zip(head[1:], row[1:], strict=True)) for row in rows}


def shown(value: float) -> str:
    return f"{value:.4f}" if value == 0.0 or abs(value) >= 1e-3 else f"{value:.3g}"


def middle_half(values: np.ndarray) -> np.ndarray:
    count = values.shape[-1]
    return np.sort(values)[..., count // 4 : count - count // 4]


def check(found: dict[str, dict[str, str]], figures: dict[str, np.ndarray], episodes: int) -> None:
    assert list(found) == list(figures)
    generator = np.random.default_rng(7)
    for name, values in figures.items():
        values, row = values[~np.isnan(values)], found[name]
        spread = np.sqrt(np.square(values - values.mean()).sum() / (len(values) - 1))
        told = [row[column] for column in ("mean", "std", "IQM", "min", "max")]
        figure = middle_half(values).mean()
        assert told == [shown(each) for each in (values.mean(), spread, figure, values.min(), values.max())], name
        low, high = map(float, row["95 % interval of the IQM"].split(" to "))
        again = generator.choice(values, (4000, len(values)))
        expected = np.quantile(middle_half(again).mean(axis=-1), (0.025, 0.975))
        np.testing.assert_allclose((low, high), expected, atol=0.12 * (expected[1] - expected[0]))
        some = f" ({len(values)} of {episodes})" if len(values) < episodes else ""
        assert row["unit"] == UNITS[name] + some


def test_every_column_of_an_evaluation_and_its_agents():
    whole = evaluation("mine", 1, 2, 3)
    lines = evaluation_table(whole).splitlines()
    assert [cell.strip() for cell in lines[1].split("  ") if cell.strip()] == HEAD[1:]
    per = len(UNITS)
    check(cells(lines[2 : 2 + per], HEAD), dict(whole.team.figures), EPISODES)
    for index, (name, agent) in enumerate(whole.agents.items()):
        first = 2 + per + index * (per + 1)
        won = (agent.status == "win").mean()
        assert lines[first].startswith(f"{name}: success {100 * won:.1f} % (95 % interval ")
        for ending in ("win", "lose", "draw"):
            assert f"{ending} {(agent.status == ending).sum()}" in lines[first]
        check(cells(lines[first + 1 : first + 1 + per], HEAD), dict(agent.figures), EPISODES)


def test_every_column_of_several_sources_together():
    sources = [evaluation("one", 4), evaluation("two", 5)]
    line, _, *lines = pooled_table(sources).splitlines()
    together = {name: np.concatenate([one.team.figures[name] for one in sources]) for name in UNITS}
    found = cells(lines, HEAD)
    rates = [100 * (one.team.status == "win").mean() for one in sources]
    assert f"success {np.mean(rates):.1f} %" in line
    assert line.endswith(f"each: {rates[0]:.1f}, {rates[1]:.1f})")
    check(found, together, 2 * EPISODES)


def test_a_comparison_is_the_other_less_the_first():
    first, other = evaluation("first", 8), evaluation("other", 9)
    found = compare([first, other])
    won = {one.label: (one.team.status == "win").astype(float) for one in (first, other)}
    columns = {name: (first.team.figures[name], other.team.figures[name]) for name in UNITS}
    assert list(found.differences) == ["success", *UNITS]
    head = ["", "mean", "95 % interval", "IQM", "lower in", "higher in", "unit"]
    text = str(found).splitlines()
    start = text.index("other less first, episode by episode:") + 2
    rows = cells(text[start : start + 1 + len(UNITS)], head)
    for name, (mine, theirs) in {"success": (won["first"], won["other"]), **columns}.items():
        gap = theirs - mine
        gap = gap[~np.isnan(gap)]
        difference = found.differences[name]["other"]
        assert (difference.count, difference.mean) == (len(gap), pytest.approx(gap.mean()))
        assert difference.iqm == pytest.approx(middle_half(gap).mean())
        assert (difference.smaller, difference.larger) == pytest.approx(((gap < 0.0).mean(), (gap > 0.0).mean()))
        width = 1.96 * gap.std(ddof=1) / np.sqrt(len(gap))
        low, high = difference.interval.low, difference.interval.high
        np.testing.assert_allclose((low, high), (gap.mean() - width, gap.mean() + width), atol=0.3 * width)
        star = " *" if low > 0.0 or high < 0.0 else ""
        told = [rows[name][column] for column in ("mean", "IQM", "lower in", "higher in")]
        shares = [f"{100 * share:.0f} %" for share in ((gap < 0.0).mean(), (gap > 0.0).mean())]
        assert told == [shown(gap.mean()) + star, shown(middle_half(gap).mean()), *shares], name
    estimates = {line.split()[0]: line.split() for line in text[: start - 2] if line.startswith("  ")}
    for name in ("return", "delta-v"):
        told = estimates[name][1:3]
        assert told == [shown(middle_half(one.team.figures[name]).mean()) for one in (first, other)]


def test_what_is_higher_by_one_is_higher_by_one():
    figures = raw(3)["return"]
    higher, lower = paired_difference(figures + 1.0, figures, "m"), paired_difference(figures, figures + 1.0, "m")
    assert (higher.mean, higher.larger, higher.smaller, higher.verdict) == (pytest.approx(1.0), 1.0, 0.0, "higher")
    assert (lower.mean, lower.larger, lower.smaller, lower.verdict) == (pytest.approx(-1.0), 0.0, 1.0, "lower")
