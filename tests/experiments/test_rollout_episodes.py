"""Episodes that hold arrays behave as RLlib's own that were made of the same values."""

from __future__ import annotations

import copy
import pickle

import gymnasium
import numpy as np
import pytest
from ray.rllib.env.multi_agent_episode import MultiAgentEpisode
from ray.rllib.env.single_agent_episode import SingleAgentEpisode

from safe_inspect.experiments.learning.ppo_batch import batches_of
from safe_inspect.experiments.sampling.rollout_episodes import (
    EpisodePart,
    RolloutEpisode,
    RolloutTeamEpisode,
    part_of_episode,
)

SPACES = (
    gymnasium.spaces.Box(np.full(4, -9.0, np.float32), np.full(4, 9.0, np.float32)),
    gymnasium.spaces.Box(np.full(2, -1.0, np.float32), np.full(2, 1.0, np.float32)),
)
CHOICES = (SPACES[0], gymnasium.spaces.MultiDiscrete([3, 3]))


def part(steps=5, seed=0, ended=True, **more):
    """Return steps of an agent with random values."""
    generator = np.random.default_rng(seed)

    def values(*shape):
        return generator.normal(size=shape).astype(np.float32)

    given = {
        "observations": values(steps + 1, 4),
        "final": values(4) if ended else None,
        "actions": values(steps, 2),
        "inputs": values(steps, 4),
        "log_probabilities": values(steps),
        "rewards": values(steps),
        "terminated": ended,
        "weights": 7,
    }
    return EpisodePart(**{**given, **more})


def stock(one, spaces=SPACES, begun=3, **more):
    """Return RLlib's own episode of the same values."""
    actions = one.actions.astype(spaces[1].dtype)
    outputs = {"weights_seq_no": np.full(len(one), 7)}
    if one.inputs is not None:
        outputs |= {"action_dist_inputs": one.inputs, "action_logp": one.log_probabilities}
    return SingleAgentEpisode(
        "name",
        observations=one.whole_observations,
        observation_space=spaces[0],
        infos=[{}] * (len(one) + 1),
        actions=actions,
        action_space=spaces[1],
        rewards=one.rewards,
        terminated=one.terminated,
        extra_model_outputs=outputs,
        t_started=begun,
        len_lookback_buffer=0,
        **more,
    )


def assert_same(mine, theirs):
    found, expected = mine.get_state(), theirs.get_state()
    assert found.keys() == expected.keys()
    np.testing.assert_equal(found, expected)
    assert len(mine) == len(theirs)
    assert mine.env_steps() == theirs.env_steps()
    assert mine.is_done == theirs.is_done
    assert mine.get_return() == theirs.get_return()


@pytest.mark.parametrize("spaces", [SPACES, CHOICES], ids=["thrust", "levels"])
@pytest.mark.parametrize("ended", [True, False])
@pytest.mark.parametrize("drawn", [True, False])
def test_an_episode_becomes_that_of_rllib(spaces, ended, drawn):
    more = {} if drawn else {"inputs": None, "log_probabilities": None}
    one = part(ended=ended, actions=np.ones((5, 2), dtype=np.float32), **more)
    mine = RolloutEpisode(one, "name", spaces, 3, False)
    assert len(mine) == mine.env_steps() == 5
    assert mine.part is one, "its length does not make it whole"
    assert_same(mine, stock(one, spaces))
    assert mine.part is None
    assert mine.get_actions().dtype == spaces[1].dtype
    assert_same(mine[1:3], stock(one, spaces)[1:3])


def test_what_is_set_before_it_is_whole_holds():
    mine = RolloutEpisode(part(), "name", SPACES, 3, False)
    assert part_of_episode(mine).terminated
    mine.is_terminated, mine.is_truncated = False, True
    assert mine.part is not None
    assert not part_of_episode(mine).terminated
    mine.custom_data["mark"] = 1
    assert (mine.is_terminated, mine.is_truncated, mine.custom_data) == (False, True, {"mark": 1})
    with pytest.raises(AttributeError, match="has no attribute 'reward'"):
        _ = mine.reward


