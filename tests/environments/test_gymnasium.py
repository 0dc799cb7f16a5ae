"""The façades: Gymnasium's own checks, the autoreset modes against one another and against single environments."""

from __future__ import annotations

import warnings
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode

import safe_inspect
from safe_inspect.config.experiment import load_experiment
from safe_inspect.environments import InspectionEnv, InspectionVectorEnv, make_vec
from safe_inspect.errors import ConfigError, SafeInspectError

TASK = "safe_inspect/TranslationalInspectionSeed-v0"
SHORT = ("horizon=20",)
NUM_ENVS, STEPS, SEED = 5, 65, 77

#: Positions and velocities have no bounds, which the checker deems unusual.
HARMLESS = (
    "A Box observation space minimum value is",
    "A Box observation space maximum value is",
    "nothing is shown: render_mode",  # without a display
)


def actions() -> np.ndarray:
    """Thrusts that keep most slots near, and drive the slots 1 and 3 out of range before their time is over."""
    thrusts = np.random.default_rng(5).uniform(-1, 1, (STEPS, NUM_ENVS, 3)) * [[[0.02], [0.1], [0.3], [0.2], [0.1]]]
    thrusts[:, 1, 0] = thrusts[:, 3, 2] = 1.0
    return thrusts.astype(np.float32)


def singly(spec) -> list[tuple[InspectionEnv, np.ndarray, dict[str, Any]]]:
    """Return the same environments one by one, with their first observation and info."""
    flights = []
    for slot in range(NUM_ENVS):
        env = InspectionEnv(spec, slot=slot)
        observation, info = env.reset(seed=SEED)
        flights.append((env, observation, info))
    return flights


def same_info(one: dict[str, Any], many: dict[str, Any], row: int) -> None:
    for name, value in one.items():
        if name == "status":
            value = ["running", "win", "lose", "draw"].index(value)
        assert many[name][row] == value, name


@pytest.fixture(scope="module")
def spec(shipped):
    return load_experiment(shipped, SHORT).spec


def test_gymnasiums_checker_finds_nothing():
    env = gymnasium.make(TASK)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        check_env(env.unwrapped)
    messages = [str(warning.message) for warning in caught]
    assert [text for text in messages if not any(harmless in text for harmless in HARMLESS)] == []


def test_the_registered_environment():
    env = gymnasium.make(TASK)
    assert env.observation_space.shape == (11,)
    assert env.observation_space.dtype == np.float32
    np.testing.assert_array_equal(env.action_space.low, [-1, -1, -1])
    np.testing.assert_array_equal(env.action_space.high, [1, 1, 1])
    observation, info = env.reset(seed=3)
    assert observation in env.observation_space
    assert info["status"] == "running"
    observation, reward, _, _, info = env.step(np.array([0.5, 0.0, -0.5], dtype=np.float32))
    assert observation in env.observation_space
    assert type(reward) is float
    assert reward == pytest.approx(sum(value for name, value in info.items() if name.startswith("reward/")))
    assert {name for name in info if not name.startswith("reward/")} >= {
        "inspected_count", "inspected_fraction", "delta_v", "status",
    }  # fmt: skip
    assert info["delta_v"] == pytest.approx(1.0 / 12.0 * 10.0)
    assert info["inspected_count"] == round(info["inspected_fraction"] * 100)


def test_episodes_are_reproducible_by_their_seed():
    def fly(env, seed):
        seen = [env.reset(seed=seed)[0]]
        for thrust in actions()[:, 1]:
            observation, _, terminated, truncated, _ = env.step(thrust)
            seen.append(env.reset()[0] if terminated or truncated else observation)
        return np.stack(seen)

    one, two = safe_inspect.make(TASK, SHORT), safe_inspect.make(TASK, SHORT)
    first = fly(one, 4)
    np.testing.assert_array_equal(first, fly(two, 4))
    np.testing.assert_array_equal(first, fly(one, 4))
    assert not np.array_equal(first, fly(two, 5))


def test_an_ended_environment_must_be_reset(spec):
    env = InspectionEnv(spec)
    thrust = np.zeros(3, dtype=np.float32)
    with pytest.raises(SafeInspectError, match="reset"):
        env.step(thrust)
    env.reset(seed=0)
    while not any(env.step(thrust)[2:4]):
        pass
    with pytest.raises(SafeInspectError, match="reset"):
        env.step(thrust)
    env.reset()
    env.step(thrust)


def vector(mode: AutoresetMode) -> InspectionVectorEnv:
    env = gymnasium.make_vec(
        TASK,
        num_envs=NUM_ENVS,
        vectorization_mode="vector_entry_point",
        overrides=SHORT,
        autoreset_mode=mode,
    )
    assert env.metadata["autoreset_mode"] is mode
    assert env.unwrapped.num_envs == NUM_ENVS
    return env


def test_make_vec_steps_a_large_batch():
    env = gymnasium.make_vec(TASK, num_envs=1024, vectorization_mode="vector_entry_point")
    observation, _ = env.reset(seed=1)
    assert observation.shape == (1024, 11)
    assert observation in env.observation_space
    observation, reward, terminated, truncated, info = env.step(env.action_space.sample())
    assert observation in env.observation_space
    assert reward.shape == terminated.shape == truncated.shape == info["delta_v"].shape == (1024,)


