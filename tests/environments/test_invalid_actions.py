"""Actions that are NaN or infinite: an error, or, if the filter is configured so, the backup of that row alone."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

import safe_inspect
from safe_inspect.config.data import configs_root
from safe_inspect.config.experiment import load_experiment
from safe_inspect.environments import InspectionEnv, InspectionVectorEnv, TeamEnvironment
from safe_inspect.environments.episodes import transition_info
from safe_inspect.errors import ArgumentError, PluginValueError, SafeInspectError
from safe_inspect.evaluation.rollouts import rollout
from safe_inspect.evaluation.task import default_metrics

ID = "safe_inspect/TranslationalInspectionSeed-v0"
GLUE = "agent_config.blue0_ctrl.config.config.glues.0.config"
ON = (f"{GLUE}.enabled=True", f"{GLUE}.invalid_actions=backup")
DISTURBANCE = "{velocity: 1e-4, position_error: 0.01, velocity_error: 1e-4, thrust_gain: 0.01, thrust_direction: 0.01}"


def spec(*overrides, task="translational-inspection/experiment-seed.yml"):
    return load_experiment(configs_root() / task, overrides).spec


def environments(*overrides, num_envs=6, **kwargs):
    """Return two equal environments, reset."""
    made = [TeamEnvironment(spec(*overrides, **kwargs), num_envs, seed=4) for _ in range(2)]
    for env in made:
        env.reset()
    return made


def test_without_the_option_it_is_an_error():
    for overrides in ((), ON[:1], ON[1:]):  # and where no filter is enabled
        env, _ = environments(*overrides)
        action = np.zeros((6, 1, 3))
        action[2, 0, 1] = np.nan
        with pytest.raises(PluginValueError, match="the action of blue0_ctrl gave"):
            env.step([action])


@pytest.mark.parametrize(("bad", "disturbed"), [(np.nan, False), (np.inf, False), (-np.inf, True)])
def test_the_row_flies_its_backup_and_the_others_what_they_ask_for(bad, disturbed):
    more = (f"{GLUE}.disturbance={DISTURBANCE}",) if disturbed else ()
    env, other = environments(*ON, *more)
    generator = np.random.default_rng(0)
    for hold in range(4):
        action = generator.uniform(-0.3, 0.3, (6, 1, 3))
        view, run = env.view(), env.groups[0].safety_filter
        backup = run.backup(view)[3]
        broken = action.copy()
        broken[3, 0, 1] = bad
        found, usual = env.step([broken]).groups[0], other.step([action]).groups[0]
        shown = transition_info(found)["rta/invalid_action"]
        np.testing.assert_array_equal(shown, np.arange(6) == 3)
        assert not transition_info(usual)["rta/invalid_action"].any()
        np.testing.assert_array_equal(found.step.desired_control[3], backup)
        np.testing.assert_allclose(found.step.control[3], backup, atol=0.05 if disturbed else 1e-9)
        assert not found.step.filtered.infeasible.any()
        rest = np.arange(6) != 3
        np.testing.assert_array_equal(found.step.control[rest], usual.step.control[rest])
        np.testing.assert_array_equal(env.state.position[rest], other.state.position[rest])
        if hold > 0 and not disturbed:  # on its closed motion the plan is to coast
            assert np.abs(found.step.control[3]).max() < 1e-6


def test_a_policy_that_fails_for_good_stays_safe():
    env, _ = environments(*ON, num_envs=32)
    glue = env.groups[0].safety_filter
    for _ in itertools.repeat(None, 40):
        found = env.step([np.full((32, 1, 3), np.nan)]).groups[0]
        assert not found.terminated.any()
        state = {name: env.state[name][:, 0] for name in ("position", "velocity")} | {"sun_angle": env.state.sun_angle}
        assert all((phi >= 0.0).all() for phi in glue.safety(state).values())


def test_discrete_actions_and_the_filter_of_a_team():
    team = "config.config.env_config.rta.config.invalid_actions=backup"
    env, other = environments(team, task="multiagent-translational-inspection/experiment.yml", num_envs=3)
    action = np.ones((3, 3, 3))  # no thrust
    broken = action.copy()
    broken[1, 2, 0] = np.nan
    found, usual = env.step([broken]), other.step([action])
    np.testing.assert_array_equal(
        transition_info(found.groups[0], found.filtered)["rta/invalid_action"], np.arange(9) == 5
    )
    np.testing.assert_array_equal(found.filtered.control, usual.filtered.control)
    np.testing.assert_array_equal(found.groups[0].step.action, usual.groups[0].step.action)


def test_the_facades_tell_of_it():
    one = InspectionEnv(spec(*ON))
    one.reset(seed=1)
    assert one.step(np.full(3, np.nan, np.float32))[4]["rta/invalid_action"] is True
    assert one.step(np.zeros(3, np.float32))[4]["rta/invalid_action"] is False
    many = InspectionVectorEnv(spec(*ON), 3)
    many.reset(seed=1)
    action = np.zeros((3, 3), np.float32)
    action[1] = np.inf
    np.testing.assert_array_equal(many.step(action)[4]["rta/invalid_action"], [False, True, False])


def test_an_evaluation_counts_them():
    task = spec(*ON, "horizon=5")
    metrics = default_metrics(task)
    episodes = rollout(task, lambda seen, *_: np.full((len(seen), 3), np.nan), 3, metrics=metrics)
    label = next(metric.label for metric in metrics if type(metric).__name__ == "InvalidActions")
    figures = next(iter(episodes.agents.values())).metrics
    np.testing.assert_array_equal(figures[label], 5.0)
    assert "InvalidActions" not in {type(metric).__name__ for metric in default_metrics(spec(ON[0]))}


def test_an_action_of_another_shape_is_reported_as_the_caller_sees_it():
    single, vector = safe_inspect.make(ID), safe_inspect.make_vec(ID, 2)
    single.reset(seed=0)
    vector.reset(seed=0)
    for action in ([1.0, 2.0], None, 0.0):
        with pytest.raises(ArgumentError, match=r"the action has the shape .*; expected \(3,\)"):
            single.step(action)
    with pytest.raises(ArgumentError, match=r"the array of actions has the shape \(3, 3\); expected \(2, 3\)"):
        vector.step(np.zeros((3, 3)))


@pytest.mark.parametrize("number", [0, -1, 2.5, "8"])
def test_a_number_of_environments_is_a_whole_one(number):
    with pytest.raises(ValueError, match=r"num_envs must be a whole number of at least 1, not "):
        safe_inspect.make_vec(ID, number)


@pytest.mark.parametrize(
    ("action", "shown"),
    [
        (None, r"has the shape \(\); expected \(3,\)"),
        ([0.0, 0.0], r"has the shape \(2,\); expected \(3,\)"),
        ([0.0, [0.0, 0.0], 0.0], r"is ragged; expected an array of the shape \(3,\)"),
        ([0.0, "x", 0.0], r"contains values that are not numbers \(.*\); expected numbers of the shape \(3,\)"),
        ([0.0, None, 0.0], r"contains values that are not numbers \(object\)"),
    ],
)
def test_what_is_no_array_of_numbers_is_refused(action, shown):
    one, several = safe_inspect.make(ID), safe_inspect.make_vec(ID, 1)
    one.reset(seed=0)
    several.reset(seed=0)
    with pytest.raises(ArgumentError, match=f"the action {shown}"):
        one.step(action)
    with pytest.raises(
        ArgumentError, match=r"the array of actions (has the shape|is ragged|contains values that are not numbers)"
    ):
        several.step(action if action is None else [action])
    named = safe_inspect.make_parallel(ID)
    named.reset(seed=0)
    with pytest.raises(SafeInspectError, match=f"actions: that for blue0_ctrl {shown.replace(';', ',')}"):
        named.step({"blue0_ctrl": action})
