"""TorchRL's wrappers take the batch and the team: the same episodes, resets by mask, infos that are tensors."""

from __future__ import annotations

import numpy as np
import pytest

import safe_inspect

torch = pytest.importorskip("torch")
pytest.importorskip("torchrl", reason="pip install 'safe_inspect[torchrl]'")

from torchrl.envs import GymEnv, GymWrapper, SerialEnv  # noqa: E402

from safe_inspect.integrations.torchrl import team_env  # noqa: E402

ID = "safe_inspect/TranslationalInspectionSeed-v0"
TEAM = "safe_inspect/MultiagentTranslationalInspectionSeed-v0"


def test_the_batch_is_reset_by_mask():
    envs = GymWrapper(safe_inspect.make_vec(ID, 3, ["horizon=7"], autoreset_mode="Disabled", seed=4))
    native = safe_inspect.make_vec(ID, 3, ["horizon=7"], autoreset_mode="SameStep", seed=4)
    found = envs.rollout(20, break_when_any_done=False)
    observations, _ = native.reset()
    for step in range(20):
        np.testing.assert_array_equal(found["observation"][:, step].numpy(), observations)
        observations, rewards, *_ = native.step(found["action"][:, step].numpy())
        np.testing.assert_allclose(found["next", "reward"][:, step, 0].numpy(), rewards, rtol=1e-6)
    assert int(found["next", "done"].sum()) >= 6


def test_an_id_is_made_by_torchrls_own_line():
    envs = SerialEnv(2, lambda: GymEnv("safe_inspect/TranslationalInspection-v1", overrides=["horizon=7"]))
    assert envs.rollout(9, break_when_any_done=False)["next", "reward"].shape == (2, 9, 1)
    envs.close()


def test_the_batch_begins_again_by_itself():
    task = "safe_inspect/TranslationalInspection-v1"  # whose resets have additional infos
    envs = GymWrapper(safe_inspect.make_vec(task, 3, ["horizon=7"], autoreset_mode="SameStep", seed=4))
    found = envs.rollout(20, break_when_any_done=False)
    assert int(found["next", "done"].sum()) >= 6


def test_a_team_flies_with_numbers_in_its_infos():
    env = team_env(TEAM, ["horizon=7"])
    found = env.rollout(20, break_when_any_done=False)
    assert sorted(env.group_map) == ["blue0_ctrl", "blue1_ctrl", "blue2_ctrl"]
    agent = found["next", "blue1_ctrl"]
    assert sorted(agent["info"].keys()) == ["delta_v", "inspected_count", "inspected_fraction", "own_inspected_count"]
    assert float(agent["info", "delta_v"].max()) > 0.0
    assert int(found["next", "done"].sum()) >= 2
