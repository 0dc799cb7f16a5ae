"""Random numbers of plugins: standard normal, independent, and functions of what they say."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from safe_inspect.config.data import configs_root
from safe_inspect.config.experiment import load_experiment
from safe_inspect.environments import TeamEnvironment


def views(rows, first_slot=0, seed=5, task="translational-inspection", steps=2):
    spec = load_experiment(configs_root() / task / "experiment.yml", []).spec
    env = TeamEnvironment(spec, rows, seed=seed, first_slot=first_slot)
    env.reset()
    found = []
    for _ in range(steps):
        found.append(env.view().normal("noise", 4))
        env.simulation.step(np.zeros_like(env.state.control))
    return env, np.array(found)


def test_the_numbers_are_standard_normal_and_independent():
    env, drawn = views(4000)
    assert drawn.shape == (2, 4000, 4)
    assert stats.kstest(drawn.ravel(), "norm").pvalue > 1e-3
    columns = np.concatenate((*drawn, env.view().normal("other", 4)), axis=1)
    assert np.abs(np.corrcoef(columns.T) - np.eye(12)).max() < 0.08


def test_they_are_functions_of_seed_slot_episode_step_deputy_and_purpose():
    env, batch = views(8)
    _, alone = views(1, first_slot=5)
    np.testing.assert_array_equal(batch[:, 5], alone[:, 0])
    np.testing.assert_array_equal(env.view().normal("noise", 4), env.view().normal("noise", 4))
    np.testing.assert_array_equal(env.view().normal("noise", 2), env.view().normal("noise", 4)[:, :2])
    assert not np.any(views(8, seed=6)[1] == batch)
    env.reset()
    assert not np.any(env.view().normal("noise", 4) == batch[0])
    _, team = views(2, task="multiagent-translational-inspection")
    assert len(np.unique(team)) == team.size == 2 * 6 * 4


@pytest.mark.parametrize("size", [1, 3])
def test_each_row_gets_its_size(size):
    env, _ = views(5, steps=0)
    assert env.view().normal("x", size).shape == (5, size)
