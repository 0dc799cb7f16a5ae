"""No command removes or replaces what it did not write: every option that names an output, given foreign files."""

from __future__ import annotations

import os
import shutil
import sys
from pathlib import Path

import pytest

from safe_inspect.cli.arguments import _path
from safe_inspect.cli.main import command_parser, main
from safe_inspect.config.data import configs_root
from safe_inspect.outputs import MARKER, mark_folder

TASK = str(configs_root() / "translational-inspection" / "experiment-seed.yml")
MISSION = str(configs_root() / "tumbling-rendezvous" / "experiment-truth.yml")
SHORT = [f"mission.{key} s" for key in ("checkout=0.2", "observe=0.2", "time_limit=0.8")]
BOARDS = f"""
episodes: 2
boards: [{{title: Small, task: {TASK}, overrides: [horizon=5], rows: [{{source: random}}]}}]
"""

#: Options that take a path and write nothing.
_INPUTS = {"reference", "resume"}
#: For each output of each command the words of a short call; `train` makes a new folder below the one that is named.
FOLDERS = {
    ("evaluate", "output"): ["evaluate", "random", "--episodes", "2", "horizon=5"],
    ("compare", "output"): ["compare", "random", "zero-thrust", "--episodes", "2", "horizon=5"],
    ("record-log", "output"): ["record-log", MISSION, "--seconds", "2"],
    ("characterise", "output"): ["characterise", "log"],
    ("rendezvous", "output"): ["rendezvous", MISSION, *SHORT],
    ("evaluate", "output", "missions"): ["evaluate", "--cfg", MISSION, *SHORT, "--episodes", "2"],
}
FILES = {
    ("evaluate", "json"): ["evaluate", "random", "--episodes", "2", "horizon=5"],
    ("compare", "json"): ["compare", "random", "zero-thrust", "--episodes", "2", "horizon=5"],
    ("leaderboard", "output"): ["leaderboard", "boards.yml"],
    ("baseline", "output"): ["baseline", "optimiser", "--effort", "quick", "--episodes", "1", "horizon=5"],
    ("schema", "output"): ["schema", "agent"],
    ("export", "output"): ["export", "run"],
    ("draw", "output"): ["draw", "random", "horizon=5"],
    ("film", "output"): ["film", "random", "horizon=5", "--frames", "2"],
    ("view", "output"): ["view", "random", "horizon=5"],
    ("curves", "output"): ["curves", "run"],
    ("safety", "plot"): ["safety", TASK, "--steps", "10", "--num-envs", "2"],
}
OTHERS = {("train", "output"), ("leaderboard", "results")}


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    folder = tmp_path_factory.mktemp("recorded") / "log"
    assert run("record-log", MISSION, "--seconds", "2", "--output", folder) == 0
    (folder / MARKER).unlink()
    return folder


@pytest.fixture(autouse=True)
def here(log, tmp_path, monkeypatch):
    """A working directory with a folder of the user's, an input within it, and links."""
    place = tmp_path / "here"
    (place / "mine" / "deep").mkdir(parents=True)
    monkeypatch.chdir(place)
    monkeypatch.setattr(sys, "path", list(sys.path))
    Path("boards.yml").write_text(BOARDS)
    Path("thesis.tex").write_text("mine")
    Path("mine/thesis.tex").write_text("mine")
    Path("mine/deep/experiment.yml").write_text("mine")
    Path("link").symlink_to("mine")
    shutil.copytree(log, "log")
    Path("log/notes.txt").write_text("mine")
    return place


def content(folder="."):
    """Return all that is in a folder: files with their bytes, links with what they lead to, folders."""
    found = {}
    for place, folders, files in os.walk(folder):
        for name in [*folders, *files]:
            path = Path(place, name)
            found[str(path)] = path.readlink() if path.is_symlink() else path.read_bytes() if path.is_file() else None
    return found


def run(*words):
    try:
        return main([str(word) for word in words])
    except SystemExit as stop:
        return stop.code


