"""Actions that are NaN or infinite, or of another shape, are errors."""

from __future__ import annotations

import numpy as np
import pytest

import safe_inspect
from safe_inspect.config.data import configs_root
from safe_inspect.config.experiment import load_experiment
from safe_inspect.environments import TeamEnvironment
from safe_inspect.errors import ArgumentError, PluginValueError, SafeInspectError

ID = "safe_inspect/TranslationalInspectionSeed-v0"
GLUE = "agent_config.blue0_ctrl.config.config.glues.0.config"


def spec(*overrides, task="translational-inspection/experiment-seed.yml"):
    return load_experiment(configs_root() / task, overrides).spec


def test_a_number_that_is_not_finite_is_an_error_with_and_without_a_filter():
    for overrides in ((), (f"{GLUE}.enabled=True",)):
        env = TeamEnvironment(spec(*overrides), 6, seed=4)
        env.reset()
        action = np.zeros((6, 1, 3))
        action[2, 0, 1] = np.nan
        with pytest.raises(PluginValueError, match="the action of blue0_ctrl gave"):
            env.step([action])


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
