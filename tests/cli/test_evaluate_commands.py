"""`safe-inspect evaluate` and `compare` as a user types them, with baselines and with checkpoints of random weights."""

from __future__ import annotations

import importlib
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from safe_inspect.cli.main import main
from safe_inspect.config.data import configs_root
from safe_inspect.environments import load_spec
from safe_inspect.evaluation import baseline, rollout
from safe_inspect.evaluation.results.files import read_evaluation, read_trajectories
from safe_inspect.metrics.statistics import interquartile_mean
from safe_inspect.outputs import MARKER
from safe_inspect.version import __version__

EXPERIMENTS = Path(__file__).parents[1] / "experiments"
if str(EXPERIMENTS) not in sys.path:
    sys.path.insert(0, str(EXPERIMENTS))

SHORT = ("--episodes", "6", "--num-envs", "4", "horizon=25")
SEE_OTHERS = "multiagent-translational-inspection/experiment-see-others.yml"
TEAM = "safe_inspect/MultiagentTranslationalInspectionSeed-v0"
METRICS = '''
from typing import ClassVar
import numpy as np
from safe_inspect.metrics import Metric, TeamMetric


class MeanRange(Metric):
    """Mean distance from the chief; shape (R,)."""

    unit: ClassVar[str] = "m"
    reduce: ClassVar[str] = "mean"

    def __call__(self, step):
        """Return the distance [m], shape (R,)."""
        return np.sqrt((step.after.position**2).sum(axis=-1))


class Return(Metric):
    """Takes a name that every table has."""

    reduce: ClassVar[str] = "sum"

    def __call__(self, step):
        """Return nothing, shape (R,)."""
        return np.zeros(step.after.num_rows)
'''


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    return tmp_path


