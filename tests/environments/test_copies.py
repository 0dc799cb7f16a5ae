"""Copies and pickles of every façade, taken in mid-episode, fly bit-identically to the original."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable
from typing import Any

import cloudpickle
import gymnasium
import numpy as np
import pytest

import safe_inspect
from safe_inspect.config.data import configs_root
from safe_inspect.environments import TeamEnvironment
from safe_inspect.environments.fused_step import FusedGroup
from safe_inspect.environments.registration import load_spec
from safe_inspect.task_ids import TASKS, TEAM_TASKS

ONE, TEAM = next(iter(TASKS)), next(iter(TEAM_TASKS))
COPIERS: dict[str, Callable[[Any], Any]] = {
    "deepcopy": copy.deepcopy,
    "pickle": lambda env: pickle.loads(pickle.dumps(env)),
    "cloudpickle": lambda env: cloudpickle.loads(cloudpickle.dumps(env)),
}
FACADES: dict[str, Callable[[], Any]] = {
    "single": lambda: safe_inspect.make(ONE, ["horizon=12"]),
    "gymnasium": lambda: gymnasium.make(ONE, overrides=["horizon=12"]),
    "next_step": lambda: safe_inspect.make_vec(ONE, 3, ["horizon=12"]),
    "same_step": lambda: safe_inspect.make_vec(ONE, 3, ["horizon=12"], autoreset_mode="SameStep"),
    "parallel": lambda: safe_inspect.make_parallel(TEAM, ["horizon=12"]),
    "parallel_vec": lambda: safe_inspect.make_parallel_vec(TEAM, 3, ["horizon=12"]),
}
EXPERIMENTS = sorted(
    path.relative_to(configs_root()).as_posix() for path in configs_root().glob("*inspection/experiment*.yml")
)


def plain(value: Any) -> Any:
    """Return a result with its arrays as bytes, so that a comparison is exact."""
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, (tuple, list)):
        return [plain(item) for item in value]
    if isinstance(value, np.ndarray) and value.dtype == object:
        return [plain(item) for item in value]
    return (value.dtype.str, value.shape, value.tobytes()) if isinstance(value, np.ndarray) else value


def act(env: Any, generator: np.random.Generator) -> Any:
    """Return a random action of a façade, within its spaces."""
    spaces = env.action_spaces if hasattr(env, "action_spaces") else {"": env.action_space}
    if getattr(env, "num_envs", None) is None and hasattr(env, "action_spaces"):
        spaces = {agent: spaces[agent] for agent in env.agents}
    actions = {
        name: generator.uniform(space.low, space.high).astype(np.float32)
        if hasattr(space, "low")
        else generator.integers(0, space.nvec)
        for name, space in spaces.items()
    }
    return actions if hasattr(env, "action_spaces") else actions[""]


def fly(env: Any, steps: int, seed: int) -> list[Any]:
    """Return all that a façade gives in some steps, episodes that are over being reset."""
    generator, seen = np.random.default_rng(seed), []
    for _ in range(steps):
        _, _, terminated, truncated, _ = found = env.step(act(env, generator))
        seen.append(plain(found))
        over = (
            not env.agents
            if hasattr(env, "possible_agents")
            else np.ndim(terminated) == 0 and (terminated or truncated)
        )
        if over is True and not hasattr(env, "num_envs"):
            seen.append(plain(env.reset()))
    return seen


@pytest.mark.parametrize("copier", COPIERS)
@pytest.mark.parametrize("facade", FACADES)
def test_a_copy_taken_in_mid_episode_continues_as_the_original(facade, copier):
    env = FACADES[facade]()
    env.reset(seed=7)
    fly(env, 5, seed=1)
    copied = COPIERS[copier](env)
    mine = fly(copied, 30, seed=2)  # the copy first: the original must not notice
    assert mine == fly(env, 30, seed=2)
    assert plain(copied.reset(seed=3)) == plain(env.reset(seed=3))
    assert fly(copied, 15, seed=4) == fly(env, 15, seed=4)


@pytest.mark.parametrize("copier", COPIERS)
@pytest.mark.parametrize("experiment", EXPERIMENTS)
def test_every_shipped_task_is_copied(experiment, copier):
    env = TeamEnvironment(load_spec(configs_root() / experiment, ["horizon=8"]), 2, seed=5)
    env.reset()

    def step(env: TeamEnvironment, generator: np.random.Generator) -> bytes:
        shapes = [(2, group.size, group.action_layout.size) for group in env.acting]
        over = env.step([generator.integers(0, 2, shape).astype(float) for shape in shapes]).over
        if over.any():
            env.reset(np.flatnonzero(over))
        return b"".join(array.tobytes() for array in env.state.arrays.values())

    generator = np.random.default_rng(0)
    for _ in range(3):
        step(env, generator)
    copied = COPIERS[copier](env)
    twin = copy.deepcopy(generator)
    assert [step(copied, generator) for _ in range(12)] == [step(env, twin) for _ in range(12)]


def test_a_planner_that_copies_at_every_step_changes_nothing():
    env, undisturbed = (safe_inspect.make(ONE) for _ in range(2))
    assert plain(env.reset(seed=2)) == plain(undisturbed.reset(seed=2))
    generator = np.random.default_rng(0)
    for _ in range(20):
        actions = generator.uniform(-1, 1, (4, 3)).astype(np.float32)
        predicted = [plain(copy.deepcopy(env).step(action)) for action in actions]
        found = plain(env.step(actions[2]))
        assert found == predicted[2] == plain(undisturbed.step(actions[2]))


def test_copies_of_an_environment_that_was_never_reset():
    env = safe_inspect.make(ONE)
    assert plain(copy.deepcopy(env).reset(seed=1)) == plain(env.reset(seed=1))


def test_a_copy_has_its_own_memory():
    env = TeamEnvironment(load_spec(ONE), 2, seed=1)
    env.reset()
    copied = copy.deepcopy(env)
    states = (env.simulation.state, env.simulation.before, copied.simulation.state, copied.simulation.before)
    for index, state in enumerate(states):
        assert np.shares_memory(state.position, state.floats)
        assert not any(np.shares_memory(state.floats, other.floats) for other in states[:index])
    assert np.shares_memory(copied.simulation.state.key, copied.simulation.before.key)  # constant through an episode
    assert not np.shares_memory(copied.simulation.state.key, env.simulation.state.key)


def test_no_kernel_is_given_an_offset_outside_its_block():
    env = TeamEnvironment(load_spec(ONE), 2, seed=1)
    env.reset()
    state = env.state
    state.arrays["position"] = state.position.copy()
    with pytest.raises(ValueError, match="position does not lie in the common memory"):
        state.start("position")
    with pytest.raises(ValueError, match="position does not lie in the common memory"):
        FusedGroup(env.groups[0], env.simulation.world).observe(env.view())
    with pytest.raises(ValueError, match="key does not lie in the common memory"):
        state.start("key")


def test_supersuit_flies_the_same_environments():
    supersuit = pytest.importorskip("supersuit", reason="pip install 'safe_inspect[test]'")
    parallel = safe_inspect.make_parallel(TEAM)
    vector = supersuit.pettingzoo_env_to_vec_env_v1(safe_inspect.make_parallel(TEAM))
    several = supersuit.concat_vec_envs_v1(vector, 2, num_cpus=0, base_class="gymnasium")
    observations, _ = parallel.reset(seed=4)
    flown, _ = several.reset(seed=4)
    assert flown[:3].tobytes() == np.stack(list(observations.values())).tobytes()
    for _ in range(25):
        action = np.zeros((6, 3), dtype=np.float32)
        flown, reward, *_ = several.step(action)
        observations, rewards, *_ = parallel.step(dict(zip(parallel.agents, action, strict=False)))
        assert flown[:3].tobytes() == np.stack(list(observations.values())).tobytes()
        assert reward[:3].tolist() == pytest.approx(list(rewards.values()))
