"""Evaluations that are stopped keep their finished batches, and the same command continues to the same result."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from safe_inspect.cli.main import main
from safe_inspect.config.data import configs_root
from safe_inspect.environments import load_spec
from safe_inspect.errors import SafeInspectError
from safe_inspect.evaluation import baseline, rollout, rollouts
from safe_inspect.evaluation.kept import KeptEpisodes, _batch_file
from safe_inspect.evaluation.task import default_metrics

CONFIGS = configs_root()
SHORT = ("--episodes", "6", "--num-envs", "2", "horizon=12")
BOARDS = f"""
episodes: 6
boards:
  - title: Small
    task: {CONFIGS / "translational-inspection" / "experiment-seed.yml"}
    overrides: [horizon=12]
    rows: [{{source: zero-thrust}}, {{source: random}}]
"""


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    Path("boards.yml").write_text(BOARDS)
    return tmp_path


@pytest.fixture
def flown(monkeypatch):
    """The first episodes of the batches that are flown; a batch in `stops` is stopped."""
    found, whole = [], rollouts._fly_batch

    def fly(environment, flying, metrics, first, *rest):
        found.append(first)
        if found.count(first) == 1 and first in stops:
            stops.remove(first)
            raise KeyboardInterrupt
        return whole(environment, flying, metrics, first, *rest)

    stops: list[int] = []
    found_and_stops = (found, stops)
    monkeypatch.setattr(rollouts, "_fly_batch", fly)
    return found_and_stops


def results(folder):
    """Return the files of evaluations, without what says when and by what words they were made."""
    found = {}
    for path in sorted(Path(folder).rglob("*")):
        name = str(path.relative_to(folder))
        if path.name == "evaluation.json":
            record = json.loads(path.read_text())
            found[name] = {key: value for key, value in record.items() if key not in ("date", "command")}
        elif path.is_file():
            found[name] = path.read_bytes()
    return found


@pytest.mark.parametrize(
    "words",
    [
        ("evaluate", "random", "zero-thrust", "--record", "3"),
        ("evaluate", "random", "--record", "6"),
        ("compare", "random", "zero-thrust"),
    ],
)
def test_what_was_flown_is_kept_and_gives_the_same_results(capsys, flown, words):
    found, stops = flown
    assert main([*words, *SHORT, "--output", "whole"]) == 0
    table = capsys.readouterr().out.replace("whole", "out")
    found.clear()
    stops += [2, 4]
    for kept in (2, 4):
        assert main([*words, *SHORT, "--output", "out"]) == 130
        count = 6 * (len(words) - (words[-2] == "--record") * 2 - 1)
        told = f"interrupted; {kept} of {count} episodes are kept in out.part; run the same command to continue\n"
        assert capsys.readouterr() == ("", told)
        assert not Path("out").exists()
    assert main([*words, *SHORT, "--output", "out"]) == 0
    assert capsys.readouterr().out == table
    assert found[:5] == [0, 2, 2, 4, 4]
    assert results("out") == results("whole")
    assert not Path("out.part").exists()


def test_without_a_folder_the_loss_is_reported(capsys, flown):
    flown[1].append(4)
    assert main(["evaluate", "random", *SHORT]) == 130
    told = "interrupted; 4 of 6 episodes were run and are lost; --output FOLDER stores them\n"
    assert capsys.readouterr() == ("", told)
    assert [path.name for path in Path().iterdir()] == ["boards.yml"]


@pytest.mark.parametrize(
    ("change", "key"),
    [
        (["--seed", "1"], "`random.seed`"),
        (["--episodes", "8"], "`random.episodes`"),
        (["--num-envs", "3"], "`num_envs`"),
        (["--record", "1"], "`random.recorded`"),
        (["horizon=13"], "`random.task."),
        (["--metric", "ThrustingSteps"], "`random.metrics`"),
    ],
)
def test_other_arguments_are_refused_or_start_again(capsys, flown, change, key):
    found, stops = flown
    stops.append(4)
    assert main(["evaluate", "random", *SHORT, "--output", "out"]) == 130
    before = {path.name: path.read_bytes() for path in Path("out.part").iterdir()}
    capsys.readouterr()
    assert main(["evaluate", "random", *SHORT, *change, "--output", "out"]) == 2
    told = capsys.readouterr().err
    assert "the folder has episodes of an interrupted `evaluate` with other arguments (they differ in" in told
    assert key in told
    assert {path.name: path.read_bytes() for path in Path("out.part").iterdir()} == before
    found.clear()
    assert main(["evaluate", "random", *SHORT, *change, "--output", "out", "--force"]) == 0
    assert found[0] == 0
    assert not Path("out.part").exists()


def test_another_policy_starts_again_and_foreign_folders_survive(capsys, flown):
    flown[1].append(4)
    assert main(["evaluate", "random", *SHORT, "--output", "out"]) == 130
    assert main(["evaluate", "zero-thrust", *SHORT, "--output", "out"]) == 2
    assert main(["compare", "random", "zero-thrust", *SHORT, "--output", "out", "--force"]) == 2
    assert "out.part: the folder is not from an interrupted `compare`" in capsys.readouterr().err
    Path("out.part/thesis.tex").write_text("mine")
    assert main(["evaluate", "zero-thrust", *SHORT, "--output", "out", "--force"]) == 0
    assert [path.name for path in Path("out.part").iterdir()] == ["thesis.tex"]
    Path("next.part").mkdir()
    Path("next.part/thesis.tex").write_text("mine")
    assert main(["evaluate", "zero-thrust", *SHORT, "--output", "next", "--force"]) == 2
    assert [path.name for path in Path("next.part").iterdir()] == ["thesis.tex"]


def test_force_replaces_the_former_result_when_the_new_one_is_complete(capsys, flown):
    words = ["evaluate", "random", *SHORT, "--output", "out", "--force"]
    assert main([*words, "--seed", "1"]) == 0
    former = results("out")
    flown[0].clear()
    flown[1].append(4)
    assert main(words) == 130
    assert results("out") == former
    flown[0].clear()
    assert main(words) == 0
    assert flown[0] == [4]
    assert results("out") != former


def test_a_leaderboard_continues_within_a_row(capsys, flown):
    found, stops = flown
    words = ["leaderboard", "boards.yml", "--num-envs", "2", "--results"]
    assert main([*words, "whole"]) == 0
    page = capsys.readouterr().out
    found.clear()
    stops.append(4)
    assert main([*words, "results"]) == 130
    assert (
        "4 of 6 episodes are kept in results/small/zero-thrust.part; run the same command to continue; the finished "
        "rows are in results, and the same command continues\n"
    ) in capsys.readouterr().err
    assert main([*words, "results"]) == 0
    assert capsys.readouterr().out == page
    assert found == [0, 2, 4, 4, 0, 2, 4]
    assert results("results") == results("whole")


@pytest.mark.parametrize("error", [ZeroDivisionError("no luck"), SafeInspectError("no luck"), OSError("no luck")])
def test_an_error_keeps_the_finished_batches(monkeypatch, capsys, flown, error):
    found = flown[0]
    assert main(["evaluate", "random", *SHORT, "--output", "whole"]) == 0
    table = capsys.readouterr().out.replace("whole", "out")
    found.clear()
    add = KeptEpisodes.add

    def fail(self, first, batch):
        if first == 4:
            raise error
        add(self, first, batch)

    with monkeypatch.context() as patch:
        patch.setattr(KeptEpisodes, "add", fail)
        note = "4 of 6 episodes are kept in out.part, and the same command continues with them; delete the folder if "
        if isinstance(error, SafeInspectError):
            assert main(["evaluate", "random", *SHORT, "--output", "out"]) == 2
            assert f"error: no luck; {note}" in capsys.readouterr().err
        else:
            with pytest.raises(type(error), match="no luck") as raised:
                main(["evaluate", "random", *SHORT, "--output", "out"])
            assert raised.value.__notes__[0].startswith(note)
    found.clear()
    assert main(["evaluate", "random", *SHORT, "--output", "out"]) == 0
    assert found == [4]
    assert capsys.readouterr().out == table
    assert not Path("out.part").exists()


def test_an_error_in_the_first_batch_leaves_no_folder(monkeypatch, flown):
    def fail(*_):
        raise ZeroDivisionError

    monkeypatch.setattr(KeptEpisodes, "add", fail)
    with pytest.raises(ZeroDivisionError):
        main(["evaluate", "random", *SHORT, "--output", "out"])
    assert [path.name for path in Path().iterdir()] == ["boards.yml"]


def test_a_damaged_batch_is_flown_again(capsys, flown):
    found, stops = flown
    stops.append(4)
    assert main(["evaluate", "random", *SHORT, "--output", "out"]) == 130
    Path("out.part", _batch_file("random", 0)).write_bytes(b"PK damaged")
    found.clear()
    assert main(["evaluate", "random", *SHORT, "--output", "out"]) == 0
    assert found == [0, 4]


@pytest.mark.parametrize(
    "file",
    [
        "translational-inspection/experiment-seed.yml",
        "multiagent-translational-inspection/experiment.yml",
        "weighted-six-dof-inspection/experiment.yml",
        "docking/experiment.yml",
    ],
)
def test_every_kind_of_episode_is_kept_bit_for_bit(tmp_path, file):
    spec = load_spec(CONFIGS / file, ["horizon=9"])
    kept = KeptEpisodes(tmp_path, "x")
    whole = rollout(spec, baseline("random"), 3, record=2, metrics=default_metrics(spec), kept=kept)
    assert kept.count == 3
    found = KeptEpisodes(tmp_path, "x").get(0, 3)
    assert same(found, whole)


def same(one, other):
    """Return whether two values and their types are identical."""
    if isinstance(one, np.ndarray):
        return one.dtype == other.dtype and one.shape == other.shape and one.tobytes() == other.tobytes()
    if hasattr(one, "__dataclass_fields__"):
        one, other = vars(one), vars(other)
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(same(one[key], other[key]) for key in one)
    if isinstance(one, tuple):
        return len(one) == len(other) and all(map(same, one, other))
    return one == other and isinstance(one, type(other))


@pytest.mark.slow
def test_a_killed_evaluation_continues(capsys):
    """`kill -9` leaves the batches and nothing that hinders the next call."""
    code = """
import sys, time
from safe_inspect.cli.main import main
from safe_inspect.evaluation import rollouts as rollout
fly = rollout._fly_batch
def announced(environment, flying, metrics, first, *rest):
    print(first, flush=True)
    time.sleep(60 * (first == 4))
    return fly(environment, flying, metrics, first, *rest)
rollout._fly_batch = announced
sys.exit(main(sys.argv[1:]))
"""
    words = ["evaluate", "random", *SHORT, "--output", "out"]
    process = subprocess.Popen([sys.executable, "-c", code, *words], stdout=subprocess.PIPE, text=True)
    while process.stdout.readline() != "4\n":
        assert process.poll() is None
    time.sleep(0.1)
    os.kill(process.pid, signal.SIGKILL)
    process.communicate()
    assert {path.name for path in Path("out.part").glob("*.npz")} == {_batch_file("random", first) for first in (0, 2)}
    assert main(words) == 0
    assert main([*words[:-1], "whole"]) == 0
    assert results("out") == results("whole")
    assert sorted(path.name for path in Path().iterdir()) == ["boards.yml", "out", "whole"]
