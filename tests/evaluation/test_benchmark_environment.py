from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / "benchmarks" / "environment.py"


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    path = tmp_path_factory.mktemp("benchmark") / "report.json"
    command = [
        sys.executable,
        str(SCRIPT),
        "--envs",
        "1",
        "3",
        "--deputies",
        "1",
        "2",
        "--seconds",
        "0.05",
        "--rounds",
        "1",
        "--json",
        str(path),
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return done.stdout, json.loads(path.read_text())


@pytest.mark.slow
def test_every_case_is_measured_and_reported(report):
    text, told = report
    cases = [(row["case"], row["num_envs"], row["deputies"], row["thrust"]) for row in told["rates"]]
    both = ("small", "full")
    assert cases[:4] == [("batch", count, 1, thrust) for count in (1, 3) for thrust in both]
    assert cases[8:] == [("team", count, size, thrust) for size in (1, 2) for count in (1, 3) for thrust in both]
    assert len(cases) == 16
    assert all(row["steps_per_second_median"] > 0.0 for row in told["rates"])
    assert "K-means at every step" in text
    assert {"cpu", "cores", "python", "numpy"} <= set(told["machine"])


@pytest.mark.slow
def test_the_cost_of_several_deputies_is_compared_with_one(report):
    text, told = report
    assert [(row["deputies"], row["of"]) for row in told["costs"]] == [(2, "the task of one deputy")] * 2 + [
        (2, "a team of one")
    ] * 2
    rate = {(row["case"], row["num_envs"], row["deputies"], row["thrust"]): row for row in told["rates"]}
    last = told["costs"][-1]
    one, two = (rate["team", 1, size, last["thrust"]]["steps_per_cpu_second"] for size in (1, 2))
    assert last["cost_of_a_step"] == pytest.approx(2.0 * one / two)  # one round
    assert text.count("a step with 2 deputies costs") == 4


@pytest.mark.slow
def test_the_shares_are_of_the_whole_and_name_each_part(report):
    _, told = report
    for item in told["profiles"]:
        assert sum(item["shares"].values()) == pytest.approx(1.0)
        wanted = {"dynamics", "points", "clustering", "sensors and glues", "rewards", "dones", "control"}
        assert wanted <= set(item["shares"])  # resets are missing from a run in which no episode ends


def test_the_watch_gives_the_inner_time_to_the_inner_section(monkeypatch):
    found = importlib.util.spec_from_file_location("benchmark_stopwatch", SCRIPT.with_name("stopwatch.py"))
    module = importlib.util.module_from_spec(found)
    found.loader.exec_module(module)
    now = [0.0]
    monkeypatch.setattr(module.time, "perf_counter", lambda: now[0])
    watch = module.Stopwatch()

    def spend(seconds):
        now[0] += seconds

    inner = watch.wrap("inner", lambda: spend(2.0))

    def both():
        spend(1.0)
        inner()
        inner()

    watch.wrap("outer", both)()
    assert watch.seconds == {"inner": 4.0, "outer": 1.0}


def test_nonsense_is_refused():
    done = subprocess.run([sys.executable, str(SCRIPT), "--envs", "0"], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "positive" in done.stderr
