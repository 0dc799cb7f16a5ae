"""Pictures of environments while they are stepped, single and vectorised, and Gymnasium's recorders."""

from __future__ import annotations

import copy

import gymnasium
import numpy as np
import pytest

import safe_inspect
from safe_inspect.errors import SafeInspectError

pytest.importorskip("PIL")

ID = "safe_inspect/TranslationalInspectionSeed-v0"
TEAM = "safe_inspect/MultiagentTranslationalInspectionSeed-v0"
BLUE, GREEN, BLACK = (0, 114, 178), (0, 158, 115), (34, 34, 34)


def pixels(picture, colour) -> int:
    return int((np.abs(picture.astype(int) - colour).max(axis=-1) < 12).sum())


def fly(environment, steps, seed=3, action=(0.05, 0.02, 0.0)):
    environment.reset(seed=seed)
    for _ in range(steps):
        environment.step(np.array(action, dtype=np.float32))


def test_a_picture_shows_the_way_and_the_thrust():
    environment = gymnasium.make(ID, render_mode="rgb_array")
    environment.reset(seed=3)
    first = environment.render()
    assert first.shape == (480, 480, 3)
    assert first.dtype == np.uint8
    fly(environment, 40)
    later = environment.render()
    assert pixels(later, BLUE) > pixels(first, BLUE) + 50
    assert pixels(later, BLACK) > pixels(first, BLACK) + 10
    np.testing.assert_array_equal(environment.render(), later)
    environment.reset(seed=3)
    np.testing.assert_array_equal(environment.render(), first)


def test_inspected_points_are_green():
    environment = safe_inspect.make(ID, render_mode="rgb_array")
    fly(environment, 100, action=(0.0, 0.0, 0.0))
    count = environment.step(np.zeros(3))[4]["inspected_count"]
    assert count > 25
    assert pixels(environment.render(), GREEN) > 30


def test_a_row_of_a_batch_looks_like_the_environment_alone():
    batch = safe_inspect.make_vec(ID, 3, autoreset_mode="SameStep", overrides=["horizon=12"], render_mode="rgb_array")
    alone = safe_inspect.make(ID, ["horizon=12"], slot=2, render_mode="rgb_array")
    actions = np.tile(np.float32([0.05, 0.02, 0.0]), (3, 1))
    batch.reset(seed=3)
    alone.reset(seed=3)
    for step in range(20):
        batch.step(actions)
        over = alone.step(actions[2])[2:4]
        if any(over):
            alone.reset()
        if step in (5, 12, 19):
            np.testing.assert_array_equal(batch.render()[2], alone.render())
    assert len(batch.render()) == 3


def test_gymnasium_records_frames():
    environment = gymnasium.wrappers.RenderCollection(gymnasium.make(ID, render_mode="rgb_array"))
    fly(environment, 5)
    assert [frame.shape for frame in environment.render()] == [(480, 480, 3)] * 6


def test_a_team_and_a_task_without_points_are_drawn():
    team = safe_inspect.make_parallel(TEAM, render_mode="rgb_array")
    team.reset(seed=1)
    for _ in range(5):
        team.step({agent: np.zeros(team.action_space(agent).shape) for agent in team.agents})
    assert pixels(team.render(), GREEN) > 30
    docking = safe_inspect.make("safe_inspect/Docking-v0", render_mode="rgb_array")
    docking.reset(seed=1)
    assert pixels(docking.render(), BLUE) > 30


def test_a_copy_draws_the_same():
    environment = safe_inspect.make(ID, render_mode="rgb_array")
    fly(environment, 5)
    other = copy.deepcopy(environment)
    np.testing.assert_array_equal(other.render(), environment.render())
    other.step(np.ones(3))
    assert (other.render() != environment.render()).any()


def test_what_cannot_be_rendered_is_reported():
    with pytest.raises(SafeInspectError, match="make the environment with render_mode='rgb_array'"):
        safe_inspect.make(ID).render()
    with pytest.raises(SafeInspectError, match=r"no episode has begun; call reset\(\) first"):
        safe_inspect.make(ID, render_mode="rgb_array").render()
    with pytest.raises(ValueError, match="render_mode must be rgb_array or None, not 'ansi'"):
        safe_inspect.make(ID, render_mode="ansi")


def test_the_usual_line_of_stable_baselines3():
    """`make_vec_env` asks for pictures first."""
    common = pytest.importorskip("stable_baselines3.common.env_util")
    environments = common.make_vec_env(ID, n_envs=2, seed=0)
    assert environments.reset().shape == (2, 11)
    assert environments.render().shape[-1] == 3
