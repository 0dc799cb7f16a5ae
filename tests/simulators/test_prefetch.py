"""Initial states that are drawn before they are needed are those that would be drawn at the reset itself."""

from __future__ import annotations

import numpy as np
import pytest

from safe_inspect.config.data import configs_root
from safe_inspect.environments import TeamEnvironment, load_spec

TEAM = configs_root() / "multiagent-translational-inspection" / "experiment-seed.yml"


@pytest.fixture(scope="module")
def spec():
    return load_spec(TEAM)


def beginnings(env: TeamEnvironment, rows: np.ndarray) -> dict[str, np.ndarray]:
    observation = env.reset(rows)[0]
    told = {name: array[rows].copy() for name, array in env.state.arrays.items()}
    facts = {name: array[rows].copy() for name, array in env.simulation.reset_info.items()}
    return told | facts | {"observation": observation, "episode": env.simulation.episodes[rows].copy()}


def test_a_partial_reset_begins_what_a_whole_one_would(spec):
    whole, partial = (TeamEnvironment(spec, 12, seed=5) for _ in range(2))
    whole.reset()
    partial.reset()
    generator = np.random.default_rng(2)
    expected = [beginnings(whole, np.arange(12)) for _ in range(6)]
    for _ in range(40):
        open_rows = np.flatnonzero(partial.simulation.episodes < 6)
        if not len(open_rows):
            break
        rows = np.sort(generator.choice(open_rows, min(3, len(open_rows)), replace=False))
        numbers = partial.simulation.episodes[rows] + 1
        for name, array in beginnings(partial, rows).items():
            if name == "delta_v_scale":
                continue
            for place, (row, number) in enumerate(zip(rows, numbers, strict=True)):
                np.testing.assert_array_equal(array[place], expected[number - 1][name][row], err_msg=name)
    assert not len(np.flatnonzero(partial.simulation.episodes < 6))


def test_a_seed_or_a_whole_reset_forgets_what_was_drawn(spec):
    used, fresh = TeamEnvironment(spec, 6, seed=1), TeamEnvironment(spec, 6, seed=9)
    used.reset()
    used.reset(np.array([0, 2]))  # the others' second episodes of seed 1 are drawn now
    used.reset(seed=9)
    fresh.reset()
    rows = np.array([1, 3])
    np.testing.assert_array_equal(used.reset(rows)[0], fresh.reset(rows)[0])
    used.reset()
    fresh.reset()
    np.testing.assert_array_equal(used.reset(rows)[0], fresh.reset(rows)[0])
