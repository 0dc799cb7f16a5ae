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
        "--seconds",
        "0.05",
        "--rounds",
        "1",
        "--json",
        str(path),
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return done.stdout, json.loads(path.read_text())


def test_every_case_is_measured_and_told(report):
    text, told = report
    cases = [(row["case"], row["num_envs"], row["thrust"]) for row in told["rates"]]
    assert cases[:4] == [("batch", 1, "small"), ("batch", 1, "full"), ("batch", 3, "small"), ("batch", 3, "full")]
    assert len(cases) == 8
    assert all(row["steps_per_second_median"] > 0.0 for row in told["rates"])
    assert "K-means at every step" in text
    assert {"cpu", "cores", "python", "numpy"} <= set(told["machine"])


def test_the_shares_are_of_the_whole_and_name_each_part(report):
    _, told = report
    for item in told["profiles"]:
        assert sum(item["shares"].values()) == pytest.approx(1.0)
        wanted = {"dynamics", "points", "clustering", "sensors and glues", "rewards", "dones", "control"}
        assert wanted <= set(item["shares"])  # resets are missing from a run in which no episode ends


def test_the_watch_gives_the_inner_time_to_the_inner_section(monkeypatch):
    found = importlib.util.spec_from_file_location("benchmark_environment", SCRIPT)
    module = importlib.util.module_from_spec(found)
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
        monkeypatch.setenv(name, "1")
    monkeypatch.setitem(sys.modules, "benchmark_environment", module)
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