@pytest.fixture
def typed(capsys):
    """Return a function that runs a command: exit code, standard output, standard error."""

    def run(*words):
        try:
            code = main([str(word) for word in words])
        except SystemExit as stop:
            code = stop.code
        captured = capsys.readouterr()
        assert "Traceback" not in captured.err
        return code, captured.out, captured.err

    return run


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Return the folder of training runs with checkpoints of random weights: of the task, and with other scales."""
    from random_checkpoint import discrete, experiment_of, single_run

    folder = tmp_path_factory.mktemp("runs")
    single_run(folder / "plain", experiment_of())
    single_run(folder / "discrete", experiment_of(discrete))
    return folder


@pytest.fixture(scope="module")
def evaluations(tmp_path_factory):
    """Return a folder with evaluations of two baselines on the same seeds."""
    folder = tmp_path_factory.mktemp("evaluations")
    for name in ("random", "zero-thrust"):
        assert main(["evaluate", name, *SHORT, "--record", "2", "--output", str(folder / name)]) == 0
    return folder


def row(out, name):
    (line,) = [line for line in out.splitlines() if line.startswith(f"  {name}  ")]
    return line.removeprefix(f"  {name}").split()


def test_a_baselines_table_holds_the_figures_of_its_rollout(typed):
    code, out, err = typed("evaluate", "random", *SHORT, "--seed", "3")
    assert (code, err) == (0, "")
    flown = rollout(load_spec("safe_inspect/TranslationalInspection-v1", ["horizon=25"]), baseline("random"), 6, 3)
    for name, values in (
        ("return", flown.returns), ("delta-v", flown.delta_v), ("length", flown.length),
        ("inspected points", 100 * flown.inspected_fraction), *((f"reward/{n}", v) for n, v in flown.terms.items()),
    ):  # fmt: skip
        cells = row(out, name)
        assert float(cells[0]) == pytest.approx(values.mean(), rel=2e-2, abs=1e-4)
        assert float(cells[2]) == pytest.approx(interquartile_mean(values), rel=2e-2, abs=1e-4)
    assert out.startswith("random: 6 episodes, success 0.0 % (95 % interval 0.0 to 39.0 %; ")
    for name in ("interventions", "phi chief_collision", "phi z_vel", "smallest range", "time to 90 %"):
        row(out, name)


def test_the_folder_holds_every_episode_and_where_it_comes_from(typed, evaluations):
    record = json.loads((evaluations / "random" / "evaluation.json").read_text())
    assert (record["safe_inspect"], record["seed"], record["episodes"]) == (__version__, 0, 6)
    assert record["source"]["kind"] == "scripted"
    assert len(record["source"]["sha256"]) == 64
    assert record["overrides"] == ["horizon=25"]
    assert record["configuration"]["config"]["config"]["env_config"]["horizon"] == 25
    assert record["figures"]["delta-v"]["count"] == 6
    flown = rollout(
        load_spec("safe_inspect/TranslationalInspection-v1", ["horizon=25"]), baseline("random"), 6, record=2
    )
    found = read_evaluation(evaluations / "random")
    np.testing.assert_array_equal(found.team.figures["delta-v"], flown.delta_v)
    np.testing.assert_array_equal(found.agents["blue0_ctrl"].figures["return"], flown.returns)
    assert found.team.statuses == {"draw": 6} or set(found.team.statuses) <= {"draw", "lose", "win"}
    for ours, theirs in zip(read_trajectories(evaluations / "random"), flown.trajectories, strict=True):
        for name in ("slot", "status", "deputies", "mean_motion"):
            assert getattr(ours, name) == getattr(theirs, name)
        for name in (
            "time", "position", "velocity", "control", "delta_v", "sun_angle", "points", "inspected_at", "inspector",
        ):  # fmt: skip
            np.testing.assert_array_equal(getattr(ours, name), getattr(theirs, name))


def test_several_deputies_have_a_block_each(typed):
    code, out, _ = typed("evaluate", "zero-thrust", "--cfg", TEAM, *SHORT, "--output", "team", "--record", "1")
    assert code == 0
    blocks = [line.partition(":")[0] for line in out.splitlines() if ": success " in line or " episodes, " in line]
    assert blocks == ["zero-thrust", "blue0_ctrl", "blue1_ctrl", "blue2_ctrl"]
    found = read_evaluation("team")
    assert "closest deputies" in found.team.figures
    spent = [agent.figures["smallest range"] for agent in found.agents.values()]
    np.testing.assert_array_equal(found.team.figures["smallest range"], np.min(spent, axis=0))
    assert read_trajectories("team")[0].position.shape[1:] == (3, 3)


def test_a_users_metric_by_its_dotted_and_by_its_registered_name(typed, here):
    (here / "my_metrics.py").write_text(METRICS)
    code, out, _ = typed(
        "evaluate", "zero-thrust", *SHORT, "--metric", "my_metrics.MeanRange", "--metric", "ThrustingSteps"
    )
    assert code == 0
    assert 40.0 < float(row(out, "mean range")[0]) < 120.0
    code, again, _ = typed("evaluate", "zero-thrust", *SHORT, "--metric", "MeanRange")
    assert code == 0
    assert row(again, "mean range") == row(out, "mean range")
    assert "MeanRange  Mean distance from the chief" in typed("list", "metric")[1]
    code, _, err = typed("evaluate", "zero-thrust", *SHORT, "--metric", "my_metrics.Return")
    assert code == 2
    assert "the label 'return' is that of a standard figure; choose another label" in err


def test_the_figures_as_json(typed):
    code, _, _ = typed("evaluate", "zero-thrust", *SHORT, "--json", "one.json")
    assert code == 0
    one = json.loads(Path("one.json").read_text())
    assert one["figures"]["delta-v"]["mean"] == 0.0
    assert one["figures"]["time to 90 %"]["mean"] is None
    assert typed("evaluate", "zero-thrust", "random", *SHORT, "--json", "two.json")[0] == 0
    two = json.loads(Path("two.json").read_text())
    assert [item["label"] for item in two] == ["zero-thrust", "random"]
    assert two[0]["figures"] == one["figures"]


def test_the_gap_to_a_reference(typed):
    Path("ref.json").write_text(json.dumps({"seed": 2, "delta_v": [0.1, None, 0.3, 0.4, 0.5, 0.6, 9.9]}))
    words = ("evaluate", "zero-thrust", *SHORT, "--reference", "ref.json")
    code, out, _ = typed(*words, "--seed", "2")
    assert code == 0
    gap = row(out, "gap to the open-loop optimum")
    assert float(gap[0]) == pytest.approx(-(0.1 + 0.3 + 0.4 + 0.5 + 0.6) / 5, abs=1e-4)
    assert gap[-3:] == ["(5", "of", "6)"]
    for more, shown in (
        ((), "the reference has seed 2, not 0; give --seed 2"),
        (("--seed", "2", "--episodes", "8"), "has 7 episodes, fewer than 8; give --episodes 7"),
    ):
        code, out, err = typed(*words, *more)
        assert (code, out) == (2, "")
        assert shown in err
    Path("ref.json").write_text(json.dumps({"seed": 2, "delta_v": [0.1] * 6, "task": {"step_size": 1.0}}))
    assert "the reference is of another task" in typed(*words, "--seed", "2")[2]
    Path("ref.json").write_text("[1]")
    assert "ref.json: the reference is damaged" in typed(*words)[2]
    assert "cannot be read" in typed("evaluate", "random", *SHORT, "--reference", "none.json")[2]


def test_nothing_is_overwritten_unless_asked(typed, here):
    words = ("evaluate", "zero-thrust", *SHORT, "--output", "out")
    assert typed(*words)[0] == 0
    before = (here / "out" / "evaluation.json").read_bytes()
    code, out, err = typed(*words)
    assert (code, out) == (2, "")
    assert "out: the folder exists already; give another folder, or replace what this command wrote: --force" in err
    assert (here / "out" / "evaluation.json").read_bytes() == before
    assert typed(*words, "--force", "--seed", "5")[0] == 0
    assert read_evaluation("out").record["seed"] == 5
    assert typed("evaluate", "zero-thrust", "random", *SHORT, "--output", "out", "--force")[0] == 0
    assert sorted(path.name for path in (here / "out").iterdir()) == [MARKER, "random", "zero-thrust"]
    (here / "out" / "precious.txt").write_text("mine")
    code, _, err = typed(*words, "--force")
    assert code == 2
    assert "out: it contains 'precious.txt' of another origin, so it is not replaced" in err
    assert (here / "out" / "precious.txt").read_text() == "mine"
    assert sorted(path.name for path in here.iterdir()) == ["out"]  # nothing half-written is left


def test_an_evaluation_that_fails_leaves_nothing(typed, here, monkeypatch):
    def fail(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("safe_inspect.experiments.modules.sources.rollout", fail)
    code, out, err = typed("evaluate", "zero-thrust", *SHORT, "--output", "out")
    shown = "nothing is kept, as the first batch of 4 episodes was not complete"
    assert (code, out, err) == (130, "", f"interrupted; {shown}\n")
    assert list(here.iterdir()) == []


def test_a_scripted_policy_of_another_task_is_noted(typed):
    note = "note: DockingAutopilot in safe_inspect/TranslationalInspection-v1; give another task with --cfg\n"
    assert typed("evaluate", "DockingAutopilot", *SHORT)[2] == note
    assert typed("evaluate", "DockingAutopilot", *SHORT, "--cfg", "safe_inspect/Docking-v0")[2] == ""


def test_a_run_that_is_missing_is_answered_by_the_newest(typed, here):
    for when, name in enumerate(("old", "new", "no run")):
        (here / "output" / name).mkdir(parents=True)
        if name != "no run":
            (here / "output" / name / "run.json").touch()
        os.utime(here / "output" / name, (when, when))
    code, _, err = typed("evaluate", "output/RUN")
    assert code == 2
    assert err.rstrip().endswith("the newest run there is output/new")
    assert typed("evaluate", "output/ol")[2].rstrip().endswith("did you mean output/old?")


@pytest.mark.parametrize(
    ("words", "shown"),
    [
        ((), "nothing to evaluate: give a checkpoint's folder"),
        (("inspectr",), "did you mean `inspector`?"),
        (("random", "--episodes", "0"), "--episodes: expected a whole number of at least 1, not '0'"),
        (("random", "--num-envs", "none"), "--num-envs: expected a whole number of at least 1"),
        (("random", "--seed", "-4"), "--seed: expected a whole number from 0"),
        (("random", "--record", "0"), "--record: expected a whole number of at least 1"),
        (("random", "--record", "2"), "give it with --output"),
        (("random", "--sampled"), "a scripted one has no distribution"),
        (("random", "horizn=3"), "did you mean `horizon`?"),
        (("random", "--cfg", "none.yml"), "none.yml"),
        (("--cfg", "none.yml"), "no file 'none.yml'"),
        (("random", "--metric", "ThrustingStep"), "did you mean `ThrustingSteps`?"),
        (
            ("random", "--metric", "{functor: SmallestRange, config: {entity_name: sol}}"),
            "no entity is named 'sol'",
        ),
        (("random", "--output", "file.txt"), "file.txt: this is a file or a symbolic link"),
        (("random", "--output", "file.txt/out"), "the folder cannot be written"),
        (("random", "--json", "file.txt/figures.json"), "file.txt/figures.json: the file cannot be written"),
        (("random", "--json", "folder"), "folder: the file cannot be written (it is a folder)"),
        (
            ("./checkpoint_000001",),
            "./checkpoint_000001: there is no such checkpoint or ONNX file; give the run folder",
        ),
        (("folder",), "neither a checkpoint nor the folder of a training run"),
        (("file.txt",), "this file is not a policy"),
        (("none.onnx",), "none.onnx"),
        (("--policy", "no-such-policy"), "no shipped policy 'no-such-policy'"),
        (("--policy", "zero-thrust"), "it is a scripted policy: give it as a separate argument, without `--policy`"),
    ],
)
def test_mistakes_are_reported_before_an_episode_is_flown(typed, here, monkeypatch, words, shown):
    module = importlib.import_module("safe_inspect.experiments.modules.sources")
    monkeypatch.setattr(module, "rollout", lambda *_, **__: pytest.fail("an episode was flown"))
    (here / "file.txt").write_text("text")
    (here / "folder").mkdir()
    code, out, err = typed("evaluate", *words)
    assert (code, out) == (2, "")
    assert shown in err
    assert err.count("error") == 1
    assert sorted(path.name for path in here.iterdir()) == ["file.txt", "folder"]


def test_a_checkpoint_flies_in_the_task_of_its_run(typed, runs):
    checkpoint = runs / "plain" / "tune" / "000" / "trial_00000" / "checkpoint_000003"
    code, out, _ = typed("evaluate", checkpoint, "--episodes", "3", "--output", "a")
    assert code == 0
    assert out.startswith("plain/checkpoint_000003: 3 episodes")
    record = read_evaluation("a").record
    assert record["configuration_file"].endswith("plain/experiment.resolved.yml")
    assert record["configuration"]["config"]["config"]["env_config"]["horizon"] == 60
    assert typed("evaluate", runs / "plain", "--episodes", "3", "--output", "b")[0] == 0
    assert read_evaluation("b").record["source"]["sha256"] == record["source"]["sha256"]
    np.testing.assert_array_equal(
        read_evaluation("a").team.figures["delta-v"], read_evaluation("b").team.figures["delta-v"]
    )
    assert typed("evaluate", runs / "plain", "--episodes", "3", "--sampled", "--output", "c")[0] == 0
    assert (read_evaluation("c").team.figures["delta-v"] != read_evaluation("a").team.figures["delta-v"]).all()


def test_several_checkpoints_are_taken_together(typed, runs):
    code, out, _ = typed("evaluate", runs / "plain", runs / "discrete", "--episodes", "3", "--output", "out")
    assert code == 0
    assert "\n2 sources together: 6 episodes, success 0.0 %" in out
    labels = ["plain/checkpoint_000003", "discrete/checkpoint_000003"]
    values = np.concatenate(
        [read_evaluation(Path("out") / label.replace("/", "-")).team.figures["delta-v"] for label in labels]
    )
    pooled = out.partition("together")[2]
    assert float(row(pooled, "delta-v")[0]) == pytest.approx(values.mean(), rel=1e-3)


def test_an_onnx_file_and_a_shipped_policy_fly_as_their_checkpoint(typed, runs, here, monkeypatch):
    pytest.importorskip("onnx")
    assert typed("export", runs / "plain", "--output", "policy.onnx")[0] == 0
    shipped = here / "trained" / "flier"
    shipped.mkdir(parents=True)
    shutil.copy("policy.onnx", shipped)
    shutil.copy(runs / "plain" / "experiment.resolved.yml", shipped)
    (shipped / "policy.json").write_text(json.dumps({"agents": {"blue0_ctrl": "policy.onnx"}}))
    monkeypatch.setattr("safe_inspect.evaluation.shipped._ROOT", here / "trained")
    written = (runs / "plain",), ("policy.onnx",), ("--policy", "flier"), ("flier",)
    for name, words in zip("abcd", written, strict=True):
        assert typed("evaluate", *words, "--episodes", "3", "--output", name)[0] == 0
    first, *others = (read_evaluation(name) for name in "abcd")
    kinds = [item.record["source"]["kind"] for item in (first, *others)]
    assert kinds == ["checkpoint", "onnx", "shipped", "shipped"]
    assert [item.label for item in others] == ["policy", "flier", "flier"]
    for other in others:
        for figure in ("delta-v", "smallest range", "inspected fraction"):
            np.testing.assert_allclose(other.team.figures[figure], first.team.figures[figure], rtol=1e-3)
    assert typed("compare", "a", "b", "c")[0] == 0
    code, out, err = typed("evaluate", "policy.onnx", "--cfg", configs_root() / SEE_OTHERS, "--episodes", "2")
    assert (code, out) == (2, "")
    assert "of another task" in err


def loaded_by(*words):
    """Return the exit code of a command in a separate process, and whether it loaded Ray or Torch."""
    code = (
        "import sys; from safe_inspect.cli.main import main; code = main(sys.argv[1:])\n"
        "print(code, bool({'ray', 'torch'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code, *words], capture_output=True, text=True, check=True, timeout=120)
    number, loaded = done.stdout.split()
    return int(number), loaded == "True"


@pytest.mark.parametrize("source", ["policy.onnx", "inspector", "out", "docking"])
def test_what_cannot_be_exported_is_refused_before_ray_is_loaded(here, source):
    (here / "policy.onnx").write_bytes(b"x")
    (here / "out").mkdir()
    (here / "out" / "evaluation.json").write_text("{}")
    assert loaded_by("export", source) == (2, False)


def test_a_checkpoint_of_another_task_or_damaged_is_refused(typed, runs, here):
    scale = "agent_config.0.config.config.glues.1.config.normalization.config.sigma=[7, 7, 7]"
    code, out, err = typed("evaluate", runs / "plain", "--episodes", "2", scale)
    assert (code, out) == (2, "")
    assert (
        "Sensor_Position.x is seen as (value - 0) / 100 in training and is seen as (value - 0) / 7 in the task" in err
    )
    code, out, err = typed(
        "evaluate", runs / "discrete", "--episodes", "2", "--cfg", runs / "plain" / "experiment.resolved.yml"
    )
    assert (code, out) == (2, "")
    assert "of another task" in err
    words = ("evaluate", str(runs / "discrete"), "--cfg", str(runs / "plain" / "experiment.resolved.yml"))
    assert loaded_by(*words) == (2, False)
    shutil.copytree(runs / "plain", here / "copy")
    (weights,) = (here / "copy").rglob("policy.safetensors")
    weights.write_bytes(weights.read_bytes()[:-8])
    checkpoint = weights.parents[4]
    assert checkpoint.name.startswith("checkpoint_"), checkpoint
    code, out, err = typed("evaluate", checkpoint, "--episodes", "2")
    assert (code, out) == (2, "")
    assert "the checkpoint is damaged" in err


def test_evaluations_side_by_side(typed, evaluations):
    code, out, err = typed("compare", evaluations / "zero-thrust", evaluations / "random", "--json", "c.json")
    assert (code, err) == (0, "")
    shown = json.loads(Path("c.json").read_text())
    one, other = (read_evaluation(evaluations / name).team.figures["delta-v"] for name in ("zero-thrust", "random"))
    assert shown["differences"]["delta-v"]["random"]["mean"] == pytest.approx((other - one).mean())
    assert "random less zero-thrust, episode by episode:" in out
    (line,) = [line for line in out.partition("less")[2].splitlines() if line.startswith("  delta-v  ")]
    assert " * " in line
    assert line.endswith("m/s")
    assert "100 %" in line


def test_a_source_is_flown_in_the_episodes_of_the_first_evaluation(typed, evaluations):
    code, out, _ = typed("compare", evaluations / "random", "zero-thrust", "RandomThrust")
    assert code == 0
    assert out.startswith("6 episodes of seed 0, the same for all")
    same = out.partition("RandomThrust less random, episode by episode:")[2]
    (line,) = [line for line in same.splitlines() if line.startswith("  delta-v  ")]
    assert line.split()[1] == "0.0000"


def test_what_cannot_be_compared_is_refused(typed, evaluations, here):
    first = evaluations / "random"
    for name, words in (
        ("seed", ("--seed", "1", "--episodes", "6", "horizon=25")),
        ("count", ("--episodes", "5", "horizon=25")),
        ("horizon", ("--episodes", "6", "horizon=24")),
        (
            "begin",
            (*SHORT, "config.config.env_config.simulator_reset_parameters.init_state.wrapped.radius.config.low=51"),
        ),
    ):
        assert typed("evaluate", "random", "--output", name, *words)[0] == 0
    for name, shown in (
        ("seed", "the seed is 0 in one and 1 in the other"),
        ("count", "the number of episodes is 6 in one and 5 in the other"),
        ("horizon", "their tasks differ in agents[0].dones["),
        ("begin", "6 of their 6 episodes have different initial states"),
    ):
        code, out, err = typed("compare", first, name)
        assert (code, out) == (2, "")
        assert shown in err
        remedy = "in one task with --cfg" if name == "horizon" else "with the same --seed, --episodes and --cfg"
        assert f"evaluate both {remedy}" in err
    assert "`compare` needs two or more sources" in typed("compare", first)[2]
    both = (evaluations / "random", evaluations / "zero-thrust")
    assert "has --seed 0 and is not evaluated again" in typed("compare", *both, "--seed", "77")[2]
    assert "has --episodes 6 and is not evaluated again" in typed("compare", *both, "--episodes", "77")[2]
    for option, words in (("--metric", ("--metric", "ThrustingSteps")), ("KEY=VALUE", ("horizon=3",))):
        assert f"{option} has no effect, as all sources are evaluations already" in typed("compare", *both, *words)[2]
    assert "no policy 'nobody'" in typed("compare", first, "nobody")[2]


def test_returns_of_other_rewards_are_not_compared(typed, evaluations):
    scale = "agent_config.0.config.config.rewards.0.config.scale=0.02"
    assert typed("evaluate", "random", *SHORT, scale, "--output", "paid")[0] == 0
    code, out, _ = typed("compare", evaluations / "random", "paid")
    assert code == 0
    assert "note: the rewards differ, so returns and reward terms are left out" in out
    assert "reward/" not in out
    assert "  delta-v " in out


@pytest.mark.parametrize(
    ("file", "content", "shown"),
    [
        ("episodes.npz", b"PK", "episodes.npz: the file was damaged"),
        ("episodes.npz", None, "episodes.npz: the file cannot be read"),
        ("evaluation.json", b"{", "the record of the evaluation is damaged"),
        ("evaluation.json", b"{}", "the record of the evaluation is damaged"),
        ("evaluation.json", b'{"format": 99}', "the file was written by another version of safe_inspect"),
    ],
)
def test_damaged_evaluations_are_reported(typed, evaluations, here, file, content, shown):
    shutil.copytree(evaluations / "random", here / "bad")
    (here / "bad" / file).unlink()
    if content is not None:
        (here / "bad" / file).write_bytes(content)
    code, out, err = typed("compare", evaluations / "random", "bad")
    assert (code, out) == (2, "")
    assert shown in err


def test_damaged_trajectories_are_reported(evaluations, here):
    from safe_inspect.evaluation.results.results import EvaluationError

    shutil.copytree(evaluations / "random", here / "bad")
    with pytest.raises(EvaluationError, match="there are no recorded episodes; evaluate with --record"):
        read_trajectories(here)
    (here / "bad" / "trajectories.npz").write_bytes(b"PK")
    with pytest.raises(EvaluationError, match="the file was damaged"):
        read_trajectories(here / "bad")


def test_the_bar_on_a_terminal(capsys, monkeypatch):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    assert main(["evaluate", "zero-thrust", *SHORT]) == 0
    shown = capsys.readouterr().err
    assert f"zero-thrust  [{'#' * 40}] 100 %" in shown
    assert shown.endswith("\r\x1b[K")


def test_a_missing_run_is_answered_with_the_newest_run(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for age, name in enumerate(("fourth", "third", "second", "first")):
        Path("output", name).mkdir(parents=True)
        Path("output", name, "run.json").write_text("{}")
        os.utime(Path("output", name), (age, age))
    assert main(["evaluate", "output/RUN"]) == 2
    assert "the newest run there is output/first\n" in capsys.readouterr().err
