"""Commands that are stopped, or find the disk full, as a user sees them: one line, an exit code, and no lost work."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import pytest

from safe_inspect.cli.main import main

CFG = "safe_inspect/TranslationalInspectionSeed-v0"

#: Runs the command line, with the inspector's search made long and announced.
_LONG_SEARCH = """
import sys
from safe_inspect.cli.main import main
from safe_inspect.evaluation import optimiser
from safe_inspect.policies import inspector
revise = inspector.revise_plan
def announced(problem, state, start, delta_v, seed, effort):
    short = effort._replace(restarts=1, iterations=1)
    revise(problem, state, start.copy(), delta_v.copy(), seed.copy(), short)  # compiled by now
    print("searching", flush=True)
    return revise(problem, state, start, delta_v, seed, effort._replace(iterations=40 * effort.iterations))
inspector.revise_plan = optimiser.revise_plan = announced
sys.exit(main(sys.argv[1:]))
"""
_COMMAND = "import sys; from safe_inspect.cli.main import main; sys.exit(main(sys.argv[1:]))"


def start(code, *words):
    command = [sys.executable, "-c", code, *map(str, words)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True)


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    return tmp_path


@pytest.mark.slow
@pytest.mark.parametrize(
    ("number", "words"),
    [
        (signal.SIGINT, ("evaluate", "inspector", "--output", "out")),
        (signal.SIGTERM, ("evaluate", "inspector", "--output", "out")),
        pytest.param(signal.SIGHUP, ("evaluate", "inspector", "--output", "out"), marks=pytest.mark.long),
        (signal.SIGINT, ("baseline", "optimiser")),
    ],
)
def test_a_search_in_compiled_code_is_stopped_and_leaves_nothing(here, number, words):
    process = start(_LONG_SEARCH, *words, "--cfg", CFG, "--episodes", 3)
    assert process.stdout.readline() == "searching\n"
    time.sleep(0.1)
    os.killpg(process.pid, number)
    _, told = process.communicate(timeout=120)
    assert process.returncode == 128 + number, told
    kept = "; nothing is kept, as the first batch of 3 episodes was not complete"
    assert told.splitlines()[-1] == f"interrupted{kept if words[0] == 'evaluate' else ''}"
    assert not list(here.iterdir())


@pytest.mark.slow
@pytest.mark.parametrize(
    ("number", "name"),
    [
        (signal.SIGINT, "film.gif"),
        (signal.SIGTERM, "film.mp4"),
        pytest.param(signal.SIGINT, "film.mp4", marks=pytest.mark.long),
        pytest.param(signal.SIGTERM, "film.gif", marks=pytest.mark.long),
    ],
)
def test_a_film_that_is_stopped_leaves_the_former_one(here, name, number):
    (here / name).write_text("old")
    code = _COMMAND.replace(
        "sys.exit(",
        "import safe_inspect.figures.film as film; picture = film.Film.picture\n"
        "film.Film.picture = lambda self, index: (print(index, flush=True), picture(self, index))[1]\n"
        "sys.exit(",
        1,
    )
    process = start(code, "film", "random", "--cfg", CFG, "--frames", 500, "--width", 320, "--output", name)
    while process.stdout.readline() != "3\n":
        assert process.poll() is None, process.stderr.read()
    process.send_signal(number)  # to Python alone: ffmpeg waits for more
    _, told = process.communicate(timeout=60)
    assert process.returncode == 128 + number
    assert told.splitlines() == ["pictures: 0 of 500, left -", "interrupted"]
    assert [path.name for path in here.iterdir()] == [name]
    assert (here / name).read_text() == "old"


@contextmanager
def small_files():
    """Let files grow to 1,000 bytes only: what a user's quota does, and much like a full disk."""
    resource = pytest.importorskip("resource")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, limits[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)


