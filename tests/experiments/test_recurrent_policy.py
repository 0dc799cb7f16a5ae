"""Recurrent policies of a checkpoint fly: each row remembers its own episode, and nothing of the one before."""

from __future__ import annotations

import numpy as np
import pytest
from random_checkpoint import experiment_of, single_run

import safe_inspect
from safe_inspect.errors import SafeInspectError
from safe_inspect.evaluation.rollouts.rollout import rollout


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("recurrent")
    single_run(folder, experiment_of(), use_lstm=True, lstm_cell_size=8, max_seq_len=5)
    return folder


def test_a_recurrent_policy_flies_and_remembers_its_own_episode(run):
    from safe_inspect.experiments.modules.sources import open_source

    spec, policies = open_source(run)
    (policy,) = policies.values()
    assert policy.recurrent
    together = rollout(spec, policies, 6, seed=2, num_envs=6)
    apart = rollout(spec, policies, 6, seed=2, num_envs=2)
    np.testing.assert_allclose(together.delta_v, apart.delta_v, rtol=1e-4)
    assert together.delta_v.max() > 0.0
    observation = np.linspace(-1.0, 1.0, 22, dtype=np.float32).reshape(2, 11)
    policy._memory = None
    first, second = policy.inputs(observation), policy.inputs(observation)
    assert not np.allclose(first, second)
    policy._memory = None
    np.testing.assert_array_equal(policy.inputs(observation), first)


def test_a_loop_of_ones_own_is_told_to_evaluate(run):
    with pytest.raises(SafeInspectError, match="the policy is recurrent, and `predict` keeps nothing; fly it with"):
        safe_inspect.load_policy(run)
