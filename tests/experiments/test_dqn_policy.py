"""Policies of DQN: learned as one choice, flown as levels, saved without pickle, exported."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from random_checkpoint import discrete, experiment_of, save_run

import safe_inspect
from safe_inspect.config.data import configs_root
from safe_inspect.config.experiment import load_experiment
from safe_inspect.environments.facades.spaces import from_flat
from safe_inspect.errors import CheckpointError, ConfigError
from safe_inspect.evaluation.rollouts import rollout
from safe_inspect.experiments.modules.checkpoints import find_newest

CHOICES = [3, 5, 5]


def _module(**settings):
    import torch
    from gymnasium.spaces import Discrete
    from ray.rllib.algorithms.dqn.dqn import DQNConfig
    from ray.rllib.core.rl_module.default_model_config import DefaultModelConfig

    from safe_inspect.environments.facades.spaces import box
    from safe_inspect.environments.layout import observation_layout
    from safe_inspect.experiments.modules.saved_policy import DqnPolicy

    agent = experiment_of(discrete).spec.agents[0]
    torch.manual_seed(0)
    own = DQNConfig().training(**{key: settings.pop(key) for key in ("num_atoms", "dueling") if key in settings})
    model = {**dataclasses.asdict(DefaultModelConfig(fcnet_hiddens=[16], **settings)), "choices": CHOICES}
    return DqnPolicy(
        observation_space=box(observation_layout(agent)),
        action_space=Discrete(75),
        model_config=model | own._model_config_auto_includes,
    )


def _save(folder, module):
    from safe_inspect.experiments.modules.checkpoints import INFO
    from safe_inspect.experiments.settings.policies import policy_info

    experiment = experiment_of(discrete)
    info = policy_info(experiment, "default_policy", experiment.spec.agents)
    module.model_config[INFO] = dataclasses.replace(info, distribution="greedy").metadata()
    save_run(folder, experiment, {"default_policy": module}, keep_info=True)
    return folder


@pytest.fixture(scope="module", params=[{}, {"dueling": False}], ids=["dueling", "plain"])
def module(request):
    return _module(**request.param)


@pytest.fixture(scope="module")
def run(module, tmp_path_factory):
    return _save(tmp_path_factory.mktemp("dqn"), module)


def test_the_best_combination_is_flown_and_exported(run, module, tmp_path):
    import torch
    from ray.rllib.algorithms.dqn.default_dqn_rl_module import QF_PREDS
    from ray.rllib.core.columns import Columns

    policy = safe_inspect.load_policy(run)
    observations, _ = policy.make_vec(64).reset(seed=3)
    with torch.no_grad():
        values = module.compute_q_values({Columns.OBS: torch.from_numpy(observations)})[QF_PREDS].numpy()
    wanted = from_flat(values.argmax(axis=1), CHOICES)
    assert len(np.unique(wanted, axis=0)) > 1
    np.testing.assert_array_equal(policy.predict(observations), wanted)
    np.testing.assert_array_equal(policy.predict(observations, np.random.default_rng(0)), wanted)  # it draws nothing
    pytest.importorskip("onnx")
    from safe_inspect.experiments.export import export_policy

    assert export_policy(find_newest(run)[0].path, tmp_path / "dqn.onnx").difference.passes
    np.testing.assert_array_equal(safe_inspect.load_policy(tmp_path / "dqn.onnx").predict(observations), wanted)


def test_it_is_evaluated_without_draws(run):
    from safe_inspect.experiments.modules.sources import Wanted, open_candidates

    flown = []
    for sampled in (None, True, False):
        (candidate,) = open_candidates([str(run)], Wanted(sampled=sampled, seed=5))
        flown.append(rollout(candidate.spec, candidate.policies, 4, seed=1).delta_v)
    np.testing.assert_array_equal(flown[0], flown[1])
    np.testing.assert_array_equal(flown[0], flown[2])
    assert flown[0].max() > 0.0


def test_recurrent_policies_are_exported_and_distributions_of_returns_are_not(tmp_path):
    (tmp_path / "a").mkdir()
    run = _save(tmp_path / "a", _module(use_lstm=True, lstm_cell_size=8, max_seq_len=5))
    from safe_inspect.experiments.modules.sources import open_source

    spec, policies = open_source(run)
    assert rollout(spec, policies, 2, seed=1).delta_v.max() > 0.0
    pytest.importorskip("onnx")
    from safe_inspect.experiments.export import export_policy

    assert export_policy(find_newest(run)[0].path, tmp_path / "a.onnx").info.state == {"state_h": 8, "state_c": 8}
    (tmp_path / "b").mkdir()
    run = _save(tmp_path / "b", _module(num_atoms=5))
    assert safe_inspect.load_policy(run).predict(np.zeros(11, np.float32)).shape == (3,)
    with pytest.raises(CheckpointError, match=r"a distribution of returns \(`num_atoms`\); train without"):
        export_policy(find_newest(run)[0].path, tmp_path / "b.onnx")


def test_it_does_not_fly_with_policies_that_learn(run):
    from safe_inspect.config.spec import PolicySpec
    from safe_inspect.experiments.modules.checkpoints import check_frozen

    frozen = PolicySpec("old", ("blue0_ctrl",), "", {}, checkpoint=str(find_newest(run)[0].path))
    with pytest.raises(CheckpointError, match="policies of SAC and DQN cannot be combined with policies that learn"):
        check_frozen(frozen, {})


def test_the_shipped_file_is_built_with_one_choice():
    from safe_inspect.experiments.learning.algorithm import build_config
    from safe_inspect.experiments.runs.training_run import read_settings
    from safe_inspect.experiments.settings.policies import environment_settings

    learner = configs_root() / "learners" / "dqn.yml"
    task = configs_root() / "translational-inspection" / "experiment.yml"
    experiment = load_experiment(task, [f"policy=!include {learner}"])
    settings = read_settings({"algorithm": experiment.algorithm, **experiment.rllib}, {}, {}).rllib
    config = build_config(settings, environment_settings(experiment.resolved, settings.settings))
    assert config.env_config["flat_actions"]
    assert config.rl_module_spec.model_config["choices"] == [3, 3, 3]


def test_the_environments_of_rllib_take_an_index():
    from safe_inspect.experiments.sampling.environment import TeamMultiAgentEnv, TrainingEnv

    resolved = load_experiment("safe_inspect/TranslationalInspection-v1").resolved
    flat = TrainingEnv({"experiment": resolved, "flat_actions": True}, 2)
    plain = TrainingEnv({"experiment": resolved}, 2)
    assert flat.single_action_space.n == 27
    flat.reset()
    plain.reset()
    np.testing.assert_array_equal(flat.step(np.array([5, 26]))[0], plain.step(np.array([[0, 1, 2], [2, 2, 2]]))[0])
    several = [TeamMultiAgentEnv({"experiment": resolved, **more}) for more in ({"flat_actions": True}, {})]
    (agent,) = several[0].possible_agents
    seen = []
    for env, action in zip(several, (5, np.array([0, 1, 2])), strict=True):
        env.reset()
        seen.append(env.step({agent: action})[0][agent])
    np.testing.assert_array_equal(*seen)


def test_too_many_combinations_are_refused():
    from safe_inspect.experiments.modules.saved_policy import choices_of

    with pytest.raises(ConfigError, match=r"there are 46,656 of them; use PPO"):
        choices_of({"action": str([{"levels": [0] * 6}] * 6).replace("'", '"')})


@pytest.mark.parametrize(
    ("algorithm", "several", "kind"),
    [
        ("DQN", True, "MultiAgentPrioritizedEpisodeReplayBuffer"),
        ("DQN", False, "PrioritizedEpisodeReplayBuffer"),
        ("SAC", True, "MultiAgentPrioritizedEpisodeReplayBuffer"),
    ],
)
def test_several_policies_have_a_replay_buffer_for_several(algorithm, several, kind):
    from safe_inspect.experiments.learning.algorithm import default_config, set_replay_buffer

    config = default_config(algorithm)
    set_replay_buffer(config, {**config.replay_buffer_config, "capacity": 10}, several=several)
    assert (config.replay_buffer_config["type"], config.replay_buffer_config["capacity"]) == (kind, 10)


def test_a_replay_buffer_that_is_misspelt_is_reported():
    from safe_inspect.experiments.learning.algorithm import default_config, set_replay_buffer

    with pytest.raises(ConfigError, match="did you mean `PrioritizedEpisodeReplayBuffer`"):
        set_replay_buffer(default_config("DQN"), {"type": "PrioritizedEpisodeReplayBufer"}, several=False)
