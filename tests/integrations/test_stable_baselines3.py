"""The batch as Stable-Baselines3's vector of environments: the same episodes, and its algorithms run on it."""

from __future__ import annotations

import numpy as np
import pytest

import safe_inspect

sb3 = pytest.importorskip("stable_baselines3", reason="pip install 'safe_inspect[sb3]'")

from safe_inspect.integrations.stable_baselines3 import BatchedVecEnv  # noqa: E402

ID = "safe_inspect/TranslationalInspectionSeed-v0"
LEVELS = "configs/translational-inspection/experiment.yml"


def test_it_flies_what_the_native_batch_flies():
    vector = BatchedVecEnv(ID, 5, ["horizon=7"])
    vector.seed(4)
    native = safe_inspect.make_vec(ID, 5, ["horizon=7"], autoreset_mode="SameStep")
    observations, infos = native.reset(seed=4)
    np.testing.assert_array_equal(vector.reset(), observations)
    assert [info["inspected_count"] for info in vector.reset_infos] == infos["inspected_count"].tolist()
    generator = np.random.default_rng(0)
    for _ in range(21):
        actions = generator.uniform(-1.0, 1.0, (5, 3)).astype(np.float32)
        observations, rewards, terminated, truncated, infos = native.step(actions)
        seen, paid, done, told = vector.step(actions)
        np.testing.assert_array_equal(seen, observations)
        np.testing.assert_allclose(paid, rewards, rtol=1e-6)
        np.testing.assert_array_equal(done, terminated | truncated)
        for index in range(5):
            assert bool(told[index]) == done[index]
            if done[index]:
                np.testing.assert_array_equal(told[index]["terminal_observation"], infos["final_obs"][index])
                assert told[index]["TimeLimit.truncated"] == truncated[index]
                assert told[index]["episode"]["l"] == 7 or terminated[index]
    assert done.all()


def test_rewards_of_an_episode_add_up():
    vector = BatchedVecEnv(ID, 2, ["horizon=5"], seed=1)
    vector.reset()
    paid = sum(vector.step(np.ones((2, 3), dtype=np.float32))[1] for _ in range(4))
    _, last, done, infos = vector.step(np.ones((2, 3), dtype=np.float32))
    assert done.all()
    np.testing.assert_allclose([info["episode"]["r"] for info in infos], paid + last, rtol=1e-5)


@pytest.mark.parametrize("task", [ID, LEVELS])
def test_ppo_learns_on_it(task):
    model = sb3.PPO("MlpPolicy", BatchedVecEnv(task, 8, ["horizon=12"]), n_steps=16, batch_size=64, n_epochs=1, seed=0)
    model.learn(256)
    assert len(model.ep_info_buffer) > 10
    assert {info["l"] for info in model.ep_info_buffer} <= set(range(1, 13))


def test_sac_learns_on_it():
    model = sb3.SAC("MlpPolicy", BatchedVecEnv(ID, 4, ["horizon=10"]), learning_starts=16, batch_size=16, seed=0)
    model.learn(24)
    assert model.num_timesteps == 24


def test_the_rows_of_a_batch_have_no_separate_attributes():
    vector = BatchedVecEnv(ID, 3)
    assert vector.get_attr("num_envs") == [3, 3, 3]
    assert vector.env_is_wrapped(object) == [False] * 3
    with pytest.raises(NotImplementedError, match="rows of one batch"):
        vector.env_method("reset")
