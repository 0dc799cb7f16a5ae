"""Words of a command line: numbers, overrides, and what becomes of errors, without the work of a command."""

from __future__ import annotations

import argparse
import errno
import subprocess
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from safe_inspect.cli import arguments, flights, shown_episode
from safe_inspect.cli import main as command_line
from safe_inspect.cli.commands import leaderboard
from safe_inspect.cli.flight_arguments import sources_of
from safe_inspect.cli.main import Parser, command_parser, parse_arguments, run_command
from safe_inspect.errors import ConfigError, Problem, SafeInspectError
from safe_inspect.interrupts import Interrupted

NUMBERS: dict[Callable[[str], Any], tuple[dict[str, Any], tuple[str, ...], str]] = {
    arguments.positive: ({"1": 1, "12": 12, "+2": 2}, ("0", "-1", "x", "1.5", ""), "a whole number of at least 1"),
    arguments.seed: (
        {"0": 0, "7": 7, str(2**64 - 1): 2**64 - 1, "0" * 19 + "7": 7},
        ("-1", str(2**64), "0" * 21, "x", "1.5", ""),
        "a whole number from 0 to 2**64 - 1",
    ),
    arguments.natural: ({"0": 0, "12": 12}, ("-1", "x", "1.5", ""), "a whole number of at least 0"),
    arguments.positive_number: ({"0.5": 0.5, "3": 3.0}, ("0", "-1", "x", "nan", "inf", ""), "a positive number"),
    shown_episode._number: (
        {"0": 0, str(2**31 - 1): 2**31 - 1}, ("-1", str(2**31), "x"), "the number of an episode, from 0",
    ),
    shown_episode._seconds: ({"0.5": 0.5, "1e3": 1000.0}, ("0", "-1", "x", "inf", "nan"), "a time above 0 in seconds"),
}  # fmt: skip


@pytest.mark.parametrize("kind", NUMBERS, ids=lambda kind: kind.__name__)
def test_numbers_within_their_limits_are_taken_and_no_others(kind: Callable[[str], Any]) -> None:
    taken, refused, wanted = NUMBERS[kind]
    for text, value in taken.items():
        assert kind(text) == value
        assert type(kind(text)) is type(value)
    for text in refused:
        with pytest.raises(argparse.ArgumentTypeError) as caught:
            kind(text)
        assert str(caught.value) == f"expected {wanted}, not {text!r}"


@pytest.mark.parametrize(
    ("word", "override"),
    [("~a", True), ("a=1", True), ("a", False), ("a:1", False), ("there=1", False), ("~there", True)],
)
def test_a_file_with_an_equals_sign_is_no_override(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, word: str, override: bool
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "there=1").write_text("")
    assert arguments.is_override(word) is override


@pytest.mark.parametrize(
    ("word", "hint"),
    [
        ("a:1", "did you mean `a=1`?"),
        ("a:", "write an override as KEY=VALUE"),
        ("a", "write an override as KEY=VALUE"),
    ],
)
def test_a_colon_is_taken_for_an_equals_sign(word: str, hint: str) -> None:
    assert arguments.equals_hint(word) == hint


