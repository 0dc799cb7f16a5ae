"""Who flies, from what a user writes on the command line."""

from __future__ import annotations

import shutil

import numpy as np
import pytest
from random_checkpoint import TEAM, discrete, experiment_of, make_module, save_run, single_run

from safe_inspect.errors import CheckpointError, SafeInspectError
from safe_inspect.experiments.modules.sources import Wanted, open_candidates, open_source
from safe_inspect.policies import NaturalMotionInspector


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("single") / "run"
    return folder, single_run(folder, experiment_of())


@pytest.fixture(scope="module")
def team_run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("team") / "run"
    experiment = experiment_of(path=TEAM)
    agents = experiment.spec.agents
    modules = {agent.policy: make_module(agent, seed) for seed, agent in enumerate(agents)}
    return folder, save_run(folder, experiment, modules), modules


def test_a_checkpoint_flies_in_the_task_of_its_run(run):
    folder, checkpoint = run
    for source in (folder, folder / "tune", checkpoint):
        spec, policies = open_source(source)
        assert [agent.name for agent in spec.agents] == list(policies)
        assert spec.agents[0].dones != ()
        assert policies["blue0_ctrl"](np.zeros((2, 11), dtype=np.float32)).shape == (2, 3)


def test_overrides_change_the_task_of_the_run(run):
    spec, _ = open_source(run[1], None, ["horizon=42"])
    assert 42 in [getattr(named.functor, "horizon", None) for named in spec.agents[0].dones]


def test_every_agent_gets_the_policy_of_its_name(team_run):
    _, checkpoint, modules = team_run
    spec, policies = open_source(checkpoint)
    observation = np.linspace(-1.0, 1.0, 11, dtype=np.float32)[None]
    actions = {agent.policy: policies[agent.name](observation) for agent in spec.agents}
    assert len(actions) == len(modules) == 3
    values = list(actions.values())
    assert not np.allclose(values[0], values[1])


def test_agents_that_share_a_policy_share_one_object(tmp_path):
    experiment = experiment_of(path=TEAM)
    checkpoint = save_run(tmp_path / "run", experiment, {"default_policy": make_module(experiment.spec.agents[0])})
    _, policies = open_source(checkpoint)
    assert len(policies) == 3
    assert len({id(policy) for policy in policies.values()}) == 1


def test_a_baseline_flies_in_the_shipped_task_by_default():
    spec, policy = open_source("inspector")
    assert isinstance(policy, NaturalMotionInspector)
    assert len(spec.agents) == 1
    spec, _ = open_source("inspector", TEAM)
    assert len(spec.agents) == 3


def test_a_checkpoint_of_another_task_is_refused(run, team_run, tmp_path):
    choosing = experiment_of(discrete)
    other = single_run(tmp_path / "run", choosing)
    (tmp_path / "run" / "experiment.resolved.yml").unlink()  # the checkpoint itself says what its policy sees and does
    with pytest.raises(CheckpointError, match=r"of another task .* X Thrust has the levels .* in training"):
        open_source(other, run[0] / "experiment.resolved.yml")
    less = experiment_of(lambda agent: agent["glues"].pop())
    small = single_run(tmp_path / "small", less)
    with pytest.raises(
        CheckpointError, match=r"of another task .* there are 10 elements in training and 11 in the task"
    ):
        open_source(small, run[0] / "experiment.resolved.yml")


def test_several_policies_without_the_agents_own_are_refused(team_run, tmp_path):
    _, _, modules = team_run
    renamed = {f"other{index}": module for index, module in enumerate(modules.values())}
    checkpoint = save_run(tmp_path / "run", experiment_of(path=TEAM), renamed)
    with pytest.raises(CheckpointError, match="has the policies other0, other1, other2, but none is 'blue0_ctrl'"):
        open_source(checkpoint)


def test_what_is_no_source_is_one_message(run, tmp_path, monkeypatch):
    folder, checkpoint = run
    alone = tmp_path / "checkpoint_000001"
    shutil.copytree(checkpoint, alone)
    with pytest.raises(CheckpointError, match="give the task with --cfg"):
        open_source(alone)
    spec, _ = open_source(alone, folder / "experiment.resolved.yml")
    assert len(spec.agents) == 1
    empty = tmp_path / "run"
    empty.mkdir()
    shutil.copy(folder / "experiment.resolved.yml", empty)
    with pytest.raises(CheckpointError, match="the run has no complete checkpoint"):
        open_source(empty)
    (tmp_path / "notes.txt").write_text("")
    with pytest.raises(SafeInspectError, match="this file is not a policy"):
        open_source(tmp_path / "notes.txt")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "random").mkdir()
    assert type(open_source("random")[1]).__name__ == "RandomThrust"  # a name comes before a folder
    with pytest.raises(CheckpointError, match="neither a checkpoint nor the folder"):
        open_source("./random")


@pytest.mark.parametrize(("sampled", "flag"), [(True, "--sampled"), (False, "--mode")])
def test_a_scripted_policy_has_no_distribution(sampled, flag):
    with pytest.raises(SafeInspectError) as caught:
        open_candidates(["random"], Wanted(sampled=sampled))
    assert str(caught.value) == f"random: {flag} is for trained policies; a scripted one has no distribution"