def parsers():
    (commands,) = (action.choices for action in command_parser()._subparsers._group_actions)
    for parser in commands.values():
        parser.load()
    return commands


def test_every_output_of_every_command_is_tried():
    outputs = {
        (name, action.dest)
        for name, parser in parsers().items()
        for action in parser._actions
        if action.option_strings and action.dest not in _INPUTS
        if action.type is _path or (action.type is None and "write" in (action.help or ""))
    }
    assert outputs == {key[:2] for key in (*FOLDERS, *FILES)} | OTHERS


#: What a refusal says.
REASONS = (
    "the folder exists already", "this is a file or a symbolic link", "the working directory is in this folder",
    "is not replaced", "is a folder", "the folder cannot be written",
    "not a file of", "the name of the", "only files that end in",
)  # fmt: skip


def refused(words, told):
    """Check that a call without and with --force is refused for its output, and that nothing has changed."""
    before = content("..")
    takes_force = "--force" in parsers()[words[0]]._option_string_actions
    takes_force = takes_force and "--output" in words
    for call in [words, [*words, "--force"]] if takes_force else [words]:
        assert run(*call) == 2
        lines = told.readouterr().err.splitlines()
        message = "\n".join(line for line in lines if not line.startswith("loading;"))
        assert len(message.splitlines()) == 1, message
        assert any(reason in message for reason in REASONS), message
        assert content("..") == before


@pytest.mark.parametrize("words", FOLDERS.values(), ids=map(" ".join, FOLDERS))
@pytest.mark.parametrize("target", ["mine", ".", "..", "/", "link/", "thesis.tex", "log"])
def test_a_folder_that_exists_is_refused(here, capsys, words, target):
    refused([*words, "--output", target], capsys)


@pytest.mark.parametrize("words", FOLDERS.values(), ids=map(" ".join, FOLDERS))
def test_a_foreign_file_in_a_folder_that_the_command_wrote_survives(here, capsys, words):
    mark_folder(Path("mine"), words[0], ["thesis.tex"])
    refused([*words, "--output", "mine"], capsys)


@pytest.mark.parametrize(("key", "words"), FILES.items(), ids=map(" ".join, FILES))
@pytest.mark.parametrize("target", ["thesis.tex", "mine"])
def test_a_file_of_another_kind_survives(here, capsys, key, words, target):
    refused([*words, f"--{key[1]}", target], capsys)


def test_a_foreign_folder_among_the_rows_of_a_leaderboard_survives(here, capsys):
    shutil.copytree("mine", "results/small/random")
    before = content("..")
    assert run("leaderboard", "boards.yml", "--results", "results") == 2
    assert "so it is not replaced" in capsys.readouterr().err
    assert content("..") == before


def test_a_training_makes_its_own_folder(here, monkeypatch):
    from safe_inspect.cli.commands import train
    from safe_inspect.experiments.modules.run_folder import RunFolder

    made = []

    def stop(run):
        made.append(RunFolder.create(run.output, run.name).path)
        raise KeyboardInterrupt

    monkeypatch.setattr(train, "train", stop)
    before = content()
    assert run("train", TASK, "--output", "mine") == 130
    assert set(content()) - set(before) == {os.path.relpath(made[0])}
    assert {name: content()[name] for name in before} == before


@pytest.mark.slow
@pytest.mark.parametrize("words", [FOLDERS[name, "output"] for name in ("evaluate", "record-log", "rendezvous")])
def test_what_a_command_wrote_is_replaced_only_when_it_is_asked_to(here, capsys, words):
    assert run(*words, "--output", "out") in (0, 1)
    before = content("out")
    assert f"out/{MARKER}" in before
    assert run(*words, "--output", "out") == 2
    assert content("out") == before
    Path("log.txt").write_text("mine")
    assert run(*words, "--output", "out", "--force") in (0, 1)
    assert set(content("out")) == set(before)
