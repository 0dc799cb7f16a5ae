"""Mistakes in the settings for RLlib, Tune and Ray are reported with their place; nothing here loads Ray."""

from __future__ import annotations

from pathlib import Path

import pytest

from safe_inspect.config.data import configs_root
from safe_inspect.config.experiment import load_experiment
from safe_inspect.config.learning import flight_note, learning_problems, placed
from safe_inspect.errors import Problem

ONE, SEED = (configs_root() / "translational-inspection" / f"experiment{end}.yml" for end in ("", "-seed"))
TEAM = configs_root() / "multiagent-translational-inspection" / "experiment.yml"
_SAC = f"policy=!include {configs_root() / 'learners' / 'sac.yml'}"
_DQN = f"policy=!include {configs_root() / 'learners' / 'dqn.yml'}"
_MIXED = "glues.0={functor: DiscreteControllerGlue, config: {controller: X Thrust, levels: [-1, 0, 1]}}"


def problems(experiment, found=()):
    """Return mistakes of the translation and those of the experiment, each with its place."""
    return placed(experiment, [*found, *learning_problems(experiment)])


@pytest.mark.parametrize(
    ("file", "overrides", "message", "remedy"),
    [
        (ONE, [], "", ""),
        (SEED, [], "", ""),
        (ONE, [_DQN], "", ""),
        (SEED, [_SAC], "", ""),
        (
            SEED,
            [_DQN],
            "DQN supports only discrete actions, but these are real numbers",
            "replace ControllerGlue by Discrete",
        ),
        (
            ONE,
            [_SAC],
            "SAC supports only continuous actions, but these are discrete, one level for each controller",
            "replace DiscreteControllerGlue by ControllerGlue, or use PPO",
        ),
    ],
)
def test_an_algorithm_that_cannot_learn_the_actions_is_refused(file, overrides, message, remedy):
    found = problems(load_experiment(file, overrides))
    assert [problem.message for problem in found] == ([message] if message else [])
    for problem in found:
        assert problem.path == "agent_config[0].policy.algorithm"
        assert remedy in problem.hint
        assert problem.location is not None


@pytest.mark.filterwarnings("error")
def test_an_override_that_every_policy_replaces_is_warned_of():
    with pytest.warns(UserWarning, match=r"rllib_configs\.gamma=0\.5 has no effect: each agent's `policy` has 0\.99"):
        assert load_experiment(TEAM, ["rllib_configs.gamma=0.5"]).rllib["gamma"] != 0.5
    load_experiment(TEAM, ["rllib_configs.num_env_runners=1"])  # which no policy sets
    load_experiment(ONE, [_DQN])  # whose values replace those of the file on purpose


def test_every_mistake_is_reported_at_once():
    found = problems(load_experiment(SEED, [_DQN, "rewards=[]"]), [Problem("wrong", "tune_config.stop")])
    assert len(found) == 3
    assert found[2].message == "blue0_ctrl: no reward, so that nothing can be learned; add one to `rewards`"
    assert found[2].path == "agent_config[0].policy"


@pytest.mark.parametrize(
    ("file", "path", "place", "line"),
    [
        (ONE, "rllib_configs.algorithm", "agent_config[0].policy.algorithm", "algorithm: PPO"),
        (ONE, "rllib_configs.gamma", "agent_config[0].policy.config.gamma", "gamma:"),
        (ONE, "rllib_configs.model_config.fcnet_hiddens[1]",
         "agent_config[0].policy.config.model_config.fcnet_hiddens[1]", ""),
        (ONE, "rllib_configs.num_env_runners", "config.config.rllib_configs.local.num_env_runners", "num_env_runners:"),
        (ONE, "tune_config.stop", "config.config.tune_config.stop", "stop:"),
        (ONE, "policies.blue0_ctrl", "agent_config[0].policy", ""),
        (ONE, "policies.blue0_ctrl.lr", "agent_config[0].policy.config.lr", "lr:"),
        (ONE, "policies.blue0_ctrl.algorithm", "agent_config[0].policy.algorithm", "algorithm:"),
        (ONE, "policies.blue0_ctrl.nothing.of.this", "agent_config[0].policy", ""),
        (TEAM, "policies.blue1_ctrl.lr", "agent_config[0].policy.config.lr", "lr:"),
    ],
)  # fmt: skip
def test_a_mistake_is_reported_with_its_place(file, path, place, line):
    (found,) = placed(load_experiment(file), [Problem("wrong", path, hint="fix it")])
    assert (found.message, found.hint) == ("wrong", "fix it")
    assert found.path == place
    text = Path(found.location.file).read_text(encoding="utf-8").splitlines()[found.location.line - 1]
    assert line in text


def test_what_stands_nowhere_or_has_a_place_keeps_it():
    experiment = load_experiment(ONE)
    for path in ("", "rllib_configs.none", "tune_config.none", "policies.other.lr"):
        (found,) = placed(experiment, [Problem("wrong", path)])
        assert (found.path, found.location) == (path, None)
    first = placed(experiment, [Problem("wrong", "rllib_configs.gamma")])
    assert placed(experiment, first) == first


@pytest.mark.parametrize(
    ("file", "overrides", "note"),
    [
        (ONE, [], ""),
        (ONE, ["policy.config.model_config.use_lstm=True"], ""),
        (ONE, [_DQN], ""),
        (
            ONE,
            [_DQN, "policy.config.model_config.use_lstm=True"],
            "recurrent policies of DQN cannot be exported to ONNX",
        ),
        (SEED, [_SAC], ""),
        (
            ONE,
            ["policy.config={rl_module: x}"],
            "but not evaluated: no policy file can contain the code of `rl_module`",
        ),
    ],
)
def test_what_is_not_flown_is_noted(file, overrides, note):
    found = flight_note(load_experiment(file, overrides))
    assert found == "" if not note else note in found