@pytest.mark.parametrize(
    ("words", "given"),
    [
        (["validate", "x.yml", "a=1", "~b"], {"cfg": "x.yml", "overrides": ["a=1", "~b"]}),
        (["validate", "a=1", "--cfg", "x.yml", "b=2"], {"cfg": "x.yml", "overrides": ["a=1", "b=2"]}),
        (["validate", "a=1", "x.yml"], {"cfg": "x.yml", "overrides": ["a=1"]}),
        (["validate", "--", "-x.yml"], {"cfg": "-x.yml", "overrides": []}),
        (["validate", "--compute-platform", "big", "x.yml"], {"cfg": "x.yml", "compute_platform": "big"}),
        (["train", "--resume", "run"], {"cfg": None, "resume": Path("run"), "dry_run": False, "output": None}),
        (["train", "--dry-run", "x.yml", "--output", "o"], {"cfg": "x.yml", "dry_run": True, "output": Path("o")}),
        (["evaluate", "a", "b=1", "--seed", "3", "c"], {"words": ["a", "b=1", "c"], "seed": 3, "episodes": None}),
        (["evaluate", "a", "--sampled"], {"sampled": True}),
        (["evaluate", "a", "--mode"], {"sampled": False}),
        (["evaluate", "a"], {"sampled": None, "num_envs": 512, "workers": None, "record": None, "force": False}),
        (["compare", "a", "b", "--policy", "p", "--policy", "q"], {"policy": ["p", "q"], "record": None}),
        (["curves", "r", "--label", "a"], {"runs": ["r"], "label": ["a"], "each": False}),
        (["safety", "x.yml", "--audit", "3"], {"audit": 3, "off": False, "steps": 1_000_000, "num_envs": 1024}),
        (["film", "inspector"], {"frames": 200, "fps": 25, "width": 800, "turn": 0.0, "episode": 0, "seed": 0}),
        (["help", "train"], 0),
        (["validate"], "no experiment: give an experiment file; see"),
        (["validate", "x.yml", "y.yml"], "unrecognized arguments: y.yml; write an override as KEY=VALUE; see"),
        (["validate", "x.yml", "a:1"], "unrecognized arguments: a:1; did you mean `a=1`?; see"),
        (["validate", "x.yml", "--sed"], "unrecognized arguments: --sed; to override"),
        (["validate", "x.yml", "--cgf", "y"], "unrecognized arguments: --cgf; did you mean `--cfg`?; see"),
        (["validate", "x.yml", "--override", "a=1"], "unrecognized arguments: --override; write only KEY=VALUE; see"),
        (
            ["evaluate", "a", "--force"],
            "--force needs --output; give --output, or remove --force; see",
        ),
        (["trian"], "there is no command 'trian'; did you mean `train`?; see `safe-inspect --help`"),
        (["warm", "--fast"], "unrecognized arguments: --fast; see"),
        (["schema", "agent", "more"], "unrecognized arguments: more; write an override as KEY=VALUE; see"),
    ],
)
def test_what_a_command_line_means(
    capsys: pytest.CaptureFixture[str], words: list[str], given: dict[str, Any] | str | int
) -> None:
    if isinstance(given, dict):
        found = parse_arguments(command_parser(), words)
        assert {name: getattr(found, name) for name in given} == given
        return
    with pytest.raises(SystemExit) as stopped:
        parse_arguments(command_parser(), words)
    shown = capsys.readouterr()
    if isinstance(given, int):
        assert stopped.value.code == given
        assert shown.out.startswith("usage: safe-inspect train")
    else:
        assert stopped.value.code == 2
        assert shown.err.startswith(f"error: {given}")
        assert shown.err.count("\n") == 1


def _parser(run: Callable[[argparse.Namespace], int]) -> Parser:
    parser = Parser(prog="prog")
    parser.set_defaults(run=run)
    return parser


NOTED = Interrupted(15)
NOTED.add_note("one is kept")


@pytest.mark.parametrize(
    ("error", "code", "shown"),
    [
        (None, 7, ""),
        (SafeInspectError("it is wrong"), 2, "error: it is wrong\n"),
        (SafeInspectError("x" * 1000), 2, f"error: {'x' * 57}...\n"),
        (SafeInspectError("x" * 999), 2, f"error: {'x' * 999}\n"),
        (ConfigError([Problem("one"), Problem("two")]), 2, "errors:\none\ntwo\n"),
        (KeyboardInterrupt(), 130, "interrupted\n"),
        (NOTED, 143, "interrupted; one is kept\n"),
        (BrokenPipeError(), 0, ""),
        (OSError(errno.ENOSPC, "No space left on device", "here"), 2, "error: here: the file cannot be written"),
        (OSError(errno.EDQUOT, "Quota"), 2, "error: standard output: the file cannot be written"),
    ],
)  # fmt: skip
def test_the_exit_code_says_how_a_command_ended(
    capfd: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    error: BaseException | None,
    code: int,
    shown: str,
) -> None:
    monkeypatch.setattr(command_line, "discard_output", lambda: None)

    def run(_: argparse.Namespace) -> int:
        if error is not None:
            raise error
        return 7

    assert run_command(_parser(run), []) == code
    said = capfd.readouterr().err
    assert said.startswith(shown)
    assert said.count("\n") == max(shown.count("\n"), bool(shown))