def test_the_learner_takes_what_somebody_has_changed():
    one = part()
    mine = RolloutEpisode(one, "name", SPACES, 3, False)
    untouched = batches_of([mine], lambda name: True)["default_policy"]
    np.testing.assert_array_equal(untouched.rewards, one.rewards)
    mine.rewards[:] = np.zeros(5, dtype=np.float32)
    changed = batches_of([mine], lambda name: True)["default_policy"]
    np.testing.assert_array_equal(changed.rewards, np.zeros(5))
    for name in ("all_observations", "actions", "inputs", "log_probabilities", "lengths", "terminated", "weights"):
        np.testing.assert_array_equal(getattr(changed, name), getattr(untouched, name))
        np.testing.assert_array_equal(
            getattr(batches_of([stock(one)], lambda name: True)["default_policy"], name), getattr(untouched, name)
        )


@pytest.mark.parametrize("whole", [True, False])
@pytest.mark.parametrize("copied", [copy.deepcopy, lambda one: pickle.loads(pickle.dumps(one))], ids=["copy", "pickle"])
def test_episodes_travel(whole, copied):
    one = part()
    mine = RolloutEpisode(one, "name", SPACES, 3, False)
    if whole:
        mine.get_return()
    found = copied(mine)
    assert (found.part is None) == whole
    assert_same(found, stock(one))


def test_a_piece_that_travels_takes_its_own_steps_alone():
    """The arrays of a rollout are large, and a piece is a view of them."""
    rollout = np.zeros((1000, 5000, 4), dtype=np.float32)
    mine = RolloutEpisode(part(observations=rollout[0, :6]), "name", SPACES, 3, False)
    assert len(pickle.dumps(mine)) < 10_000
    long = RolloutEpisode(part(2000), "name", SPACES, 3, False)
    before = len(pickle.dumps(long))
    assert long.get_return() != 0.0
    assert len(pickle.dumps(long)) < 1.5 * before, "an episode that has become whole holds its arrays once"


def team(whole=False):
    """Return an episode of two agents, one of which ended before the other, and its parts."""
    parts = {"a": part(5, 1), "b": part(3, 2, False, terminated=True)}
    modules = {"a": "one", "b": "two", "c": "one"}
    spaces = dict.fromkeys(modules, SPACES)
    agents = {
        agent: RolloutEpisode(one, f"name-{agent}", SPACES, 3, False, (agent, modules[agent], "name"))
        for agent, one in parts.items()
    }
    found = RolloutTeamEpisode(agents, "name", (3, 8), (True, False), spaces, modules, mapping)
    if whole:
        assert found.get_return() != 0.0
        assert found.env_t_to_agent_t
    return found, parts


def mapping(agent, episode, **kwargs):
    return {"a": "one", "b": "two"}.get(agent, "one")


def test_an_episode_of_several_agents_becomes_that_of_rllib():
    mine, parts = team()
    assert len(mine) == mine.env_steps() == 5
    assert mine.agent_steps() == 8
    assert all(agent.part is not None for agent in mine.agent_episodes.values())
    theirs = MultiAgentEpisode(
        "name",
        observation_space=dict.fromkeys("abc", SPACES[0]),
        action_space=dict.fromkeys("abc", SPACES[1]),
        env_t_started=3,
        agent_t_started=dict.fromkeys("abc", 3),
        agent_module_ids={"a": "one", "b": "two", "c": "one"},
        agent_to_module_mapping_fn=mapping,
    )
    assert mine.agent_t_started == theirs.agent_t_started
    assert [mine.module_for(agent) for agent in "abc"] == ["one", "two", "one"]
    assert mine.env_t_to_agent_t["a"].data == [3, 4, 5, 6, 7, 8]
    assert mine.env_t_to_agent_t["b"].data == [3, 4, 5, 6]
    assert mine.is_done
    assert mine.get_return() == pytest.approx(sum(float(one.rewards.sum()) for one in parts.values()), abs=1e-5)
    first = mine[:2]
    np.testing.assert_array_equal(first.agent_episodes["a"].get_rewards(), parts["a"].rewards[:2])


@pytest.mark.parametrize("whole", [True, False])
def test_episodes_of_several_agents_travel(whole):
    mine, parts = team(whole)
    found = pickle.loads(pickle.dumps(mine))
    assert (found.env_t, found.is_done, found.id_) == (8, True, "name")
    for agent, one in parts.items():
        np.testing.assert_array_equal(found.agent_episodes[agent].get_rewards(), one.rewards)
        np.testing.assert_array_equal(
            part_of_episode(found.agent_episodes[agent]).whole_observations[-1], one.whole_observations[-1]
        )
    assert found.env_t_to_agent_t["b"].data == [3, 4, 5, 6]
    batches = batches_of([found], lambda name: name == "two")
    assert batches.keys() == {"two"}
    assert len(batches["two"]) == 3
