"""The folder of a shipped policy: found by its name, whole in itself, and described by facts."""

from __future__ import annotations

import json
import runpy
import sys
from pathlib import Path

import numpy as np
import pytest
from model_cards import CardData, model_card
from random_checkpoint import TEAM, experiment_of, make_module, save_run, single_run

from safe_inspect.errors import CheckpointError, OutputError, SafeInspectError
from safe_inspect.evaluation import rollout
from safe_inspect.evaluation.shipped import shipped_policies, shipped_policy
from safe_inspect.outputs import MARKER

pytest.importorskip("onnx")


def named(name, **more):
    """Return what the user says on a model card."""
    return CardData(name, "Inspects every lit point.", "safe-inspect train --cfg x.yml", **more)


ESTIMATE = {"mean": 0.512, "standard_deviation": 0.0451, "iqm": 0.5, "iqm_interval": [0.49, None], "unit": "m/s"}
SUCCESS = {"rate": 0.995, "interval": [0.9885, 0.9978], "statuses": {"win": 995, "lose": 5}}
EVALUATION = {"episodes": 1000, "seed": 7, "success": SUCCESS, "figures": {"delta-v": ESTIMATE}}


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Return an experiment, and a checkpoint in the folder of its run."""
    experiment = experiment_of()
    return experiment, single_run(tmp_path_factory.mktemp("run"), experiment)


@pytest.fixture(scope="module")
def shelf(run, tmp_path_factory):
    """Return a folder with one shipped policy."""
    from model_cards import evaluation_content, ship

    root = tmp_path_factory.mktemp("trained")
    (root / "evaluation.json").write_text(json.dumps(EVALUATION))
    evaluations = {"The shipped task": root / "evaluation.json"}
    contents = {title: evaluation_content(path) for title, path in evaluations.items()}
    ship(run[1], root, named("one-deputy", evaluations=contents, machine="two cores", seeds=["seed 5: 99 %"]))
    return root


def test_it_is_found_by_its_name(shelf):
    assert shipped_policies(shelf) == ("one-deputy",)
    found = shipped_policy("one-deputy", shelf)
    assert found.onnx == {"blue0_ctrl": shelf / "one-deputy" / "policy.onnx"}
    with pytest.raises(SafeInspectError, match="no shipped policy 'one_deputy'; did you mean `one-deputy`"):
        shipped_policy("one_deputy", shelf)
    with pytest.raises(SafeInspectError, match="no shipped policy 'x'; there is none"):
        shipped_policy("x", shelf / "one-deputy")


def test_its_file_and_its_checkpoint_fly_alike(run, shelf):
    from safe_inspect.experiments.modules.policy import trained_policy

    found = shipped_policy("one-deputy", shelf)
    flying = found.load()
    task = flying["blue0_ctrl"].task()
    ours = rollout(flying["blue0_ctrl"].prepare(task), flying, 4, seed=1)
    theirs = rollout(task, trained_policy(found.checkpoint), 4, seed=1)
    np.testing.assert_array_equal(ours.length, theirs.length)
    np.testing.assert_allclose(ours.delta_v, theirs.delta_v, rtol=1e-4)


def test_its_checkpoint_can_be_exported_again(shelf, tmp_path):
    from safe_inspect.experiments.export import export_policy

    found = shipped_policy("one-deputy", shelf)
    again = export_policy(found.checkpoint, tmp_path / "again.onnx")
    assert again.info.training["steps"] == 28_000
    readings = np.random.default_rng(0).normal(size=(50, 11)).astype(np.float32)
    for one, other in zip(found.load()["blue0_ctrl"].outputs(readings), _outputs(again.path, readings), strict=True):
        np.testing.assert_array_equal(one, other)


def _outputs(path, readings):
    from safe_inspect.evaluation.onnx_policy import load_onnx

    return load_onnx(path).outputs(readings)


def test_it_holds_weights_alone_and_nothing_of_the_machine(run, shelf):
    folder = shelf / "one-deputy"
    top = {path.name for path in folder.iterdir()}
    assert top == {MARKER, "policy.onnx", "policy.json", "card.md", "experiment.resolved.yml", "checkpoint"}
    assert {path.name for path in (folder / "checkpoint").iterdir()} == {"learner_group", "safe_inspect.json"}
    assert not (folder / "checkpoint" / "learner_group" / "learner" / "state.pkl").exists()
    for path in folder.rglob("*"):
        content = path.read_bytes() if path.is_file() else b""
        assert str(run[1].parents[3]).encode() not in content
        assert b"somewhere" not in content
    assert "# From here" not in (folder / "experiment.resolved.yml").read_text()


def test_the_card_states_the_facts(shelf):
    card = shipped_policy("one-deputy", shelf).card.read_text(encoding="utf-8")
    for text in (
        "# one-deputy\n\nInspects every lit point.",
        "safe-inspect train --cfg x.yml",
        "| seed | 4 |",
        "| environment steps | 28,000 |",
        "| wall time | 0.2 min |",
        "| machine | two cores |",
        "commit abc, with uncommitted changes",
        "- seed 5: 99 %",
        "### The shipped task\n\n1,000 episodes, seed 7.",
        "Success 99.5 % (95 % interval 98.85 to 99.78 %; win 995, lose 5).",
        "| delta-v | 0.512 | 0.0451 | 0.5 | 0.49 to - | m/s |",
        "| policy.onnx | blue0_ctrl | mean |",
        "`Sensor_Position.x [m]`",
        "## Limits of use",
    ):
        assert text in card


def test_a_card_of_a_team_has_a_table_for_each_agent():
    content = {
        **EVALUATION,
        "agents": {"blue0": {"success": SUCCESS, "figures": {"return": {**ESTIMATE, "unit": "-"}}}},
    }
    card = model_card(CardData("team", "t", "c", "m", {"Three": content}), {}, [])
    assert "blue0: success 99.5 %" in card
    assert "| return | 0.512 |" in card
    assert "| seed | unknown |" in card


def test_a_team_has_a_file_for_each_policy(tmp_path):
    from model_cards import ship

    experiment = experiment_of(path=TEAM, overrides=("horizon=20",))
    agents = experiment.spec.agents
    modules = {agent.policy: make_module(agent, seed=index) for index, agent in enumerate(agents)}
    save_run(tmp_path / "run", experiment, modules)
    found = ship(tmp_path / "run", tmp_path / "trained", named("team"))
    assert {agent: path.name for agent, path in found.onnx.items()} == {
        agent.name: f"{agent.policy}.onnx" for agent in agents
    }
    assert len(set(found.load().values())) == 3


def test_mistakes(run, shelf, tmp_path):
    from model_cards import evaluation_content, ship

    before = sorted(shelf.rglob("*"))
    with pytest.raises(OutputError, match="one-deputy: the folder exists already"):
        ship(run[1], shelf, named("one-deputy"))
    with pytest.raises(OutputError, match="is not a name for a policy"):
        ship(run[1], shelf, named("../one"))
    (tmp_path / "file").write_text("{}")
    with pytest.raises(CheckpointError, match="this is not an evaluation"):
        evaluation_content(tmp_path / "file")
    with pytest.raises(OutputError, match="cannot be written"):
        ship(run[1], tmp_path / "file", named("two"))
    with pytest.raises(CheckpointError, match="there is no such checkpoint"):
        ship(tmp_path / "nowhere", shelf, named("two"))
    assert sorted(shelf.rglob("*")) == before
    (tmp_path / "bad").mkdir()
    (tmp_path / "bad" / "policy.json").write_text("{")
    with pytest.raises(CheckpointError, match="the record of the policy is damaged"):
        shipped_policy("bad", tmp_path)


def test_the_script_says_what_it_made(run, tmp_path, monkeypatch, capsys):
    script = runpy.run_path(str(Path(__file__).parents[2] / "scripts" / "ship_policy.py"))
    words = [str(run[1]), "one", "--root", str(tmp_path), "--title", "t", "--command", "c"]
    monkeypatch.setattr(sys, "argv", ["ship_policy.py", *words])
    assert script["main"]() == 0
    assert capsys.readouterr().out.startswith(f"{tmp_path / 'one'}: ")
    assert script["main"]() == 2
    assert capsys.readouterr().err.startswith("error: ")
    monkeypatch.setattr(sys, "argv", ["ship_policy.py", *words, "--force", "--evaluation", "no file"])
    with pytest.raises(SystemExit):
        script["main"]()
    assert "TITLE=FILE" in capsys.readouterr().err


def test_every_policy_of_the_package_is_whole():
    for name in shipped_policies():
        found = shipped_policy(name)
        assert found.card.is_file()
        for agent, policy in found.load().items():
            policy.prepare(policy.task(), [agent])
