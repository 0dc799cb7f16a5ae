"""Rollouts of several deputies: the figures of the team and of every agent."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest

from safe_inspect.dones import DoneStatus
from safe_inspect.environments import TeamEnvironment
from safe_inspect.evaluation import Evaluation, evaluation_table, rollout
from safe_inspect.policies import RandomThrust, ZeroThrust

WHOLE = ("returns", "length", "status", "inspected_fraction", "delta_v", "closest")
OWN = ("returns", "length", "status", "own_inspected_count", "delta_v")
TRACKS = ("time", "position", "velocity", "control", "delta_v", "sun_angle", "inspected_at", "inspector")


def steady(observation):
    """Thrust by what is seen, so that rows and agents differ."""
    return np.tanh(observation[:, :3] * -0.3) * 0.3


@pytest.fixture(scope="module")
def flown(team):
    return rollout(team, steady, episodes=7, seed=4, num_envs=7, record=7)


def test_the_episodes_do_not_depend_on_the_size_of_the_batch_nor_on_who_shares_a_policy(team, flown):
    each = {agent.name: lambda observation: steady(observation) for agent in team.agents}
    parts = rollout(team, each, episodes=7, seed=4, num_envs=3, record=7)
    assert len(set(flown.length)) > 1
    for name in WHOLE:
        np.testing.assert_array_equal(getattr(parts, name), getattr(flown, name))
    for agent, figures in flown.agents.items():
        for name in OWN:
            np.testing.assert_array_equal(getattr(parts.agents[agent], name), getattr(figures, name))
    for one, other in zip(flown.trajectories, parts.trajectories, strict=True):
        for name in TRACKS:
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


def test_the_team_is_its_agents(team, flown):
    agents = list(flown.agents.values())
    assert list(flown.agents) == [agent.name for agent in team.agents]
    np.testing.assert_allclose(flown.returns, sum(agent.returns for agent in agents), rtol=1e-12)
    np.testing.assert_allclose(flown.delta_v, np.mean([agent.delta_v for agent in agents], axis=0), rtol=1e-12)
    np.testing.assert_allclose(
        flown.inspected_fraction * 100, sum(agent.own_inspected_count for agent in agents), rtol=1e-12
    )
    np.testing.assert_array_equal(flown.length, np.max([agent.length for agent in agents], axis=0))
    for agent in agents:
        np.testing.assert_allclose(sum(agent.terms.values()), agent.returns, rtol=1e-12)
    for name, values in flown.terms.items():
        np.testing.assert_allclose(values, sum(agent.terms[name] for agent in agents), rtol=1e-12)


def test_an_episode_is_that_of_the_environment_stepped_by_hand(team, flown):
    environment = TeamEnvironment(team, 1, seed=4, first_slot=2)
    (observation,) = environment.reset()
    returns, lengths, closest = np.zeros(3), np.zeros(3, dtype=int), environment.team().distance.min()
    while True:
        transition = environment.step([steady(observation[0])[None]])
        group = transition.groups[0]
        observation = group.observation
        returns, lengths = returns + group.reward[0], lengths + group.active[0]
        closest = min(closest, environment.team().distance.min())
        if transition.over[0]:
            break
    state = environment.state
    assert (flown.status[2], flown.closest[2]) == (transition.outcome[0], closest)
    for index, agent in enumerate(flown.agents.values()):
        assert (agent.returns[2], agent.length[2]) == (returns[index], lengths[index])
        assert (agent.status[2], agent.delta_v[2]) == (state.finished[0, index], state.delta_v[0, index])
        assert agent.own_inspected_count[2] == state.points["chief"].own_count[0, index]


def test_a_recording_agrees_with_the_figures_of_its_episode(flown):
    for row, one in enumerate(flown.trajectories):
        assert one.position.shape == (flown.length[row] + 1, 3, 3)
        apart = one.position[:, [0, 0, 1]] - one.position[:, [1, 2, 2]]
        assert flown.closest[row] == pytest.approx(np.linalg.norm(apart, axis=-1).min(), rel=1e-12)
        counts = np.bincount(one.inspector + 1, minlength=4)
        assert counts[0] == 100 - np.isfinite(one.inspected_at).sum()
        assert counts[1:].tolist() == [agent.own_inspected_count[row] for agent in flown.agents.values()]


def test_a_scripted_policy_flies_as_its_equal_from_outside(team):
    """No thrust from inside and from outside is one flight; a task of scripted agents alone ends when all have."""
    inside = rollout(team, ZeroThrust(), episodes=3, seed=2)
    outside = rollout(team, lambda observation: np.zeros((len(observation), 3)), episodes=3, seed=2)
    mixed = rollout(team, {agent.name: ZeroThrust() for agent in team.agents}, episodes=3, seed=2)
    for name in WHOLE:
        np.testing.assert_array_equal(getattr(inside, name), getattr(outside, name))
        np.testing.assert_array_equal(getattr(inside, name), getattr(mixed, name))


def test_a_crash_into_each_other_is_lost(team):
    hit = rollout(team, RandomThrust(), episodes=40, seed=3)
    together = hit.closest < 10.0
    assert together.any()
    assert (hit.status[together] == DoneStatus.LOSE).all()


def test_the_table_has_a_block_for_each_agent(flown):
    found = Evaluation.of("", flown)
    lines = evaluation_table(found).splitlines()
    assert [line.partition(":")[0] for line in lines if not line.startswith("  ")][1:] == list(flown.agents)
    assert any(line.startswith("  closest deputies") for line in lines)
    told = json.loads(json.dumps(found.as_dict(), allow_nan=False))
    first = next(iter(flown.agents))
    assert told["agents"][first]["figures"]["inspected first"]["mean"] == flown.agents[first].own_inspected_count.mean()
    alone = Evaluation.of("", dataclasses.replace(flown, agents={first: flown.agents[first]}, closest=None))
    assert "agents" not in alone.as_dict()
