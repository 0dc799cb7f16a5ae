"""The table of all speeds: it says which ratio has fallen, and fails for it."""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[2] / "benchmarks"


@pytest.fixture
def suite():
    spec = importlib.util.spec_from_file_location("benchmark_suite", FOLDER / "suite.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def report(**ratios):
    rows = [{"name": name, "value": 1e3 * ratio, "unit": "steps/s", "ratio": ratio} for name, ratio in ratios.items()]
    return {"date": "2026-11-21", "machine": {"cores": 2}, "rows": rows}


def measured(suite, monkeypatch, *reports):
    """Have the suite find these reports instead of measuring, one after the other."""
    left = list(reports)
    monkeypatch.setattr(suite, "measure", lambda quick: left.pop(0))
    return left


def test_a_ratio_may_fall_by_a_third(suite, monkeypatch, tmp_path, capsys):
    before = tmp_path / "before.json"
    before.write_text(json.dumps(report(first=3.0, second=12.0, gone=1.0)))
    left = measured(suite, monkeypatch, report(first=2.01, second=20.0, new=1.0))
    assert suite.main(["--compare", str(before), "--json", str(tmp_path / "now.json")]) == 0
    assert not left
    assert json.loads((tmp_path / "now.json").read_text())["rows"][0]["ratio"] == 2.01
    assert "first" in capsys.readouterr().out


def test_a_ratio_that_has_fallen_twice_fails(suite, monkeypatch, tmp_path, capsys):
    before = tmp_path / "before.json"
    before.write_text(json.dumps(report(first=3.0, second=12.0)))
    left = measured(suite, monkeypatch, report(first=1.99, second=12.0), report(first=1.9, second=12.0))
    assert suite.main(["--compare", str(before)]) == 1
    assert not left
    told = capsys.readouterr().err
    assert "first: the ratio was 3.00 and is 1.90" in told
    assert "second" not in told


def test_what_was_slow_once_is_measured_again(suite, monkeypatch, tmp_path):
    before = tmp_path / "before.json"
    before.write_text(json.dumps(report(first=3.0)))
    left = measured(suite, monkeypatch, report(first=1.0), report(first=3.1), report(first=1.0))
    assert suite.main(["--compare", str(before)]) == 0
    assert len(left) == 1


def test_a_missing_report_is_one_message(suite, capsys):
    with pytest.raises(SystemExit):
        suite.main(["--compare", "nowhere.json"])
    assert "nowhere.json: there is no such report" in capsys.readouterr().err


def test_the_recorded_ratios_are_those_of_the_cases_measured_now(suite):
    recorded = json.loads((FOLDER / "reference.json").read_text())
    names = {row["name"].partition(":")[0] for row in recorded["rows"]}
    assert names == {"environment", "sampling", "training"}
    assert all(row["ratio"] > 0 for row in recorded["rows"])
