"""The table of all speeds: it says which ratio has fallen, and fails for it."""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[2] / "benchmarks"


@pytest.fixture
def suite(monkeypatch):
    monkeypatch.syspath_prepend(FOLDER)
    spec = importlib.util.spec_from_file_location("benchmark_suite", FOLDER / "suite.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def rows(**ratios):
    return [
        {"name": f"environment: {name}", "value": 1e3 * ratio, "unit": "steps/s", "ratio": ratio}
        for name, ratio in ratios.items()
    ]


@pytest.fixture
def before(tmp_path):
    path = tmp_path / "before.json"
    path.write_text(json.dumps({"rows": rows(first=3.0, second=12.0, gone=1.0)}))
    return path


def measured(suite, monkeypatch, *reports):
    """Have the suite find these rows instead of measuring, one list after the other; return what was asked for."""
    left, asked = list(reports), []

    def measure(quick, parts):
        asked.append(set(parts))
        return left.pop(0)

    monkeypatch.setattr(suite, "measure", measure)
    return asked


def test_a_ratio_may_fall_by_half(suite, monkeypatch, tmp_path, before, capsys):
    asked = measured(suite, monkeypatch, rows(first=1.51, second=20.0, new=1.0))
    assert suite.main(["--compare", str(before), "--json", str(tmp_path / "now.json")]) == 0
    assert asked == [{"environment", "sampling", "training"}]
    assert json.loads((tmp_path / "now.json").read_text())["rows"][0]["ratio"] == 1.51
    assert "first" in capsys.readouterr().out


def test_a_ratio_that_has_fallen_twice_fails(suite, monkeypatch, before, capsys):
    asked = measured(suite, monkeypatch, rows(first=1.4, second=12.0), rows(first=1.45, second=1.0))
    assert suite.main(["--compare", str(before)]) == 1
    assert asked[1:] == [{"environment"}]
    told = capsys.readouterr().err
    assert "first: the ratio was 3.00 and is 1.45" in told
    assert "second" not in told


def test_the_better_of_two_measurements_of_a_row_counts(suite, monkeypatch, before):
    asked = measured(suite, monkeypatch, rows(first=1.0, second=12.0), rows(first=3.1, second=1.0))
    assert suite.main(["--compare", str(before)]) == 0
    assert len(asked) == 2


def test_a_missing_report_is_one_message(suite, capsys):
    with pytest.raises(SystemExit):
        suite.main(["--compare", "nowhere.json"])
    assert "nowhere.json: there is no such report" in capsys.readouterr().err


def test_the_recorded_ratios_are_those_of_the_cases_measured_now(suite):
    recorded = json.loads((FOLDER / "reference.json").read_text())
    names = {row["name"].partition(":")[0] for row in recorded["rows"]}
    assert names == {"environment", "sampling", "training"}
    assert all(row["ratio"] > 0 for row in recorded["rows"])
