"""The configuration that RLlib gets: runner, learner, policies, callbacks and buffers; no algorithm is built."""

from __future__ import annotations

import dataclasses
import json
from types import SimpleNamespace
from typing import Any

import pytest
from algorithms import build, policies_of
from dummy_environment import ONE, TEAM

from safe_inspect.errors import ConfigError
from safe_inspect.experiments.runs.cluster import largest_claim

pytestmark = pytest.mark.ray


def policies(**own: Any) -> list[Any]:
    return [dataclasses.replace(policy, config=own.get(policy.name, {})) for policy in policies_of(TEAM)]


def test_a_single_agent_gets_the_batched_runner_and_the_fast_learner() -> None:
    from safe_inspect.experiments.learning.algorithm import ENVIRONMENT
    from safe_inspect.experiments.learning.ppo_learner import FastPPOLearner
    from safe_inspect.experiments.sampling.env_runners import BatchedEnvRunner, RunCallbacks

    config: Any = build(
        {"team": ONE}, learner_threads=3, learner_config_dict={"a": 1}, gamma=0.5, **{"lambda": 0.75},
        evaluation_config={"explore": False, "lambda": 0.25},
    )  # fmt: skip
    assert (config.env, config.env_runner_cls, config.learner_class) == (ENVIRONMENT, BatchedEnvRunner, FastPPOLearner)
    assert config.learner_config_dict == {"threads": 3, "a": 1}
    assert (config.gamma, config.lambda_, config.evaluation_config) == (0.5, 0.75, {"explore": False, "lambda_": 0.25})
    assert config.env_config["several"] is False
    assert "flat_actions" not in config.env_config
    assert config.gym_env_vectorize_mode == "vector_entry_point"
    assert (config.normalize_actions, config.clip_actions, config.disable_env_checking) == (False, False, True)
    assert config.callbacks_class == [RunCallbacks]
    assert config.rl_module_spec.model_config["fcnet_hiddens"] == [16, 16]


def test_stock_parts_are_those_of_rllib() -> None:
    config: Any = build({"team": ONE}, env_runner="stock", learner="stock")
    assert config.env_runner_cls is None
    assert config.learner_config_dict == {}
    assert "FastPPO" not in repr(config._learner_class)


def test_several_policies_have_what_is_their_own() -> None:
    from safe_inspect.experiments.sampling.env_runners import BatchedTeamRunner

    first, *others = (policy.name for policy in policies())
    own = {first: {"lr": 0.5, "grad_clip": 2.0, "model_config": {"fcnet_hiddens": [7]}}}
    config: Any = build({"team": TEAM}, policies=policies(**own), model_config={"fcnet_hiddens": [5]})
    assert config.env_runner_cls is BatchedTeamRunner
    assert config.env_config["several"] is True
    assert config.gym_env_vectorize_mode == "sync"
    assert set(config.policies) == {first, *others}
    assert sorted(config.policies_to_train) == sorted([first, *others])
    assert config.algorithm_config_overrides_per_module == {first: {"lr": 0.5, "grad_clip": 2.0}}
    specs = config.rl_module_spec.rl_module_specs
    assert {name: spec.model_config["fcnet_hiddens"] for name, spec in specs.items()} == {
        first: [7], **{name: [5] for name in others},
    }  # fmt: skip
    mapping = config.policy_mapping_fn
    for policy in policies():
        assert {mapping(agent, None) for agent in policy.agents} == {policy.name}


def test_one_recurrent_policy_of_a_team_needs_rllibs_runner_and_learner() -> None:
    from safe_inspect.experiments.learning.ppo_learner import FastPPOLearner
    from safe_inspect.experiments.sampling.env_runners import BatchedTeamRunner

    first = policies()[0].name
    with pytest.warns(UserWarning, match=f"RLlib's stock (runner samples|learner learns), because the policy {first}"):
        config: Any = build({"team": TEAM}, policies=policies(**{first: {"model_config": {"use_lstm": True}}}))
    assert config.env_runner_cls is not BatchedTeamRunner
    assert config.learner_class is not FastPPOLearner


class Mine:
    """No class of callbacks."""


def test_callbacks_of_ones_own_come_after_those_of_the_run() -> None:
    from ray.rllib.callbacks.callbacks import RLlibCallback

    path = "ray.rllib.callbacks.callbacks.RLlibCallback"
    config: Any = build({"team": ONE}, callbacks=[path])
    assert config.callbacks_class[1:] == [RLlibCallback]
    shown = {
        f"{__name__}.Mine": f"'{__name__}.Mine' is not a class of callbacks; derive it from ray.rllib's RLlibCallback",
        "no_such_module.Class": "no module 'no_such_module'; correct the name, install the module, or start the "
        "command in the folder that contains it",
        f"{__name__}.nothing": f"module '{__name__}' has no 'nothing'",
    }
    for name, text in shown.items():
        with pytest.raises(ConfigError) as caught:
            build({"team": ONE}, callbacks=[path, name])
        assert [str(problem) for problem in caught.value.problems] == [f"rllib_configs.callbacks: {text}"]