def test_next_step_resets_in_a_separate_step(spec):
    env, flights = vector(AutoresetMode.NEXT_STEP), singly(spec)
    observation, info = env.reset(seed=SEED)
    ended = np.zeros(NUM_ENVS, dtype=bool)
    for slot, (_, first, told) in enumerate(flights):
        np.testing.assert_array_equal(observation[slot], first)
        same_info(told, info, slot)
    resets = 0
    for thrust in actions():
        observation, reward, terminated, truncated, info = env.step(thrust)
        for slot, (single, *_) in enumerate(flights):
            if ended[slot]:
                expected, told = single.reset()
                rest = (0.0, False, False)
                resets += 1
                assert all(info[name][slot] == 0.0 for name in info if name.startswith("reward/"))
            else:
                expected, *rest, told = single.step(thrust[slot])
            np.testing.assert_array_equal(observation[slot], expected)
            assert (reward[slot], terminated[slot], truncated[slot]) == tuple(rest)
            same_info(told, info, slot)
        ended = terminated | truncated
    assert resets > NUM_ENVS


def test_same_step_gives_the_end_in_final_obs(spec):
    env, flights = vector(AutoresetMode.SAME_STEP), singly(spec)
    env.reset(seed=SEED)
    ends = {"terminated": 0, "truncated": 0}
    for thrust in actions():
        observation, reward, terminated, truncated, info = env.step(thrust)
        ended = terminated | truncated
        assert ("final_obs" in info) == ended.any()
        for slot, (single, *_) in enumerate(flights):
            last, *rest, told = single.step(thrust[slot])
            assert (reward[slot], terminated[slot], truncated[slot]) == tuple(rest)
            for name in (name for name in told if name.startswith("reward/")):
                assert info[name][slot] == told[name]
            if ended[slot]:
                ends["terminated" if terminated[slot] else "truncated"] += 1
                assert info["_final_obs"][slot]
                assert info["_final_info"][slot]
                np.testing.assert_array_equal(info["final_obs"][slot], last)
                same_info(told, info["final_info"], slot)
                last, told = single.reset()
                same_info(told, info, slot)
            elif ended.any():
                assert not info["_final_obs"][slot]
                assert info["final_obs"][slot] is None
            np.testing.assert_array_equal(observation[slot], last)
    assert min(ends.values()) > 0


def test_disabled_waits_for_a_reset_mask(spec):
    env, flights = vector(AutoresetMode.DISABLED), singly(spec)
    env.reset(seed=SEED)
    resets = 0
    for thrust in actions():
        observation, reward, terminated, truncated, _ = env.step(thrust)
        ended = terminated | truncated
        for slot, (single, *_) in enumerate(flights):
            expected, *rest, _ = single.step(thrust[slot])
            np.testing.assert_array_equal(observation[slot], expected)
            assert (reward[slot], terminated[slot], truncated[slot]) == tuple(rest)
        if ended.any():
            resets += 1
            with pytest.raises(SafeInspectError, match=rf"\[{np.flatnonzero(ended)[0]}"):
                env.step(thrust)
            before = observation.copy()
            observation, info = env.reset(options={"reset_mask": ended})
            np.testing.assert_array_equal(observation[~ended], before[~ended])
            for slot in np.flatnonzero(ended):
                expected, told = flights[slot][0].reset()
                np.testing.assert_array_equal(observation[slot], expected)
                same_info(told, info, slot)
    assert resets > 2


def test_an_ended_environments_action_may_be_anything(spec):
    env = make_vec(TASK, 2, SHORT)
    env.reset(seed=0)
    for _ in range(20):
        *_, truncated, _ = env.step(np.zeros((2, 3), dtype=np.float32))
    assert truncated.all()
    env.step(np.full((2, 3), np.nan, dtype=np.float32))  # their reset


def test_stepping_before_the_first_reset_is_an_error():
    for mode in AutoresetMode:
        env = make_vec(TASK, 2, autoreset_mode=mode)
        with pytest.raises(SafeInspectError, match="call reset"):
            env.step(np.zeros((2, 3), dtype=np.float32))
        with pytest.raises(SafeInspectError, match="reset"):
            env.reset(options={"reset_mask": np.array([True, False])})


def test_seeds_of_a_vector():
    env, other = make_vec(TASK, 3), make_vec(TASK, 3)
    first, _ = env.reset(seed=8)
    np.testing.assert_array_equal(other.reset(seed=[8, 9, 10])[0], first)  # the list that Gymnasium makes of 8
    with pytest.raises(ValueError, match="one seed serves all"):
        env.reset(seed=[8, 8, 8])
    with pytest.raises(ValueError, match="not both"):
        env.reset(seed=8, options={"reset_mask": np.array([True, False, False])})


def test_the_answers_of_a_vector_are_its_callers_to_keep(spec):
    """No array that a step gives is written by a later one."""
    env = vector(AutoresetMode.NEXT_STEP)
    kept = [env.reset(seed=SEED)]
    for thrust in actions():
        kept.append(env.step(thrust))
    again = vector(AutoresetMode.NEXT_STEP)
    fresh = [again.reset(seed=SEED)]
    for step, thrust in enumerate(actions()):
        fresh.append(again.step(thrust))
        for one, other in zip(kept[step + 1][:4], fresh[-1][:4], strict=True):
            np.testing.assert_array_equal(one, other)
        for name, array in fresh[-1][-1].items():
            np.testing.assert_array_equal(kept[step + 1][-1][name], array)


def test_the_experiment_file_is_named_in_an_error(tmp_path):
    with pytest.raises(ConfigError, match="nothere"):
        safe_inspect.make(tmp_path / "nothere.yml")
