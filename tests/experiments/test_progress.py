"""The line of an iteration, the time that is left, and the files that a training writes."""

from __future__ import annotations

import io
import json
import math
import os
import subprocess
import sys

import numpy as np
import pytest

from safe_inspect.experiments.runs import progress
from safe_inspect.experiments.runs.progress import (
    Messages,
    TrainingLog,
    TrainingProgress,
    clock_text,
    flatten,
    read_progress,
    row_of,
    time_left,
)


def result(iteration, **runners):
    """Return a result of RLlib after an iteration of 2 s and 4,000 steps."""
    return flatten(
        {
            "training_iteration": iteration,
            "num_env_steps_sampled_lifetime": 4000 * iteration,
            "time_total_s": 2.0 * iteration,
            "time_this_iter_s": 2.0,
            "done": False,
            "date": "today",
            "config": {"lr": 0.1},
            "env_runners": {"num_episodes_lifetime": 3 * iteration, **runners},
            "learners": {"default_policy": {"policy_loss": np.float32(0.5)}},
        }
    )


def test_flattening_keeps_the_numbers():
    flat = result(1, episode_return_mean=np.float64(0.25), reward={"a": 1})
    assert flat["env_runners/episode_return_mean"] == 0.25
    assert flat["env_runners/reward/a"] == 1.0
    assert not {"date", "config/lr", "done"} & set(flat)


def test_the_line_of_an_iteration():
    progress = TrainingProgress({"training_iteration": 75}, io.StringIO())
    for iteration in (11, 12):
        stream = io.StringIO()
        progress._stream = stream
        progress.show(
            result(iteration, episode_return_mean=0.8312, success_rate=0.123, inspected_fraction=0.61, delta_v=2.314)
        )
    assert stream.getvalue() == (
        "iteration   12/75  steps     48,000    2,000/s  return   0.831  success  12 %  inspected  61 %  "
        "delta-v   2.31 m/s  left 0:02:06\n"
    )


def test_what_is_not_known_yet_is_a_dash():
    stream = io.StringIO()
    TrainingProgress({}, stream).show(result(1))
    assert "return       -  success   - %  delta-v      - m/s  left -" in stream.getvalue()


def test_the_nearest_limit_counts():
    now = {"training_iteration": 10.0, "num_env_steps_sampled_lifetime": 4000.0}
    rates = {"training_iteration": 0.5, "num_env_steps_sampled_lifetime": 100.0}
    assert time_left({"training_iteration": 20, "num_env_steps_sampled_lifetime": 5000}, now, rates) == 10.0
    assert time_left({"training_iteration": 9.2e18}, now, rates) == math.inf
    assert time_left({"env_runners/success_rate": 0.9}, now, rates) == math.inf
    assert time_left({"training_iteration": 5}, now, rates) == 0.0


@pytest.mark.parametrize(("seconds", "text"), [(0, "0:00:00"), (3725.4, "1:02:05"), (59.6, "0:01:00"), (math.inf, "-")])
def test_clock(seconds, text):
    assert clock_text(seconds) == text


def test_a_row_holds_the_terms_of_the_reward():
    row = row_of(result(1, reward={"near": -1.0}, delta_v=3.0))
    assert row["reward/near"] == -1.0
    assert row["delta_v"] == 3.0
    assert row["policy_loss"] == 0.5
    assert math.isnan(row["success_rate"])


def test_a_column_that_appears_late_is_in_the_file(tmp_path):
    log = TrainingLog(tmp_path)
    log.add(result(1))
    log.add(result(2, reward={"near": -1.0}, success_rate=0.5))
    log.close()
    first, second = read_progress(tmp_path / "progress.csv")
    assert math.isnan(first["reward/near"])
    assert (second["reward/near"], second["success_rate"], second["steps"]) == (-1.0, 0.5, 8000.0)


