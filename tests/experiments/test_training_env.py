"""The environment as RLlib's runner sees it: slots, seeds, and one report for each episode."""

from __future__ import annotations

import json

import numpy as np
import pytest
from dummy_environment import DummyVectorEnv
from gymnasium.vector import AutoresetMode

from safe_inspect.errors import PluginValueError
from safe_inspect.experiments.environment import TrainingEnv, first_slot, stream_seed


def build(num_envs=4, maker="dummy_environment:make", **more):
    return TrainingEnv({"experiment": {}, "seed": 3, "maker": maker, **more}, num_envs)


def test_slots_of_the_runners_do_not_overlap():
    assert [first_slot(worker, 16) for worker in (0, 1, 2, 3)] == [0, 0, 16, 32]


def test_seeds_of_attempts_and_of_the_evaluation_differ():
    seeds = [stream_seed(3, attempt, evaluation) for attempt in range(50) for evaluation in (False, True)]
    assert seeds[0] == 3
    assert len(set(seeds)) == 100
    assert all(0 <= seed < 2**64 for seed in seeds)


def test_a_placed_runner_has_its_slots():
    whole, second = build(8), build(4)
    second.place(worker_index=2, evaluation=False)
    everything, _ = whole.reset(seed=99)
    part, _ = second.reset()
    np.testing.assert_array_equal(part, everything[4:])
    for _ in range(80):
        actions = np.tile(np.linspace(-1.0, 1.0, 8)[:, None], (1, 3)).astype(np.float32)
        everything, *_ = whole.step(actions)
        part, *_ = second.step(actions[4:])
        np.testing.assert_array_equal(part, everything[4:])


def test_the_evaluation_sees_other_episodes():
    training, evaluation = build(), build()
    evaluation.place(0, True)
    assert not np.array_equal(training.reset()[0], evaluation.reset()[0])


def test_each_episode_is_reported_once_with_its_sums():
    env = build(6)
    plain = DummyVectorEnv({}, 6, 3, 0)
    env.reset()
    plain.reset()
    sums = {name: np.zeros(6) for name in ("reward/cost", "reward/near")}
    begun = np.zeros(6, dtype=bool)
    generator = np.random.default_rng(0)
    reported = 0
    for _ in range(300):
        actions = generator.uniform(-1.0, 2.0, (6, 3)).astype(np.float32)
        _, rewards, terminated, truncated, infos = env.step(actions)
        _, plain_rewards, *_, told = plain.step(np.clip(actions, -1.0, 1.0))
        np.testing.assert_array_equal(rewards, plain_rewards)
        for name, total in sums.items():
            total += np.where(begun, 0.0, told[name])  # the terms of a reset belong to no episode
        begun = terminated | truncated
        assert bool(infos) == begun.any()
        for row in np.flatnonzero(begun):
            assert infos["_episode"][row]
            report = dict(zip(env.episode_fields, infos["episode"][row], strict=True))
            assert report["success"] == terminated[row]
            assert report["delta_v"] == told["delta_v"][row]
            assert report["inspected_fraction"] == told["inspected_fraction"][row]
            for name, total in sums.items():
                assert report[name] == pytest.approx(total[row], abs=1e-12)
                total[row] = 0.0
            reported += 1
    assert reported > 20


def test_a_users_error_is_left_in_a_file(tmp_path):
    file = tmp_path / "failure.json"
    env = build(failure_file=str(file), experiment={"fail_at": 2})
    env.reset()
    env.step(np.zeros((4, 3), np.float32))
    with pytest.raises(PluginValueError):
        env.step(np.zeros((4, 3), np.float32))
    assert json.loads(file.read_text())["error"] == "PluginValueError"


def test_another_way_of_resetting_is_refused(monkeypatch):
    monkeypatch.setattr(DummyVectorEnv, "metadata", {"autoreset_mode": AutoresetMode.SAME_STEP})
    with pytest.raises(ValueError, match="reset in the next step"):
        build()