@pytest.mark.parametrize(
    ("changes", "unit", "shown"),
    [
        ({}, "control steps", ""),
        ({"learner": "stock"}, "N", ""),
        ({"algorithm": "APPO", "learner": "stock"}, "control steps", "`algorithm: APPO`, `learner: stock`"),
        ({"env_runner": "stock"}, "control steps", "`env_runner: stock`"),
    ],
)
def test_decisions_that_last_need_their_own_runner_and_learner(changes: dict[str, str], unit: str, shown: str) -> None:
    from safe_inspect.experiments.learning import algorithm

    unit = algorithm.CONTROL_STEPS if unit == "control steps" else unit
    settings = {"algorithm": "PPO", "env_runner": "batched", "learner": "fast", **changes}
    texts = {"p": {"action": json.dumps([{"unit": "N"}, {"unit": unit}])}}
    if not shown:
        algorithm._check_decisions(settings, texts)
        return
    algorithm._check_decisions(settings, {})
    with pytest.raises(ConfigError) as caught:
        algorithm._check_decisions(settings, texts)
    assert str(caught.value) == (
        f"rllib_configs.{next(iter(changes))}: decisions that last several steps (CoastGlue) need `algorithm: PPO`, "
        f"`env_runner: batched`, `learner: fast`, not {shown}; change it, or remove CoastGlue"
    )


@pytest.mark.parametrize(
    ("kind", "several", "made"),
    [
        ("EpisodeReplayBuffer", False, "EpisodeReplayBuffer"),
        ("EpisodeReplayBuffer", True, "MultiAgentEpisodeReplayBuffer"),
        ("MultiAgentEpisodeReplayBuffer", True, "MultiAgentEpisodeReplayBuffer"),
        ("EpisodeReplayBufer", False, None),
        ("ReplayBuffer", False, None),
    ],
)
def test_there_is_another_replay_buffer_for_several_policies(kind: str, several: bool, made: str | None) -> None:
    from safe_inspect.experiments.learning.algorithm import set_replay_buffer

    config: Any = SimpleNamespace()
    if made is not None:
        set_replay_buffer(config, {"type": kind, "capacity": 9}, several=several)
        assert config.replay_buffer_config == {"type": made, "capacity": 9}
        return
    with pytest.raises(ConfigError) as caught:
        set_replay_buffer(config, {"type": kind}, several=several)
    (problem,) = caught.value.problems
    assert (problem.message, problem.path) == (
        f"RLlib has no replay buffer of episodes `{kind}`", "rllib_configs.replay_buffer_config",
    )  # fmt: skip
    assert not hasattr(config, "replay_buffer_config")


def test_the_environment_is_that_of_one_agent_or_of_several(monkeypatch: pytest.MonkeyPatch) -> None:
    from safe_inspect.experiments.learning import algorithm

    made: dict[str, Any] = {}
    monkeypatch.setattr(algorithm, "register_env", lambda name, create: made.update({name: create}))
    monkeypatch.setattr(algorithm, "TeamMultiAgentEnv", lambda rest: ("several", rest))
    monkeypatch.setattr(algorithm, "TrainingEnv", lambda rest, count: ("one", rest, count))
    algorithm.register_environments("m:f")
    create = made[algorithm.ENVIRONMENT]
    assert create({"several": False, "num_envs": 3}) == ("one", {"maker": "m:f", "several": False}, 3)
    assert create({"a": 1}) == ("one", {"maker": "m:f", "a": 1}, 1)
    assert create({"several": True, "maker": "x"}) == ("several", {"maker": "x", "several": True})


def test_keys_that_an_algorithm_does_not_have_are_reported_together() -> None:
    from safe_inspect.experiments.learning.algorithm import _apply, attribute_names, default_config

    config = default_config("APPO")
    names = attribute_names(config)
    assert {"lr", "vtrace", "lambda_", "num_env_runners"} <= names
    assert not any(name.startswith("_") for name in names)
    rllib = SimpleNamespace(given={"lr", "lambda", "learner", "taste", "vtrase"}, settings={"algorithm": "APPO"})
    with pytest.raises(ConfigError) as caught:
        _apply(config, rllib)
    second, first = caught.value.problems
    assert (first.message, first.path) == ("APPO has no key `vtrase`", "rllib_configs.vtrase")
    assert first.hint == "did you mean `vtrace`?"
    assert (second.message, second.path) == ("APPO has no key `taste`", "rllib_configs.taste")


@pytest.mark.parametrize(
    ("keys", "cpus", "gpus", "processes"),
    [
        ({"num_env_runners": 0}, 1.0, 0.0, 1),
        ({"num_env_runners": 2}, 3.0, 0.0, 3),
        ({"num_env_runners": 2, "num_cpus_per_env_runner": 2}, 5.0, 0.0, 3),
        ({"num_env_runners": 0, "num_gpus_per_learner": 1}, 1.0, 1.0, 1),
        ({"num_env_runners": 2, "num_gpus_per_env_runner": 0.5, "num_gpus_per_learner": 0.25}, 3.0, 1.25, 3),
    ],
)
def test_the_resources_that_a_training_claims(keys: dict[str, Any], cpus: float, gpus: float, processes: int) -> None:
    from safe_inspect.experiments.learning.algorithm import claimed_resources

    claim = largest_claim([claimed_resources(build({"team": ONE}, **keys))])
    assert (claim.resources["CPU"], claim.resources.get("GPU", 0.0), claim.processes) == (cpus, gpus, processes)
