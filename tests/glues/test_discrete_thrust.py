"""Thrust in levels: the action is an index, its space MultiDiscrete, its thrust the level's."""

from __future__ import annotations

import re

import gymnasium
import numpy as np
import pytest
from gymnasium.spaces import MultiDiscrete
from gymnasium.utils.env_checker import check_env

import safe_inspect
from safe_inspect.config.data import configs_root
from safe_inspect.config.experiment import load_experiment
from safe_inspect.environments import BatchedEnvironment
from safe_inspect.errors import ConfigError

EXPERIMENT = configs_root() / "translational-inspection" / "experiment.yml"
TEAM = configs_root() / "multiagent-translational-inspection" / "experiment.yml"
WRAPPED = "RTAGlueCWHInspection1v1.wrapped"


def glue(axis, levels):
    return f"{{functor: DiscreteControllerGlue, config: {{controller: {axis} Thrust, levels: {levels}}}}}"


def environment(*overrides, num_envs=6):
    return BatchedEnvironment(load_experiment(EXPERIMENT, overrides).spec, num_envs, seed=3)


def test_an_index_is_a_level():
    batch = environment()
    batch.reset()
    assert batch.action_layout.choices == (3, 3, 3)
    assert str(batch.action_layout).splitlines()[0] == "  X Thrust  one of 3"
    actions = np.array([[0, 1, 2], [2, 2, 2], [1, 1, 1], [0, 2, 1], [-0.0, 2, 1], [0, 0, 0]], dtype=float)
    step = batch.step(actions[:, None])
    expected = 0.1 * np.array([[-1, 0, 1], [1, 1, 1], [0, 0, 0], [-1, 1, 0], [-1, 1, 0], [-1, -1, -1]])
    np.testing.assert_array_equal(batch.state.control[:, 0], expected)
    spent = np.abs(expected).sum(axis=1) / 12.0 * 10.0
    np.testing.assert_allclose(step.step.delta_v, spent, rtol=1e-12)


def test_unequal_levels_and_the_order_of_the_axes():
    batch = environment(
        f"{WRAPPED}.0={glue('Z', '[-1, -0.1, 0, 0.2]')}",
        f"{WRAPPED}.1={glue('X', '[0, 100 mN]')}",
        f"{WRAPPED}.2={glue('Y', '[-0.5, 0.5]')}",
        num_envs=4,
    )
    batch.reset()
    assert batch.action_layout.choices == (4, 2, 2)
    batch.step(np.array([[0, 0, 0], [1, 1, 1], [2, 0, 1], [3, 1, 0]], dtype=float)[:, None])
    expected = [[0, -0.5, -1], [0.1, 0.5, -0.1], [0, 0.5, 0], [0.1, -0.5, 0.2]]
    np.testing.assert_allclose(batch.state.control[:, 0], expected, rtol=1e-15)


def test_one_call_for_all_axes_gives_what_the_glues_give():
    batch = environment()
    (group,) = batch.team.groups
    actions = np.random.default_rng(0).integers(0, 3, (50, 3)).astype(float)
    alone = sum(each(actions[:, columns], group.agent.parts) for each, columns in group.thrusters.commands)
    np.testing.assert_array_equal(group.thrusters(actions), alone)


def test_the_safety_filter_takes_levels():
    batch = environment("RTAGlueCWHInspection1v1.config.enabled=True")
    batch.reset()
    rng = np.random.default_rng(1)
    for _ in range(30):
        step = batch.step(rng.integers(0, 3, (6, 1, 3)).astype(float))
    assert np.isfinite(step.observation).all()


@pytest.mark.parametrize("value", [7, -1, 3, 1e300, 0.5, 1.5, -1e-9])
def test_an_action_that_is_no_index_is_refused(value):
    """Clipped or rounded, it would be another action than the one that was meant."""
    bad = np.array([1, value, 2], dtype=float)
    valid = np.array([1, 0, 2])
    shown = re.escape(f"{value:g}")
    message = rf"the action of blue\d?_ctrl .*`Y Thrust` is {shown}, but must be a whole number from 0 to 2"
    single = safe_inspect.make(EXPERIMENT)
    single.reset(seed=0)
    vector = safe_inspect.make_vec(EXPERIMENT, num_envs=4)
    vector.reset(seed=0)
    parallel = safe_inspect.make_parallel(TEAM)
    parallel.reset(seed=0)
    last = parallel.agents[-1]
    batch = safe_inspect.make_parallel_vec(TEAM, num_envs=4)
    batch.reset(seed=0)
    core = environment(num_envs=4)
    core.reset()
    third = np.stack([valid, valid, bad, valid])
    calls = [
        lambda: single.step(bad),
        lambda: vector.step(third),
        lambda: parallel.step({agent: bad if agent == last else valid for agent in parallel.agents}),
        lambda: batch.step({agent: third if agent == last else np.tile(valid, (4, 1)) for agent in batch.agents}),
        lambda: core.step(third[:, None]),
    ]
    for call, where in zip(calls, (0, 2, 0, 2, 2), strict=True):
        with pytest.raises(ValueError, match=message) as caught:
            call()
        assert f"in environment {where}:" in str(caught.value)
        if call in calls[2:4]:
            assert last in str(caught.value)
    for env in (single, vector, parallel, batch):  # a refused action leaves no trace
        state = env.core.state
        assert (state.step == 0).all()
    single.step(valid)


def test_gymnasium_and_pettingzoo_have_discrete_spaces():
    single = safe_inspect.make(EXPERIMENT)
    assert single.action_space == MultiDiscrete([3, 3, 3])
    check_env(single, skip_render_check=True)
    many = safe_inspect.make_vec(EXPERIMENT, num_envs=4)
    assert isinstance(many, gymnasium.vector.VectorEnv)
    many.reset(seed=0)
    many.step(many.action_space.sample())
    team = safe_inspect.make_parallel(TEAM)
    team.reset(seed=0)
    assert {agent: team.action_space(agent) for agent in team.agents} == dict.fromkeys(
        team.agents, MultiDiscrete([3, 3, 3])
    )
    team.step({agent: team.action_space(agent).sample() for agent in team.agents})


@pytest.mark.parametrize(
    ("override", "expected"),
    [
        (f"{WRAPPED}.0={glue('X', '[0.1, 0, -0.1]')}", "must be in ascending order"),
        (f"{WRAPPED}.0={glue('X', '[0.1]')}", "at least 2"),
        (f"{WRAPPED}.0={glue('X', '[-2, 0, 2]')}", "exceeds the range of 'X Thrust', -1 to 1 N"),
        (f"{WRAPPED}.0={glue('X', '[-0.1 m, 0, 1]')}", "N"),
        (f"{WRAPPED}.0={{functor: ControllerGlue, config: {{controller: X Thrust}}}}", "use one kind for all"),
    ],
    ids=["order", "number", "limits", "unit", "mixed"],
)
def test_bad_levels(override, expected):
    with pytest.raises(ConfigError, match=expected):
        load_experiment(EXPERIMENT, [override])


def test_the_direction_of_the_sun():
    batch = environment()
    seen = batch.reset()[:, 0]
    names = batch.observation_layout.names
    columns = [names.index(f"Sensor_SunDirection.{axis}_sun") for axis in "xyz"]
    angle = batch.state.sun_angle
    expected = np.stack((np.cos(angle), -np.sin(angle), np.zeros_like(angle)), axis=1)
    np.testing.assert_allclose(seen[:, columns], expected, atol=1e-6)
