"""What the commands say to mistyped words, odd files and odd surroundings: one line that says what to do, at once."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from safe_inspect.cli.main import main
from safe_inspect.config.data import configs_root

CFG = str(configs_root() / "translational-inspection" / "experiment-seed.yml")
RENDEZVOUS = str(configs_root() / "tumbling-rendezvous" / "experiment-truth.yml")
REWARD = "agent_config.0.config.config.rewards.0.functor"
SHORT = ("--episodes", "3", "horizon=5")


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    return tmp_path


@pytest.fixture
def typed(capsys):
    def run(*words):
        try:
            code = main([str(word) for word in words])
        except SystemExit as stop:
            code = stop.code
        captured = capsys.readouterr()
        return code, captured.out, captured.err

    return run


@pytest.mark.parametrize(
    ("words", "shown"),
    [
        (["--verison"], "unrecognized arguments: --verison; did you mean `--version`?"),
        (["-x", "list"], "unrecognized arguments: -x; known: --help, --version"),
        (["hlep"], "there is no command 'hlep'"),
        (["validate", CFG, "horizon:600"], "horizon:600; did you mean `horizon=600`?"),
        (["validate", CFG, "horizon"], "horizon; write an override as KEY=VALUE"),
        (["evaluate", "random", "horizon:600"], "no policy 'horizon:600'; did you mean `horizon=600`?"),
        (["evaluate", CFG], "this is an experiment, not a policy; give it with --cfg"),
        (["evaluate", "configs/none.yml"], "this is an experiment, not a policy; give it with --cfg"),
        (["evaluate", "safe_inspect/Docking-v0"], "this is an experiment, not a policy; give it with --cfg"),
        (["validate", "TranslationalInspection-v1"], "did you mean `safe_inspect/TranslationalInspection-v1`?"),
        (["compare", "random", "random"], "random is given twice; give another one"),
        (["compare", "random"], "`compare` needs two or more sources"),
        (["evaluate", "random", "--force"], "--force needs --output"),
        (["baseline", "optimiser", "--force"], "--force needs --output"),
        (["evaluate", "random", "--record", "5", *SHORT, "--output", "o"], "--record 5: there are only 3 episodes"),
        (["evaluate", "random", "--metric", "{functor: TimeToCoverage, config: {fraction: 2}}"],
         "config.fraction: expected a number of 1 or less, got 2"),
        (["evaluate", "inspector", "--cfg", "safe_inspect/Docking-v0"],
         "no body with inspection points is named 'chief': this task has none"),
        (["validate", CFG, f"{REWARD}=os.system"],
         "'os.system' is not a plugin; a reward must be a subclass of safe_inspect.rewards.Reward"),
        (["validate", CFG, f"{REWARD}=..rewards"], "is not a module path; write it as package.module"),
        (["validate", CFG, "agent_config.0.name='a b'"], "expected a name without spaces and slashes, got 'a b'"),
        (["safety", CFG, "--plot", "x.xyz"], "x.xyz: the name of the figure must end in .png, .pdf, .svg; give such"),
        (["export", "nowhere", "--output", "x.txt"], "x.txt: the name of the policy file must end in .onnx; give"),
        (["baseline", "random"], "there is no baseline 'random'; write `optimiser`, or run a policy by"),
        (["schema", "experment"], "there is no kind of file 'experment'; did you mean `experiment`?"),
        (["leaderboard", "--board", "Three deputy"],
         "--board: there is no board 'Three deputy'; did you mean `Three deputies`?"),
        (["validate", "safe_inspect/Doking-v0"],
         "there is no task with the id 'safe_inspect/Doking-v0'; did you mean `safe_inspect/Docking-v0`?"),
        (["view", "random", "--cfg", CFG, "--output", "page.txt"], "page.txt"),
        (["schema", "experiment", "--output", ""], "argument --output: the path is empty; name a file or folder"),
        (["validate", CFG, "fcnet_hiddens=[]"], "fcnet_hiddens: expected at least 1 items, got []"),
        (["validate", "safe_inspect/TranslationalInspectionSeed-v0", "policy=!include configs/learners/sac.yml",
          "entropy_coeff_schedule=[[0, 1]]"], "there is no key `entropy_coeff`; known: `actor_lr`"),
        (["draw", "random", "--until", "0"], "expected a time above 0 in seconds, not '0'"),
    ],
)  # fmt: skip
def test_one_line_says_what_to_do(typed, here, words, shown):
    code, out, err = typed(*words)
    assert (code, out) == (2, "")
    assert shown in err
    assert len(err.splitlines()) == 1
    assert not list(here.iterdir())


@pytest.mark.parametrize(
    ("words", "shown"),
    [
        (["--dry-run", "chaser.position=[0, 0, 0]"], "the chaser would overlap the target"),
        (["--dry-run", "target={functor: MeshTarget, config: {path: none.stl, mating_point: [0 m, 0 m, 1 m]}}"],
         "none.stl: the mesh cannot be read"),
    ],
)  # fmt: skip
def test_a_mission_is_refused_before_it_is_flown_or_printed(typed, words, shown):
    code, out, err = typed("rendezvous", RENDEZVOUS, *words)
    assert (code, out) == (2, "")
    (line,) = [line for line in err.splitlines() if not line.startswith("loading; ")]
    assert shown in line


def test_a_warning_is_one_line_without_source_code():
    command = [sys.executable, "-m", "safe_inspect.cli.main", "validate", CFG, "psm_horizon=90 s"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    (line,) = done.stderr.splitlines()
    assert line.startswith("warning: `psm_horizon=90 s` sets agent_config.0.config.config.glues.0.config.")


def test_help_is_a_command(typed):
    assert typed("help") == typed("--help")
    assert typed("help", "evaluate") == typed("evaluate", "--help")


def test_a_file_may_begin_with_a_dash(typed):
    Path("-e.yml").write_text("")
    for words in (["validate", "--"], ["train", "--dry-run", "--"], ["acceptance", "--draws", "9", "--"]):
        assert "-e.yml:1: the file is empty" in typed(*words, "-e.yml")[2]
    assert "unrecognized arguments: -e.yml" in typed("validate", "-e.yml")[2]


@pytest.mark.parametrize(
    "words",
    [
        ["validate", CFG, f"horizon={'9' * 90_000}"],
        ["evaluate", "x" * 90_000],
        ["validate", "x" * 90_000],
        ["evaluate", "random", "--seed", "9" * 90_000],
        ["evaluate", "random", "--episodes", "9" * 90_000],
        ["validate", "big.yml"],
    ],
    ids=["override", "source", "file name", "seed", "episodes", "file"],
)
def test_a_long_number_is_cut_in_messages(typed, words):
    Path("big.yml").write_text(f"a: {'9' * 900_000}\n")
    code, _, err = typed(*words)
    assert code == 2
    assert len(err) < 1500


def test_files_that_are_none(typed):
    os.mkfifo("fifo")
    os.symlink("loop", "loop")
    os.symlink("gone.yml", "broken")
    for name, shown in (
        ("fifo", "fifo:1: the file is empty"),
        ("loop", "cannot read 'loop', a symbolic link to 'loop': Too many levels of symbolic links"),
        ("broken", "cannot read 'broken', a symbolic link to 'gone.yml': No such file or directory"),
    ):
        code, _, err = typed("validate", name)
        assert (code, shown in err) == (2, True), err


@pytest.mark.slow
@pytest.mark.parametrize("text", ["[" * 20_000, "[" * 20_000 + "]" * 20_000, "{a: " * 20_000])
def test_brackets_without_end_are_refused_at_once(typed, text):
    Path("deep.yml").write_text(f"a: {text}\n")
    begun = time.process_time()
    code, _, err = typed("validate", "deep.yml")
    assert (code, "the values are nested too deeply" in err) == (2, True)
    assert time.process_time() - begun < 2.0  # some 0.05 s; it took 4 s and more
    Path("deep.yml").write_text(f"a: {'[1], ' * 20_000}\n".replace("a: ", "a: [", 1)[:-3] + "]\n")
    assert "nested" not in typed("validate", "deep.yml")[2]


def test_tables_fit_the_terminal(typed, monkeypatch):
    for columns, widest in (("80", 80), ("70", 70)):
        monkeypatch.setenv("COLUMNS", columns)
        _, out, _ = typed("evaluate", "random", *SHORT)
        table = out.splitlines()[1:]
        assert max(map(len, table)) <= widest
        assert "mean" in table[0]
    monkeypatch.delenv("COLUMNS")
    _, out, _ = typed("evaluate", "random", *SHORT)
    assert all(name in out.splitlines()[1] for name in ("mean", "std", "IQM", "min", "max"))


def test_a_table_has_no_negative_zero():
    from safe_inspect.evaluation.results.tables import number

    assert [number(value) for value in (-0.0, 0.0, -0.5)] == ["0.0000", "0.0000", "-0.5000"]


CODE = "import sys; from safe_inspect.cli.main import main; sys.exit(main(sys.argv[1:]))"


def shell(text, folder):
    return subprocess.run(
        ["bash", "-c", text, sys.executable, CODE], cwd=folder, capture_output=True, text=True, timeout=120, check=False
    )


def test_a_closed_output_loses_nothing(here):
    done = shell('"$0" -c "$1" schema agent --output a.json >&- 2>&-; "$0" -c "$1" list tasks >&-', here)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    assert (here / "a.json").read_text().startswith("{")


def test_a_removed_working_directory_is_one_line(here):
    for command in ('-P -c "$1" list tasks', "-m safe_inspect.train_rl --dry-run x.yml"):
        done = shell(f'mkdir gone; cd gone; rmdir ../gone; "$0" {command}', here)
        shown = "error: the working directory has been removed; change to an existing one\n"
        assert (done.returncode, done.stderr) == (2, shown)
