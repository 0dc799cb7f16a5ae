"""Baselines by name, scripted policies inside the environment, and who flies which agent."""

from __future__ import annotations

import numpy as np
import pytest

from safe_inspect.environments import TeamEnvironment
from safe_inspect.errors import SafeInspectError
from safe_inspect.evaluation import BASELINES, baseline, rollout, with_scripted
from safe_inspect.evaluation.policies import PolicyDispatcher, assign
from safe_inspect.policies import NaturalMotionInspector, RandomThrust, ScriptedPolicy, ZeroThrust


def nothing(observation):
    return np.zeros((len(observation), 3))


def test_every_baseline_can_be_had_by_its_name():
    assert all(isinstance(baseline(name), ScriptedPolicy) for name in BASELINES)
    assert baseline("zero-thrust") == baseline("ZeroThrust") == ZeroThrust()
    assert baseline("inspector") == NaturalMotionInspector()


@pytest.mark.parametrize(
    ("name", "message"), [("zero_thrust", "did you mean `ZeroThrust`"), ("nobody.knows", "no module 'nobody'")]
)
def test_an_unknown_baseline_lists_the_known_ones(name, message):
    with pytest.raises(SafeInspectError, match=message):
        baseline(name)


def test_scripted_agents_are_the_ones_that_are_named(team):
    spec = with_scripted(team, "random", ["blue1_ctrl"])
    assert [agent.scripted_policy for agent in spec.agents] == [None, RandomThrust(), None]
    assert [agent.scripted_policy for agent in with_scripted(spec, ZeroThrust()).agents] == [ZeroThrust()] * 3
    assert [agent.scripted_policy for agent in team.agents] == [None] * 3


def test_a_wrong_agent_or_body_is_one_message(team):
    with pytest.raises(SafeInspectError, match=r"no agent is named 'blue1'; did you mean `blue\d_ctrl`"):
        with_scripted(team, "random", ["blue1"])
    inspector = NaturalMotionInspector(inspection_entity_name="cheif")
    with pytest.raises(SafeInspectError, match=r"no body with inspection points is named 'cheif'; did you mean"):
        with_scripted(team, inspector)


def test_policies_and_agents_have_to_match(team):
    names = [agent.name for agent in team.agents]
    spec, flying = assign(team, {names[0]: nothing, names[1]: ZeroThrust(), names[2]: nothing})
    assert flying == {names[0]: nothing, names[2]: nothing}
    assert spec.agents[1].scripted_policy == ZeroThrust()
    assert assign(team, nothing)[1] == dict.fromkeys(names, nothing)
    with pytest.raises(SafeInspectError, match="no policy is given for blue1_ctrl, blue2_ctrl"):
        rollout(team, {names[0]: nothing})
    with pytest.raises(SafeInspectError, match=r"no agent is named 'blue3_ctrl'; did you mean"):
        rollout(team, dict.fromkeys([*names, "blue3_ctrl"], nothing))
    with pytest.raises(SafeInspectError, match="'blue1_ctrl' is controlled by the task's policy"):
        rollout(spec, dict.fromkeys(names, nothing))


def test_a_policy_that_flies_several_agents_is_asked_once_and_sees_the_rows_of_each(team):
    names = [agent.name for agent in team.agents]
    told, seen = [], []

    class Shared:
        def begin(self, flight):
            told.append((flight.slots.tolist(), flight.deputies.tolist()))

        def __call__(self, observation):
            seen.append(observation)
            return np.arange(12.0).reshape(4, 3)

    shared = Shared()
    environment = TeamEnvironment(team, 2, seed=1)
    observations = environment.reset()
    dispatcher = PolicyDispatcher(environment, {names[0]: shared, names[1]: nothing, names[2]: shared}, 5)
    actions = dispatcher(observations, [np.array([[True] * 3, [False] * 3])], np.arange(2), 0)
    assert told == [([5, 5, 6, 6], [0, 2, 0, 2])]
    np.testing.assert_array_equal(seen, [observations[0][:, [0, 2]].reshape(4, -1)])
    np.testing.assert_array_equal(actions[0], [[[0, 1, 2], [0, 0, 0], [3, 4, 5]], np.zeros((3, 3))])
