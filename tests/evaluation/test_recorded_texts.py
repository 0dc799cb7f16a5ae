"""Tables, comparisons and records of evaluations read as they do on record, with every width of the terminal."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from safe_inspect.evaluation.results.results import Block, Evaluation, EvaluationError
from safe_inspect.evaluation.results.tables import aligned, compare, evaluation_table, number, pooled_table, span
from safe_inspect.metrics.statistics import Interval

from ..recorded import assert_recorded

RECORD = Path(__file__).with_name("texts.txt")
EPISODES = 29
UNITS = {"return": "-", "delta-v": "m/s", "clearance": "m", "reward/goal": "-"}
ENDS = np.array(["win", "lose", "draw", "running"], object)


def block(seed: int, lacks: str = "") -> Block:
    """Return made-up figures; some episodes have no clearance."""
    generator = np.random.default_rng(seed)
    figures = {
        "return": generator.gamma(2.0, 3.0, EPISODES) - 4.0,
        "delta-v": 1e-3 * generator.exponential(2.0, EPISODES),
        "clearance": np.where(generator.random(EPISODES) < 0.4, np.nan, generator.lognormal(3.0, 0.7, EPISODES)),
        "reward/goal": np.full(EPISODES, 0.5 * seed),
    }
    figures.pop(lacks, None)
    return Block(generator.choice(ENDS, EPISODES, p=(0.6, 0.2, 0.1, 0.1)), figures)


def evaluation(label: str, seed: int, agents: int = 1, **changes: Any) -> Evaluation:
    """Return a made-up evaluation."""
    own = {f"blue{index}": block(10 * seed + index) for index in range(agents)}
    begins = {"position": np.arange(float(EPISODES))[:, None], "velocity": np.zeros((EPISODES, 1))}
    record = {"seed": 3, "task": {"name": "made-up", "mass": 12.0}, "price": 1}
    return replace(Evaluation(label, block(seed), own, UNITS, begins, record), **changes)


def causes() -> Any:
    """Return causes of losses, one of them of more episodes than are named."""
    found = np.full(EPISODES, "", dtype=object)
    found[3:16], found[20:22], found[25] = "no fuel", "no plan", "camera silent"
    return found


@pytest.mark.parametrize("columns", [0, 110, 90, 75, 60, 40, 20])
def test_a_table_reads_as_on_record(columns: int, monkeypatch: pytest.MonkeyPatch) -> None:
    if columns:
        monkeypatch.setenv("COLUMNS", str(columns))
    else:
        monkeypatch.delenv("COLUMNS", raising=False)
    other = evaluation("other", 2, units={**UNITS, "clearance": "km"})
    one = evaluation("one", 1, agents=2, causes=causes())
    text = "\n\n".join([evaluation_table(one), evaluation_table(other), pooled_table([one, other])])
    assert_recorded(f"{text}\n\n{compare([one, other])}", RECORD)


def test_comparisons_read_as_on_record() -> None:
    first, second = evaluation("first", 1), evaluation("second", 1)
    lacking = evaluation("third", 3, team=block(3, "clearance"))
    priced = evaluation("priced", 4, record={**first.record, "price": 2})
    for others in ([second], [lacking, second], [priced], [lacking, priced]):
        found = compare([first, *others])
        assert_recorded(f"{found}\n{json.dumps(found.as_dict(), indent=1)}", RECORD)
    found = compare([lacking, first])
    assert_recorded(str(found), RECORD)


def test_an_evaluation_as_numbers_is_that_on_record() -> None:
    assert_recorded(json.dumps(evaluation("one", 5, agents=2).as_dict(), indent=1), RECORD)
    assert_recorded(json.dumps(evaluation("one", 5).as_dict(), indent=1), RECORD)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            {"record": {"seed": 4, "task": {}}},
            "the seed is 3 in one and 4 in the other",
        ),
        (
            {"team": Block(np.array(["win"] * 5, object), {})},
            "the number of episodes is 29 in one and 5 in the other",
        ),
        (
            {"record": {"seed": 3, "task": {"name": "other", "mass": 12.0}}},
            "their tasks differ in name",
        ),
        (
            {"record": {"seed": 3, "task": {"name": "other", "mass": 1.0, "a": 1, "b": 2}}},
            "their tasks differ in name, mass, a, ...",
        ),
        (
            {"initial_states": {"position": np.zeros((EPISODES, 2)), "velocity": np.zeros((EPISODES, 2))}},
            "their deputies differ",
        ),
        (
            {
                "initial_states": {
                    "position": (np.arange(29.0) % 25)[:, None],
                    "velocity": np.where(np.arange(29) == 7, 1.0, 0.0)[:, None],
                }
            },
            "5 of their 29 episodes have different initial states (the first is episode 7), as the initial states of "
            "the configurations differ or an enabled filter refuses different ones",
        ),
    ],
)
def test_other_episodes_are_refused_in_these_words(change: dict[str, Any], words: str) -> None:
    with pytest.raises(EvaluationError) as caught:
        compare([evaluation("one", 1), evaluation("other", 1, **change)])
    remedy = (
        "evaluate both with the same --seed, --episodes and --cfg; if only one needs overrides for that, evaluate each "
        "with --output and compare the folders"
    )
    if words.startswith("their tasks"):
        remedy = (
            "evaluate both in one task with --cfg, which takes policies with the observations and actions of that "
            "task; those of other tasks have no episodes in common, so read the tables of `safe-inspect evaluate`"
        )
    assert str(caught.value) == f"one and other cannot be compared: {words}; {remedy}"


def test_one_evaluation_and_one_label_are_refused() -> None:
    one = evaluation("one", 1)
    for given, words in (
        ([one], "a comparison needs at least two evaluations, got 1; give another"),
        ([one, one], "two evaluations have the same label; give each a different label"),
    ):
        with pytest.raises(EvaluationError) as caught:
            compare(given)
        assert str(caught.value) == words


def test_numbers_are_written_with_four_digits_behind_the_point() -> None:
    shown = {
        0.0: "0.0000", 0.001: "0.0010", -0.001: "-0.0010", 0.000999: "0.000999", 1.5e-7: "1.5e-07",
        12.34567: "12.3457", np.nan: "-", np.inf: "-",
    }  # fmt: skip
    assert [number(value) for value in shown] == list(shown.values())
    assert span(Interval(0.5, 1.0)) == "0.5000 to 1.0000"
    assert span(Interval(np.nan, np.nan)) == "-"


def test_columns_are_left_out_one_after_the_other(monkeypatch: pytest.MonkeyPatch) -> None:
    blocks = [[["", "mean", "std", "min", "max", "unit"], ["a", "1", "22", "333", "4444", "m"]], [["b", *"12345"]]]
    wide = [["     mean  std  min   max  unit", "  a     1   22  333  4444  m"], ["  b     1    2    3     4  5"]]
    widths = 1 + 4 + 3 + 3 + 4 + 4
    monkeypatch.setenv("COLUMNS", str(2 * 6 + widths))
    assert aligned(blocks) == wide
    monkeypatch.setenv("COLUMNS", str(2 * 6 + widths - 1))
    assert [line.split() for line in aligned(blocks)[0]] == [
        ["mean", "std", "min", "unit"],
        ["a", "1", "22", "333", "m"],
    ]
