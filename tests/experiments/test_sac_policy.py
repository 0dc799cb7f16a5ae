"""Policies of SAC: saved without pickle, flown by their mean or as they explore, exported with their mean."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from random_checkpoint import experiment_of, save_run

import safe_inspect
from safe_inspect.evaluation.rollouts import rollout
from safe_inspect.experiments.modules.checkpoints import find_newest


@pytest.fixture(scope="module")
def module():
    import torch
    from ray.rllib.core.rl_module.default_model_config import DefaultModelConfig

    from safe_inspect.environments.facades.spaces import action_space, box
    from safe_inspect.environments.layout import action_layout, observation_layout
    from safe_inspect.experiments.modules.saved_policy import SacPolicy

    agent = experiment_of().spec.agents[0]
    torch.manual_seed(0)
    return SacPolicy(
        observation_space=box(observation_layout(agent)),
        action_space=action_space(action_layout(agent)),
        model_config={**dataclasses.asdict(DefaultModelConfig(fcnet_hiddens=[16])), "twin_q": True},
    )


@pytest.fixture(scope="module")
def run(module, tmp_path_factory):
    folder = tmp_path_factory.mktemp("sac")
    save_run(folder, experiment_of(), {"default_policy": module})
    return folder


def test_its_mean_is_flown(run, module):
    import torch
    from ray.rllib.core.columns import Columns

    policy = safe_inspect.load_policy(run)
    observations, _ = policy.make_vec(4).reset(seed=3)
    inputs = module.forward_inference({Columns.OBS: torch.from_numpy(observations)})[Columns.ACTION_DIST_INPUTS]
    mean = np.tanh(inputs.detach().numpy()[:, :3])  # RLlib's own `to_deterministic` leaves the tangent out
    np.testing.assert_allclose(policy.predict(observations), mean, rtol=1e-5, atol=1e-6)


def test_its_draws_are_a_function_of_the_seed(run):
    from safe_inspect.experiments.modules.sources import Wanted, open_candidates

    (candidate,) = open_candidates([str(run)], Wanted(sampled=True, seed=5))
    flown = [rollout(candidate.spec, candidate.policies, 4, seed=1, num_envs=count).delta_v for count in (4, 2)]
    np.testing.assert_allclose(*flown, rtol=1e-5)
    mean = rollout(candidate.spec, open_candidates([str(run)], Wanted())[0].policies, 4, seed=1).delta_v
    assert not np.allclose(mean, flown[0])


def test_the_exported_file_gives_its_mean(run, tmp_path):
    pytest.importorskip("onnx")
    from safe_inspect.experiments.export import export_policy

    done = export_policy(find_newest(run)[0].path, tmp_path / "sac.onnx")
    assert done.difference.passes
    policy, file = safe_inspect.load_policy(run), safe_inspect.load_policy(tmp_path / "sac.onnx")
    observations, _ = policy.make_vec(64).reset(seed=3)
    np.testing.assert_allclose(file.predict(observations), policy.predict(observations), atol=2e-6)
    assert np.ptp(file.predict(observations), axis=0).min() > 0.01
