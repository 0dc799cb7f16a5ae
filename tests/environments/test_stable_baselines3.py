"""Stable-Baselines3's own vectors of environments fly what the environments fly."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest

import safe_inspect
from safe_inspect.task_ids import TASKS

vec_env = pytest.importorskip("stable_baselines3.common.vec_env", reason="pip install 'safe_inspect[test]'")
ID = next(iter(TASKS))


def test_plain_factories_start_different_episodes():
    environments = vec_env.DummyVecEnv([lambda: gymnasium.make(ID)] * 4)
    assert len(np.unique(environments.reset(), axis=0)) == 4


def test_seeded_factories_fly_what_the_environment_alone_flies():
    environments = vec_env.DummyVecEnv([lambda: gymnasium.make(ID)] * 3)
    environments.seed(5)
    flown = [environments.reset()]
    generator = np.random.default_rng(0)
    actions = generator.uniform(-1.0, 1.0, (20, 3, 3)).astype(np.float32)
    flown += [environments.step(action)[0] for action in actions]
    for index in range(3):
        alone = safe_inspect.make(ID)
        seen = [alone.reset(seed=5 + index)[0]]
        for action in actions[:, index]:
            observation, _, terminated, truncated, _ = alone.step(action)
            if terminated or truncated:
                break
            seen.append(observation)
        np.testing.assert_array_equal(np.stack(flown)[: len(seen), index], np.stack(seen))