@pytest.mark.parametrize(
    ("words", "name"),
    [
        (("schema",), "s.json"),
        (("view", "random", "--cfg", CFG), "v.html"),
        (("draw", "random", "--cfg", CFG), "d.png"),
        (("draw", "random", "--cfg", CFG), "d.svg"),
        (("film", "random", "--cfg", CFG, "--frames", "3", "--width", "320"), "f.gif"),
        (("baseline", "optimiser", "--effort", "quick", "--episodes", "5", "horizon=25"), "b.json"),
    ],
)
def test_a_full_disk_leaves_the_former_file_and_is_one_message(here, capsys, words, name):
    assert main([*words, "--output", name]) == 0  # compiles what has to be
    again = ["--seed", "1", "--force"] if words[0] == "baseline" else []  # it replaces only what it wrote
    if not again:
        (here / name).write_text("old")
    before = (here / name).read_bytes()
    capsys.readouterr()
    with small_files():
        code = main([*words, "--output", name, *again])
    told = [line for line in capsys.readouterr().err.splitlines() if not line.startswith("pictures: 0 of")]
    assert code == 2
    assert len(told) == 1
    assert told[0].startswith(f"error: {name}")
    assert "the file cannot be written (File too large); free some space" in told[0]
    assert (here / name).read_bytes() == before
    assert [path.name for path in here.iterdir()] == [name]


def test_an_evaluation_whose_disk_is_full_prints_its_table(here, capsys):
    words = ["evaluate", "random", "--cfg", CFG, "--episodes", "9", "horizon=25"]
    assert main(words) == 0
    table = capsys.readouterr().out
    for option, what in (("--output", "folder"), ("--json", "file")):
        with small_files():
            code = main([*words, option, "out"])
        out, err = capsys.readouterr()
        assert (code, out) == (2, table)
        assert err.startswith(f"error: out: the {what} cannot be written (File too large); free some space")
        assert not list(here.iterdir())


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="only Linux has it")
@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_output_that_nobody_can_hold_is_one_message(unbuffered):
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [sys.executable, "-c", _COMMAND, "list"],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            env={**os.environ, "PYTHONUNBUFFERED": unbuffered},
            check=False,
        )
    assert done.returncode == 2
    message = "error: standard output: the file cannot be written (No space left on device); free some space"
    assert done.stderr == f"{message}, or write elsewhere\n"


def test_a_reader_that_leaves_is_no_error():
    process = start(_COMMAND, "list")
    process.stdout.close()
    assert process.wait(60) == 0
    assert process.stderr.read() == ""
    process.stderr.close()


@pytest.mark.parametrize(("interrupted", "code"), [(True, 130), (False, 0)])
def test_a_training_that_the_user_stops_has_another_exit_code(here, capsys, monkeypatch, interrupted, code):
    from safe_inspect.cli.commands import train
    from safe_inspect.experiments.runs.train import TrainingResult

    result = TrainingResult(here, None, 3, 900, 1.0, {}, interrupted)
    monkeypatch.setattr(train, "train", lambda run: result)
    assert main(["train", CFG]) == code
    assert ("continue:" in capsys.readouterr().out) == interrupted


@pytest.mark.parametrize("command", [("-m", "safe_inspect"), ("-m", "safe_inspect.train_rl"), ("safe-inspect",)])
def test_a_command_that_is_stopped_while_python_imports_says_nothing(here, command):
    (here / "gymnasium.py").write_text("print('importing', flush=True)\nimport time\ntime.sleep(60)\n")
    words = [sys.executable, *command] if command[0] == "-m" else [Path(sys.executable).with_name("safe-inspect")]
    environment = {**os.environ, "PYTHONPATH": str(here)}
    process = subprocess.Popen(
        [*map(str, words), "list"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment
    )
    assert process.stdout.readline() == "importing\n"
    process.send_signal(signal.SIGINT)
    assert process.communicate(timeout=60) == ("", "")
    assert process.returncode == -signal.SIGINT


def test_a_program_that_imports_the_package_keeps_its_interrupts():
    code = "import signal, safe_inspect; assert signal.getsignal(signal.SIGINT) is signal.default_int_handler"
    subprocess.run([sys.executable, "-c", code], check=True, timeout=60)
