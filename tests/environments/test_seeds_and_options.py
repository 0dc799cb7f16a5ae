"""Unseeded environments differ, the seed that they draw repeats their episodes, and unknown options are refused."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
import pytest

from safe_inspect.config.experiment import load_experiment
from safe_inspect.environments import (
    InspectionEnv,
    InspectionVectorEnv,
    MultiAgentVectorEnv,
    load_spec,
    make,
    make_parallel,
    make_parallel_vec,
    make_vec,
)
from safe_inspect.errors import ArgumentError
from safe_inspect.task_ids import TASKS, TEAM_TASKS

TASK, TEAM = next(iter(TASKS)), next(iter(TEAM_TASKS))

MAKERS: dict[str, Callable[[], Any]] = {
    "single": lambda: make(TASK),
    "registered": lambda: gymnasium.make(TASK).unwrapped,
    "vector": lambda: make_vec(TASK, 3),
    "parallel": lambda: make_parallel(TEAM),
    "parallel vector": lambda: make_parallel_vec(TEAM, 3),
}
each = pytest.mark.parametrize("maker", MAKERS.values(), ids=MAKERS)


def first(env: Any, **kwargs: Any) -> np.ndarray:
    observation = env.reset(**kwargs)[0]
    return np.stack(list(observation.values())) if isinstance(observation, dict) else np.array(observation)


@each
def test_unseeded_environments_differ_and_name_their_seed(maker):
    env, other = maker(), maker()
    one, two = first(env), first(other)
    assert not np.array_equal(one, two)
    assert env.np_random_seed != other.np_random_seed
    assert isinstance(env.np_random_seed, int)
    following = first(env)  # the next episode, not another seed
    seed = env.np_random_seed
    again = maker()
    np.testing.assert_array_equal(first(again, seed=seed), one)
    assert again.np_random_seed == seed
    np.testing.assert_array_equal(first(again), following)
    assert again.np_random_seed == seed
    np.testing.assert_array_equal(first(other, seed=seed), one)  # a seed counts at any time


@pytest.mark.parametrize("mode", ["sync", "vector_entry_point"])
def test_the_environments_of_a_vector_differ(mode):
    """As `DummyVecEnv` does, Gymnasium's own vector makes them one by one and seeds none."""
    seen = [gymnasium.make_vec(TASK, num_envs=4, vectorization_mode=mode).reset()[0] for _ in range(2)]
    assert len(np.unique(np.concatenate(seen), axis=0)) == 8


def test_a_seed_given_when_made_is_that_of_the_first_reset(shipped):
    spec = load_experiment(shipped).spec
    seeded, plain = InspectionVectorEnv(spec, 3, seed=8), InspectionVectorEnv(spec, 3)
    np.testing.assert_array_equal(first(seeded), first(plain, seed=8))
    assert seeded.np_random_seed == plain.np_random_seed == 8
    np.testing.assert_array_equal(first(seeded), first(plain))
    team = load_spec(TEAM)
    several = [MultiAgentVectorEnv(team, 3, seed=8), MultiAgentVectorEnv(team, 3)]
    np.testing.assert_array_equal(first(several[0]), first(several[1], seed=8))
    assert several[0].np_random_seed == several[1].np_random_seed == 8


def test_unknown_options_are_refused(shipped):
    spec = load_experiment(shipped).spec
    single = InspectionEnv(spec)
    with pytest.raises(ArgumentError, match=r"the options \['sun_angle'\] are unknown; it takes none"):
        single.reset(options={"sun_angle": 1.0})
    single.reset(options={})
    for env in (InspectionVectorEnv(spec, 2), make_parallel_vec(TEAM, 2)):
        with pytest.raises(ArgumentError, match=r"\['reset_masks'\] are unknown; it takes 'reset_mask' alone"):
            env.reset(options={"reset_masks": np.array([True, False])})
        env.reset(options={})


@pytest.mark.parametrize(
    "mask",
    [np.ones(3, dtype=bool), np.array([0, 5]), np.ones((6, 1), dtype=bool), np.ones(6), np.array(True)],
    ids=["short", "indices", "column", "floats", "scalar"],
)
@pytest.mark.parametrize("maker", [lambda: make_vec(TASK, 6), lambda: make_parallel_vec(TEAM, 6)], ids=["one", "team"])
def test_a_mask_is_one_bool_for_each_environment(maker, mask):
    env = maker()
    before = first(env, seed=1)
    with pytest.raises(ArgumentError, match=r"give one bool for each environment, shape \(6,\)"):
        env.reset(options={"reset_mask": mask})
    some = np.array([True, False, False, True, False, False])
    after = first(env, options={"reset_mask": some})
    rows = (before != after).any(axis=-1)
    np.testing.assert_array_equal(rows if rows.ndim == 1 else rows.any(axis=0), some)


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_infos_have_gymnasiums_masks(mode):
    vector = make_vec(next(iter(TASKS)), 3, ["horizon=4"], autoreset_mode=mode)
    _, infos = vector.reset(seed=1)
    told = []
    for _ in range(9):
        for name in [name for name in infos if not name.startswith(("_", "final_"))]:
            assert infos[f"_{name}"].shape == (3,)
            assert infos[f"_{name}"].all() or name.startswith("rejections/")
        told.append(bool(infos.get("_rejections/draws", np.zeros(3)).any()))
        assert mode == "NextStep" or "rejections/draws" in infos  # TorchRL wants the names of the first reset
        infos = vector.step(np.zeros((3, 3), dtype=np.float32))[4]
        if told[-1] and len(told) > 1:
            assert "_delta_v" in infos
    ends = [0, 5] if mode == "NextStep" else [0, 4, 8]
    assert [index for index, began in enumerate(told) if began] == ends