def test_the_log_continues_after_the_checkpoint(tmp_path):
    log = TrainingLog(tmp_path)
    for iteration in (1, 2, 3, 4):
        log.add(result(iteration, success_rate=0.1))
    log.close()
    with (tmp_path / "progress.csv").open("a") as file, (tmp_path / "result.json").open("a") as lines:
        file.write("5,20000")  # killed in the middle of a row
        lines.write('{"training_it')
    log = TrainingLog(tmp_path, iteration=2, steps=8000)
    log.add(result(3, success_rate=0.9))
    log.close()
    rows = read_progress(tmp_path / "progress.csv")
    assert [row["iteration"] for row in rows] == [1, 2, 3]
    assert [row["success_rate"] for row in rows] == [0.1, 0.1, 0.9]
    lines = [json.loads(line) for line in (tmp_path / "result.json").read_text().splitlines()]
    assert [line["training_iteration"] for line in lines] == [1, 2, 3]


def test_tensorboard_counts_environment_steps(tmp_path):
    log = TrainingLog(tmp_path)
    log.add(result(1, success_rate=0.25))
    log.add(result(2, success_rate=0.5))
    log.close()
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    events = EventAccumulator(str(tmp_path / "tensorboard"))
    events.Reload()
    found = [(event.step, event.value) for event in events.Scalars("env_runners/success_rate")]
    assert found == [(4000, 0.25), (8000, 0.5)]


def test_a_stream_that_fails_does_not_end_a_training():
    class Closed(io.StringIO):
        def write(self, text):
            raise OSError(5, "Input/output error")

        def flush(self):
            raise BrokenPipeError

    messages = Messages(Closed())
    print("text", file=messages, flush=True)
    TrainingProgress({}, messages).show(result(1))


def test_compiling_is_not_counted_in_what_is_left():
    stream = io.StringIO()
    TrainingProgress({"training_iteration": 4}, stream).show(
        result(1) | {"time_total_s": 102.0, "compiling_seconds": 100.0}
    )
    assert stream.getvalue().endswith("  left 0:00:06\n")
    assert "2,000/s" in stream.getvalue()


@pytest.fixture
def heartbeat(tmp_path, monkeypatch):
    """Return a function that gives what is printed at a time, the stream, the file of the note and the heartbeat."""
    now = [0.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    stream, note = io.StringIO(), tmp_path / ".compiling"
    heart = progress.Heartbeat(stream, note)

    def beats(until):
        printed = []
        while now[0] < until:
            now[0] += 2.0
            heart.beat()
            printed += [(now[0], line) for line in stream.getvalue().splitlines()]
            stream.seek(0)
            stream.truncate()
        return printed

    return beats, stream, note, heart


def test_a_training_says_within_ten_seconds_that_it_compiles_and_then_that_it_lives(heartbeat):
    beats, _, note, heart = heartbeat
    note.touch()
    (first, text), *others = beats(70.0)
    assert first <= 10.0
    assert text == "compiling, once for each installation: up to some minutes on a busy machine ..."
    assert [line for _, line in others] == [
        "working on the first iteration, compiling, for 0:00:32",
        "working on the first iteration, compiling, for 0:01:00",
    ]
    heart.iteration()
    note.unlink()
    ((when, text),) = beats(120.0)
    assert when <= 100.0
    assert text == "working on the next iteration, for 0:00:28"


def test_a_training_that_does_not_compile_does_not_say_so(heartbeat):
    beats, _, note, _ = heartbeat
    assert [line for _, line in beats(30.0)] == ["working on the first iteration, for 0:00:28"]
    note.touch()
    beats(32.0)
    note.unlink()  # code that is compiled again in each process takes a moment
    assert not any("compiling, once" in line for _, line in beats(60.0))


def test_the_note_is_there_while_a_process_compiles(tmp_path):
    code = (
        "import os, sys, numba\n"
        "from safe_inspect.compiling.kernel import COMPILING_NOTE, prepare\n"
        "from pathlib import Path\n"
        "note = Path(os.environ[COMPILING_NOTE]); prepare(); seen = []\n"
        "from numba.core import event\n"
        "class Sees(event.Listener):\n"
        "    def on_start(self, event): seen.append(note.exists())\n"
        "    def on_end(self, event): pass\n"
        "event.register('numba:compile', Sees())\n"
        "numba.njit(lambda x: x + 1)(1)\n"
        "assert seen == [True], seen\n"
        "from safe_inspect.compiling.kernel import compiling_seconds\n"
        "assert note.exists() == (compiling_seconds() > 2.0)\n"
    )
    environment = os.environ | {"SAFE_INSPECT_COMPILING_NOTE": str(tmp_path / "note")}
    subprocess.run([sys.executable, "-c", code], env=environment, check=True)
