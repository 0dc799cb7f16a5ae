"""One index for the levels of all controllers."""

from __future__ import annotations

import numpy as np
import pytest

import safe_inspect
from safe_inspect.environments import FlatDiscreteActions
from safe_inspect.errors import ArgumentError, SafeInspectError

ID = "safe_inspect/TranslationalInspection-v1"


def test_an_index_means_levels():
    flat, plain = FlatDiscreteActions(safe_inspect.make(ID)), safe_inspect.make(ID)
    assert flat.action_space.n == 27
    flat.reset(seed=4)
    plain.reset(seed=4)
    for index, levels in ((0, [0, 0, 0]), (5, [0, 1, 2]), (26, [2, 2, 2])):
        np.testing.assert_array_equal(flat.step(index)[0], plain.step(np.array(levels))[0])


def test_dqn_learns_on_it():
    sb3 = pytest.importorskip("stable_baselines3", reason="pip install 'safe_inspect[sb3]'")
    environment = FlatDiscreteActions(safe_inspect.make(ID, ["horizon=10"]))
    model = sb3.DQN("MlpPolicy", environment, learning_starts=8, batch_size=8, train_freq=4, seed=0)
    model.learn(40)
    assert model.num_timesteps == 40


def test_real_numbers_are_refused():
    with pytest.raises(SafeInspectError, match="the actions are real numbers"):
        FlatDiscreteActions(safe_inspect.make("safe_inspect/TranslationalInspectionSeed-v0"))


@pytest.mark.parametrize("action", [27, -1, 0.5, [1, 2], float("nan")])
def test_what_is_no_index_is_refused(action):
    flat = FlatDiscreteActions(safe_inspect.make(ID))
    flat.reset(seed=0)
    with pytest.raises(ArgumentError, match="expected a whole number from 0 to 26"):
        flat.step(action)
