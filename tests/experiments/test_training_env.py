"""The environments as RLlib's stock runners see them: slots, seeds, ends, and one report for each episode."""

from __future__ import annotations

import json
import os

import numpy as np
import pytest
from dummy_environment import TEAM, DummyTeam

from safe_inspect.errors import PluginValueError, SafeInspectError
from safe_inspect.experiments.sampling.environment import TrainingEnv, first_slot, stream_seed


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
    second.place(first_slot(2, second.num_envs), evaluation=False)
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


def test_several_agents_are_refused():
    with pytest.raises(SafeInspectError, match="this environment has one controlled agent, not red, blue, green"):
        build(experiment={"team": TEAM})


def test_each_episode_is_reported_once_with_its_sums():
    env = build(6)
    plain = DummyTeam({}, 6, 3, 0)
    observations, _ = env.reset()
    np.testing.assert_array_equal(observations, plain.reset()[0][:, 0])
    sums = {name: np.zeros(6) for name in ("cost", "near")}
    lengths = np.zeros(6)
    begun = np.zeros(6, dtype=bool)
    generator = np.random.default_rng(0)
    reported = 0
    for _ in range(300):
        actions = generator.uniform(-1.0, 2.0, (6, 3)).astype(np.float32)
        _, rewards, terminated, truncated, infos = env.step(actions)
        told = plain.step([np.where(begun[:, None], 0.0, actions)[:, None]]).groups[0]
        ended = told.terminated[:, 0] | told.truncated[:, 0]
        np.testing.assert_array_equal(rewards, np.where(begun, 0.0, told.reward[:, 0]))
        np.testing.assert_array_equal(terminated | truncated, ended)
        lengths += ~begun
        for name, total in sums.items():
            total += told.terms[name][:, 0]
        assert infos == {}
        assert sorted(env.reports) == np.flatnonzero(ended).tolist()
        for row, report in env.reports.items():
            assert report["success_rate"] == terminated[row]
            assert report["length"] == lengths[row]
            assert report["delta_v"] == plain.state.delta_v[row, 0]
            assert report["return"] == pytest.approx(sums["cost"][row] + sums["near"][row], abs=1e-12)
            for name, total in sums.items():
                assert report[f"reward/{name}"] == pytest.approx(total[row], abs=1e-12)
                total[row] = 0.0
            lengths[row] = 0.0
            reported += 1
        if begun.any():
            plain.reset(np.flatnonzero(begun))
        begun = ended
    assert reported > 20


def test_the_states_of_an_error_are_saved_in_the_run(tmp_path, monkeypatch):
    from safe_inspect.environments.finite_checks import CRASH_FOLDER_VARIABLE
    from safe_inspect.experiments.sampling.environment import reported

    monkeypatch.delenv(CRASH_FOLDER_VARIABLE, raising=False)
    config = {"failure_file": str(tmp_path / "run" / "failure.json")}
    with reported(config):
        assert os.environ[CRASH_FOLDER_VARIABLE] == str(tmp_path / "run")
    assert CRASH_FOLDER_VARIABLE not in os.environ
    monkeypatch.setenv(CRASH_FOLDER_VARIABLE, "theirs")
    with reported(config):
        assert os.environ[CRASH_FOLDER_VARIABLE] == "theirs"
    assert os.environ[CRASH_FOLDER_VARIABLE] == "theirs"


def test_a_users_error_is_left_in_a_file(tmp_path):
    file = tmp_path / "failure.json"
    env = build(failure_file=str(file), experiment={"fail_at": 2})
    env.reset()
    env.step(np.zeros((4, 3), np.float32))
    with pytest.raises(PluginValueError):
        env.step(np.zeros((4, 3), np.float32))
    assert json.loads(file.read_text())["error"] == "PluginValueError"
