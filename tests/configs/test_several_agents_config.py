"""Several agents in a configuration: templates, policies, shared dones, and every mistake that only they can hold."""

from __future__ import annotations

import shutil

import numpy as np
import pytest

from safe_inspect.config.data import configs_root
from safe_inspect.config.experiment import build_experiment, load_experiment
from safe_inspect.dones.shared import CollisionDoneFunction
from safe_inspect.environments import TeamEnvironment
from safe_inspect.errors import ConfigError

TASK = configs_root() / "multiagent-translational-inspection" / "experiment-seed.yml"
AGENT = "blue#_ctrl"


@pytest.fixture
def team(tmp_path, monkeypatch, long_form):
    """Return a copy of the written-out folder of several agents, next to that of one."""
    for name in ("translational-inspection", "multiagent-translational-inspection"):
        shutil.copytree(long_form / name, tmp_path / "configs" / name)
    monkeypatch.chdir(tmp_path)
    return tmp_path / "configs" / "multiagent-translational-inspection"


def test_the_shipped_task_has_three_equal_deputies_with_a_policy_each():
    experiment = load_experiment(TASK)
    agents = experiment.spec.agents
    assert [agent.name for agent in agents] == ["blue0_ctrl", "blue1_ctrl", "blue2_ctrl"]
    assert [agent.platform for agent in agents] == list(experiment.spec.platforms) == ["blue0", "blue1", "blue2"]
    assert all(agent.same_terms(agents[0]) for agent in agents)
    assert {name: policy.agents for name, policy in experiment.policies.items()} == {
        name: (name,) for name in ("blue0_ctrl", "blue1_ctrl", "blue2_ctrl")
    }
    assert all(policy.trains and not policy.config for policy in experiment.policies.values())
    assert experiment.rllib["minibatch_size"] == 500
    assert [named.name for named in experiment.spec.shared_dones] == [
        "CollisionDoneFunction",
        "MultiagentSuccessDoneFunction",
    ]
    assert experiment.spec.shared_dones[0].functor == CollisionDoneFunction(safety_constraint=10.0)
    assert experiment.spec.reset.separation == 10.0


@pytest.mark.parametrize("count", [1, 3, 5, 10])
def test_one_override_gives_another_number_of_deputies(count):
    experiment = load_experiment(TASK, [f"{AGENT}.count={count}"])
    assert len(experiment.spec.agents) == len(experiment.spec.platforms) == len(experiment.policies) == count


def test_one_override_shares_a_policy():
    experiment = load_experiment(TASK, [f"{AGENT}.policy_name=team"])
    assert {name: policy.agents for name, policy in experiment.policies.items()} == {
        "team": ("blue0_ctrl", "blue1_ctrl", "blue2_ctrl")
    }


def test_a_resolved_experiment_of_several_agents_builds_the_same():
    experiment = load_experiment(TASK, [f"{AGENT}.count=4"])
    again = build_experiment(experiment.resolved)
    assert again.spec == experiment.spec
    assert (again.rllib, again.policies) == (experiment.rllib, experiment.policies)


def write(team, agents: str, platforms: str = '  - {name: "blue#", config: !include ./platform.yml}') -> str:
    """Write an experiment and return its path."""
    shutil.copy(team.parent / "translational-inspection" / "platform.yml", team / "platform.yml")
    text = f"config: !include ./task.yml\nplatform_config:\n{platforms}\nagent_config:\n{agents}\n"
    (team / "written.yml").write_text(text)
    return str(team / "written.yml")


LEARNS = "policy: {algorithm: PPO}"
ENTRY = '  - {{name: {name}, platforms: ["{platform}"], config: !include ./agent.yml, {policy}}}'


def entry(name: str, platform: str, policy: str = LEARNS) -> str:
    return ENTRY.format(name=name, platform=platform, policy=policy)


def platforms(*names: str) -> str:
    return "\n".join(f"  - {{name: {name}, config: !include ./platform.yml}}" for name in names)


def test_policies_keep_what_differs_and_share_what_does_not(team):
    first = entry("a", "x", "policy: {algorithm: PPO, config: {lr: 1.0e-4, gamma: 0.9}}")
    second = entry("b", "y", "policy: {algorithm: PPO, config: {lr: 2.0e-4, gamma: 0.9}}")
    experiment = load_experiment(write(team, f"{first}\n{second}", platforms("x", "y")))
    assert experiment.rllib["gamma"] == 0.9
    assert "lr" not in experiment.rllib
    assert [policy.config for policy in experiment.policies.values()] == [{"lr": 1.0e-4}, {"lr": 2.0e-4}]


def test_scripted_agents_and_checkpoints_fly_with_one_that_learns(team):
    agents = "\n".join(
        (
            entry("learner", "x"),
            entry("drifter", "y", "policy: {functor: ZeroThrust}"),
            entry("old", "z", "policy: {checkpoint: somewhere, policy: blue0_ctrl}"),
        )
    )
    experiment = load_experiment(write(team, agents, platforms("x", "y", "z")))
    learner, drifter, old = experiment.spec.agents
    assert (learner.scripted_policy, old.scripted_policy) == (None, None)
    assert drifter.scripted_policy.registered_name == "ZeroThrust"
    assert list(experiment.policies) == ["learner", "old"]
    frozen = experiment.policies["old"]
    assert (frozen.trains, frozen.checkpoint, frozen.source_policy) == (False, "somewhere", "blue0_ctrl")