def test_the_name_of_a_plugin_that_failed_is_printed_once(capsys: pytest.CaptureFixture[str]) -> None:
    note = "raised in the reward Mine (mine.py:3)"
    error = RuntimeError(f"my fault\n{note}")  # Ray passes on an error with its notes in the text
    error.add_note(note)

    def run(_: argparse.Namespace) -> int:
        raise error

    assert run_command(_parser(run), []) == 2
    assert capsys.readouterr().err.count(note) == 1


def test_warnings_to_users_are_one_line_while_a_command_runs() -> None:
    before = warnings.formatwarning
    shown = []

    def run(_: argparse.Namespace) -> int:
        kinds = (UserWarning, FutureWarning, DeprecationWarning)
        shown.extend(warnings.formatwarning("beware", kind, "file", 3) for kind in kinds)
        return 0

    assert run_command(_parser(run), []) == 0
    assert shown == ["warning: beware\n"] * 2 + [before("beware", DeprecationWarning, "file", 3)]
    assert warnings.formatwarning is before


@pytest.mark.parametrize("error", [OSError(errno.EACCES, "no"), RuntimeError("a fault of the program")])
def test_a_fault_of_the_program_keeps_its_traceback(error: Exception) -> None:
    def run(_: argparse.Namespace) -> int:
        raise error

    with pytest.raises(type(error)):
        run_command(_parser(run), [])


@pytest.mark.parametrize("lines", [3, 30_000])
def test_a_command_completes_although_its_reader_leaves(tmp_path: Path, lines: int) -> None:
    """As with `| head -1`: what it writes after printing is not lost, and nothing is reported."""
    code = (
        "import argparse, sys, time\n"
        "from pathlib import Path\n"
        "from safe_inspect.cli.main import Parser, run_command\n"
        "def run(arguments):\n"
        f"    for line in range({lines}): print('line', line, flush=line < 2)\n"
        "    time.sleep(0.3)\n"
        "    print('more', flush=True)\n"
        "    Path('results.txt').write_text('all')\n"
        "    return 3\n"
        "parser = Parser()\n"
        "parser.set_defaults(run=run)\n"
        "sys.exit(run_command(parser, []))\n"
    )
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "cwd": tmp_path}
    with subprocess.Popen([sys.executable, "-c", code], **pipes) as process:
        assert process.stdout.readline() == b"line 0\n"
        process.stdout.close()
        said = process.stderr.read()
        assert process.wait(60) == 3
    assert said == b""
    assert (tmp_path / "results.txt").read_text() == "all"


def test_streams_that_are_closed_take_what_is_printed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdout", None)
    monkeypatch.setattr(sys, "stderr", None)
    assert run_command(_parser(lambda _: print("x") or 0), []) == 0
    for stream in (sys.stdout, sys.stderr):
        assert stream is not None
        stream.close()


@pytest.mark.parametrize(
    ("label", "taken", "name"),
    [
        ("a/b c", [], "a-b-c"), ("..x..", [], "x"), ("?", [], "evaluation"), ("a", ["a"], "a-2"),
        ("a", ["a", "a-2"], "a-3"), ("a", ["b"], "a"), ("a.b_c-d", [], "a.b_c-d"),
    ],
)  # fmt: skip
def test_a_label_becomes_its_own_folder(label: str, taken: list[str], name: str) -> None:
    assert flights._new_name(label, taken) == name


@pytest.mark.parametrize(
    ("words", "command"),
    [
        ([], "safe-inspect leaderboard"),
        (["a b.yml", "--episodes", "9", "--board", "X Y", "--board", "Z", "--output", "o.md", "--results", "r"],
         "safe-inspect leaderboard 'a b.yml' --board 'X Y' --board Z --episodes 9 --output o.md"),
    ],
)  # fmt: skip
def test_a_page_names_the_command_that_makes_it(words: list[str], command: str) -> None:
    assert leaderboard._command(parse_arguments(command_parser(), ["leaderboard", *words])) == command


def test_sources_and_overrides_are_distinguished(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a:b").write_text("")
    found = parse_arguments(
        command_parser(), ["evaluate", "one", "x=1", "one", "a:b", "--policy", "p", "--policy", "p"]
    )
    assert sources_of(found) == ["one", "a:b", "--policy p"]
    assert found.overrides == ["x=1"]
    with pytest.raises(SafeInspectError, match=r"^there is no policy 'c:d'; did you mean `c=d`\?$"):
        sources_of(parse_arguments(command_parser(), ["evaluate", "c:d"]))
