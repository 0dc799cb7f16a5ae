"""A training that is killed can be continued, with the right iteration and without damaged files."""

from __future__ import annotations

import itertools
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest

from safe_inspect.experiments.modules.checkpoints import find_newest
from safe_inspect.experiments.runs.progress import read_progress

pytestmark = [pytest.mark.ray, pytest.mark.slow]

HERE = Path(__file__).parent


def start(*arguments):
    command = [sys.executable, str(HERE / "train_dummy.py"), *map(str, arguments)]
    environment = {key: value for key, value in os.environ.items() if not key.startswith("RAY_")}
    environment["PYTHONPATH"] = str(HERE)
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    return subprocess.Popen(command, env=environment, text=True, start_new_session=True, **pipes)


def wait_for(process, text):
    for line in process.stderr:
        if text in line:
            return
    raise AssertionError(f"the training ended with {process.wait()} before it printed {text!r}")


def finish(*arguments):
    process = start(*arguments)
    printed, progress = process.communicate(timeout=200)
    assert process.returncode == 0, progress
    return printed.split(), progress


def processes(folder):
    """Return numbers and titles of the processes that hold files in Ray's folder open: Ray's write their logs there."""
    found = {}
    for path in Path("/proc").glob("[0-9]*"):
        files = []
        try:
            for file in (path / "fd").iterdir():
                with suppress(FileNotFoundError):  # closed since
                    files.append(os.readlink(file))
            title = (path / "cmdline").read_text().replace("\0", " ")
        except OSError:
            continue
        if any(file.startswith(folder) for file in files):
            found[int(path.name)] = title[:80]
    return found


@pytest.fixture(scope="module")
def killed(tmp_path_factory):
    """Kill a training after its fourth iteration, and return its folder and Ray's."""
    output = tmp_path_factory.mktemp("killed")
    process = start(output, 1000)
    wait_for(process, "iteration    4/")
    process.send_signal(signal.SIGKILL)
    process.communicate()
    (run,) = output.iterdir()
    temporary = (run / ".ray").read_text()
    assert temporary.startswith("/tmp/si-") or len(temporary) <= 40
    yield run, temporary
    shutil.rmtree(temporary, ignore_errors=True)


def test_a_killed_training_continues_from_the_newest_good_checkpoint(killed, tmp_path):
    run, temporary = killed
    copy = shutil.copytree(run, tmp_path / "run")
    newest = find_newest(copy / "tune")[0]
    assert newest.iteration >= 3
    state = newest.path / "learner_group" / "learner" / "state.pkl"
    state.write_bytes(state.read_bytes()[:1000])
    unfinished = newest.path.with_name("checkpoint_000099")
    unfinished.mkdir()
    (unfinished / "rllib_checkpoint.json").write_text("{}")
    reached = find_newest(copy / "tune")[0].iteration
    assert reached < newest.iteration
    printed, progress = finish("unused", reached + 2, copy)
    assert printed == [str(reached + 2), "False"]
    assert "learner_group/learner/state.pkl is not what was saved" in progress
    assert "checkpoint_000099: the checkpoint is incomplete" in progress
    lines = [line for line in progress.splitlines() if line.startswith("iteration")]
    assert lines[0].startswith(f"iteration {reached + 1:>4}/{reached + 2}")
    assert "all episodes start again" in progress
    rows = read_progress(copy / "progress.csv")
    assert [row["iteration"] for row in rows] == list(range(1, reached + 3))
    steps = [row["steps"] for row in rows]
    assert all(512 <= later - earlier <= 544 for earlier, later in itertools.pairwise(steps))
    assert rows[-1]["seconds"] > rows[-2]["seconds"] > rows[-3]["seconds"]
    record = json.loads((copy / "run.json").read_text())
    assert record["attempts"][1]["iteration"] == reached
    assert not Path(temporary).exists()  # what the killed attempt has left
    assert not (copy / ".ray").exists()


def test_a_run_without_any_good_checkpoint_says_so(killed, tmp_path):
    run, _ = killed
    copy = shutil.copytree(run, tmp_path / "run")
    for path in (copy / "tune").glob("**/algorithm_state.pkl"):
        path.unlink()
    process = start("unused", 9, copy)
    _, progress = process.communicate(timeout=200)
    assert process.returncode == 1
    assert "CheckpointError" in progress
    assert "has no complete checkpoint of this configuration" in progress


def signal_group(process, _, number):
    """Send a signal as a terminal and `timeout` do."""
    os.killpg(process.pid, number)


def signal_all(process, temporary, number):
    """Send a signal to every process of the training, as systemd and batch schedulers do."""
    workers = list(processes(temporary))
    assert len(workers) > 4
    for found in {process.pid, *workers}:
        os.kill(found, number)


@pytest.mark.parametrize(
    ("send", "number"),
    [
        (signal_group, signal.SIGINT),
        pytest.param(signal_group, signal.SIGTERM, marks=pytest.mark.long),
        pytest.param(signal_group, signal.SIGHUP, marks=pytest.mark.long),
        (signal_all, signal.SIGTERM),
    ],
)
def test_a_stopped_training_saves_a_checkpoint_and_leaves_nothing(tmp_path, send, number):
    process = start(tmp_path, 1000)
    wait_for(process, "iteration    2/")
    (run,) = tmp_path.iterdir()
    temporary = (run / ".ray").read_text()
    assert any("PPO" in title for title in processes(temporary).values())
    send(process, temporary, number)
    printed, progress = process.communicate(timeout=50)  # Ray would look for a lost cluster for a minute
    iteration, interrupted = printed.split()
    assert interrupted == "True"
    assert "with a checkpoint" in progress
    assert find_newest(run / "tune")[0].iteration == int(iteration)
    assert not Path(temporary).exists()
    deadline = time.monotonic() + 5
    while processes(temporary) and time.monotonic() < deadline:
        time.sleep(0.2)
    assert not processes(temporary)


def test_a_training_that_is_stopped_while_ray_starts_leaves_nothing(tmp_path):
    process = start(tmp_path, 1000)
    wait_for(process, "Ray takes some seconds to start")
    (run,) = tmp_path.iterdir()
    while not (run / ".ray").exists():
        time.sleep(0.01)
    temporary = (run / ".ray").read_text()
    while not processes(temporary):
        time.sleep(0.01)
    os.killpg(process.pid, signal.SIGINT)
    _, told = process.communicate(timeout=60)
    assert "KeyboardInterrupt" in told.splitlines()[-1]
    assert not list(tmp_path.iterdir())
    assert not Path(temporary).exists()
    assert not processes(temporary)


def test_a_killed_training_leaves_no_process(killed):
    _, temporary = killed
    deadline = time.monotonic() + 75  # two of Ray's agents look for their cluster for a minute
    while processes(temporary) and time.monotonic() < deadline:
        time.sleep(1)
    assert not processes(temporary)