MISTAKES = {
    "two agents of one name": (
        f"{entry('a', 'x')}\n{entry('a', 'y')}", platforms("x", "y"), "agent_config[1]", "two agents are named",
    ),
    "a platform that does not exist": (
        f"{entry('a', 'x')}\n{entry('b', 'yy')}", platforms("x", "y"), "agent_config[1].platforms[0]",
        "there is no platform 'yy'",
    ),
    "a platform that two agents control": (
        f"{entry('a', 'x')}\n{entry('b', 'x')}", platforms("x"), "agent_config[1].platforms[0]", "a and b both control",
    ),
    "an agent without a policy": (
        f"{entry('a', 'x')}\n  - {{name: b, platforms: [y], config: !include ./agent.yml}}", platforms("x", "y"),
        "agent_config[1]", "'b' has no policy",
    ),
    "nobody learns": (
        entry("a", "x", "policy: {functor: ZeroThrust}"), platforms("x"), "agent_config", "policy that is trained",
    ),
    "only checkpoints": (
        entry("a", "x", "policy: {checkpoint: there}"), platforms("x"), "agent_config", "none is trained",
    ),
    "an unknown scripted policy": (
        f"{entry('a', 'x')}\n{entry('b', 'y', 'policy: {functor: ZeroThrst}')}", platforms("x", "y"),
        "agent_config[1].policy.functor", "did you mean `ZeroThrust`?",
    ),
    "a field that a scripted policy does not have": (
        f"{entry('a', 'x')}\n{entry('b', 'y', 'policy: {functor: ZeroThrust, config: {seed: 3}}')}",
        platforms("x", "y"),
        "agent_config[1].policy.config.seed", "seed",
    ),
    "an algorithm and a scripted policy": (
        f"{entry('a', 'x')}\n{entry('b', 'y', 'policy: {algorithm: PPO, functor: ZeroThrust}')}", platforms("x", "y"),
        "agent_config[1].policy", "mutually exclusive",
    ),
    "two algorithms": (
        f"{entry('a', 'x')}\n{entry('b', 'y', 'policy: {algorithm: APPO}')}", platforms("x", "y"),
        "agent_config[1].policy.algorithm", "one algorithm",
    ),
    "a shared policy that is configured twice": (
        f"{entry('a', 'x', LEARNS + ', policy_name: t')}\n"
        f"{entry('b', 'y', 'policy: {algorithm: PPO, config: {lr: 1.0e-5}}, policy_name: t')}",
        platforms("x", "y"), "agent_config[1].policy", "share the policy 't'",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_among_agents_gives_one_message_with_its_place(team, name):
    agents, bodies, path, words = MISTAKES[name]
    with pytest.raises(ConfigError) as caught:
        load_experiment(write(team, agents, bodies))
    told = [problem for problem in caught.value.problems if problem.path == path]
    assert len(caught.value.problems) == len(told) == 1, caught.value
    assert words in str(told[0])
    assert told[0].location is not None


def test_a_success_function_that_no_agent_has_is_noted(team):
    override = "MultiagentSuccessDoneFunction.config.success_function_name=SafeSuccessfulInspectionDoneFunction"
    with pytest.warns(UserWarning, match="no agent has a done function named 'SafeSuccessful") as caught:
        spec = load_experiment(team / "experiment.yml", [override]).spec
    assert "config.config.env_config.dones.shared[1].config.success_function_name: " in str(caught[0].message)
    assert "did you mean `SuccessfulInspectionDoneFunction`?" in str(caught[0].message)
    environment = TeamEnvironment(spec, 2)
    environment.reset()
    environment.step([np.zeros((2, group.size, group.action_layout.size)) for group in environment.acting])


def test_a_mistake_in_a_template_is_reported_once(team):
    agent = team.parent / "translational-inspection" / "agent.yml"
    agent.write_text(agent.read_text().replace("config: {scale: 0.01}", "config: {scael: 0.01}"))
    with pytest.raises(ConfigError) as caught:
        load_experiment(team / "experiment.yml")
    (problem,) = caught.value.problems
    assert "agent.yml" in str(problem.location)


def test_all_agents_act_at_one_rate(team):
    folder = team.parent / "translational-inspection"
    slow = (folder / "agent.yml").read_text().replace("frame_rate: 0.1", "frame_rate: 0.05")
    (folder / "slow.yml").write_text(slow)
    agents = f"{entry('a', 'x')}\n{entry('b', 'y').replace('./agent.yml', 'configs/translational-inspection/slow.yml')}"
    with pytest.raises(ConfigError, match="all agents must act at the same rate"):
        load_experiment(write(team, agents, platforms("x", "y")))
