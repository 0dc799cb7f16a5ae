"""From steps to RLlib's episodes in cases small enough to count: pieces, ends, agents, decisions, and the runners."""

from __future__ import annotations

import pickle
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from dummy_environment import TEAM, DummyTeam
from gymnasium.spaces import Box, MultiDiscrete
from ray.rllib.env.single_agent_episode import SingleAgentEpisode
from training_values import MAKER

from safe_inspect.dones.base import DoneStatus
from safe_inspect.errors import SafeInspectError
from safe_inspect.experiments.learning.ppo_learner import batches_of
from safe_inspect.experiments.sampling import env_runners
from safe_inspect.experiments.sampling.environment import TeamMultiAgentEnv, TrainingEnv
from safe_inspect.experiments.sampling.rollout import (
    AgentSlot,
    DecisionRollout,
    DecisionTrack,
    Rollout,
    multi_agent_episodes,
    single_agent_episodes,
)

pytestmark = pytest.mark.ray

#: Two groups: of two agents with 2 elements of observation, and of one with 3.
SIZES = [(2, 2, 1, 2), (1, 3, 2, 4)]
PAIR, ALONE = slice(2), slice(2, 3)
SLOTS = (
    AgentSlot("red", "shared", 0, 0, 0), AgentSlot("blue", "shared", 0, 1, 1), AgentSlot("green", "own", 1, 0, 2),
)  # fmt: skip
SPACES = {
    slot.agent: (Box(-9.0, 9.0, (SIZES[slot.group][1],)), Box(-1.0, 1.0, (SIZES[slot.group][2],))) for slot in SLOTS
}


def masks(agents: int, *where: tuple[int, int]) -> np.ndarray:
    found = np.zeros((agents, 2), dtype=np.bool_)
    for place in where:
        found[place] = True
    return found


def finals(sign: float = -1.0) -> list[np.ndarray]:
    return [sign * np.arange(4.0).reshape(2, 2), sign * np.arange(3.0).reshape(1, 3)]


def filled(rollout: Any) -> Any:
    """Let each number of a rollout's arrays be its own."""
    for number, track in enumerate(rollout.tracks, 1):
        for place, name in enumerate(("observations", "actions", "inputs", "log_probabilities", "rewards"), 1):
            array = getattr(track, name)
            array[...] = 1000 * number + 100 * place + np.arange(array.size).reshape(array.shape)
    return rollout


def mapping(agent: str, episode: Any, **_: Any) -> str:
    return "own" if agent == "green" else "shared"


def seven_steps() -> Rollout:
    """Return 7 steps of two environments, in the second of which the last agent had ended before.

    In the first, blue terminates at 2, red and green at 4 by time and by the task; then all continue. In the second,
    the others end at 7 with the last step, in the task's way.
    """
    flying = np.ones((3, 2), dtype=np.bool_)
    flying[2, 1] = False
    rollout = filled(Rollout(SIZES, 7, np.array([5, 11]), flying))
    for track in rollout.tracks:
        track.observations[:, :, 7] = 7.5
    rollout.end(PAIR, 1, masks(2, (1, 0)), masks(2))
    rollout.end(PAIR, 3, masks(2), masks(2, (0, 0)))
    rollout.end(ALONE, 3, masks(1, (0, 0)), masks(1))
    assert rollout.finish(0, 4, 8, finals())
    rollout.end(PAIR, 6, masks(2, (0, 1), (1, 1)), masks(2))
    assert rollout.finish(1, 7, 0, finals(-2.0))
    rollout.close(7)
    return rollout


def test_agents_end_at_times_of_their_own() -> None:
    rollout = seven_steps()
    pieces = rollout.pieces
    assert not rollout.missing
    assert [(piece.env, piece.start, piece.stop, piece.begun, piece.episode, piece.over) for piece in pieces] == [
        (0, 0, 4, 5, 8, True), (1, 0, 7, 11, 0, True), (0, 4, 7, 0, -1, False),
    ]  # fmt: skip
    spans = [[(span.start, span.length, span.terminated, span.truncated) for span in piece.spans] for piece in pieces]
    assert spans == [
        [(0, 4, False, True), (0, 2, True, False), (0, 4, True, False)],
        [(0, 7, True, False), (0, 7, True, False), (0, 0, False, False)],
        [(4, 3, False, False)] * 3,
    ]


def test_an_episode_of_several_agents_holds_the_steps_of_each() -> None:
    rollout = seven_steps()
    first, second, third = multi_agent_episodes(rollout, SLOTS, SPACES, ["a", "b", "c"], 6, mapping)
    assert [(one.env_t_started, one.env_t) for one in (first, second, third)] == [(5, 9), (11, 18), (0, 3)]
    assert [(one.is_terminated, one.is_truncated) for one in (first, second, third)] == [
        (False, True), (True, False), (False, False),
    ]  # fmt: skip
    assert list(first.agent_episodes) == ["red", "blue", "green"]
    assert list(second.agent_episodes) == ["red", "blue"]
    assert [first.module_for(agent) for agent in SPACES] == ["shared", "shared", "own"]
    assert (first.observation_space["green"], first.agent_to_module_mapping_fn) == (SPACES["green"][0], mapping)
    assert first.agent_t_started == dict.fromkeys(SPACES, 5)
    assert first.env_t_to_agent_t["red"].data == [5, 6, 7, 8, 9]
    assert first.env_t_to_agent_t["blue"].data == [5, 6, 7]
    one, track = first.agent_episodes["blue"], rollout.tracks[0]
    assert (one.id_, one.agent_id, one.module_id, one.multi_agent_episode_id) == ("a-blue", "blue", "shared", "a")
    assert (one.is_terminated, one.is_truncated, one.t_started) == (True, False, 5)
    assert (one.observation_space, one.action_space) == SPACES["blue"]
    np.testing.assert_array_equal(one.get_observations(), track.observations[1, 0, :3])  # it ended early
    np.testing.assert_array_equal(one.get_actions(), track.actions[1, 0, :2])
    np.testing.assert_array_equal(one.get_rewards(), track.rewards[1, 0, :2])
    outputs = {key: one.get_extra_model_outputs(key) for key in one.extra_model_outputs}
    given = {"action_dist_inputs": track.inputs, "action_logp": track.log_probabilities}
    wanted = {"weights_seq_no": [6, 6], **{key: array[1, 0, :2] for key, array in given.items()}}
    assert outputs.keys() == wanted.keys()
    for key, values in wanted.items():
        np.testing.assert_array_equal(outputs[key], values)
    last = first.agent_episodes["green"].get_observations()
    np.testing.assert_array_equal(last[:4], rollout.tracks[1].observations[0, 0, :4])
    np.testing.assert_array_equal(last[4], [0.0, -1.0, -2.0])
    on = third.agent_episodes["red"].get_observations()
    np.testing.assert_array_equal(on[:3], track.observations[0, 0, 4:7])
    np.testing.assert_array_equal(on[3], [7.5, 7.5])
    np.testing.assert_array_equal(first[:2].agent_episodes["blue"].get_rewards(), track.rewards[1, 0, :2])
    # Where green alone is required, there is no episode without it.
    green = multi_agent_episodes(rollout, SLOTS[2:], SPACES, ["a", "b", "c"], 6, mapping)
    assert [list(episode.agent_episodes) for episode in green] == [["green"]] * 2
    assert [episode.id_ for episode in green] == ["a", "c"]


def test_an_episode_of_one_agent_is_a_piece_with_steps() -> None:
    rollout = filled(Rollout(SIZES[1:], 3, np.array([0, 4]), np.array([[True, False]])))
    rollout.end(slice(1), 2, masks(1), masks(1, (0, 0)))
    rollout.finish(0, 3, 0, finals()[1:])
    rollout.close(3)
    slot = AgentSlot("pilot", "default_policy", 0, 0, 0)
    (one,) = single_agent_episodes(rollout, slot, SPACES["green"], ["a", "b"], 2)
    assert (one.id_, one.is_terminated, one.is_truncated, len(one), one.agent_id) == ("a", False, True, 3, None)


def test_episodes_beyond_those_that_are_wanted_are_left_out() -> None:
    rollout = Rollout(SIZES, 2, np.zeros(2, dtype=np.int64), np.ones((3, 2), dtype=np.bool_), np.array([1, 2]))
    rollout.tracks[0].actions[...] = 3.0
    rollout.tracks[0].rewards[...] = np.arange(8.0).reshape(2, 2, 2)
    rollout.reserve(2)
    assert rollout.tracks[0].rewards.shape == (2, 2, 2)
    rollout.reserve(5)
    assert rollout.tracks[0].rewards.shape == (2, 2, 8)
    assert rollout.tracks[1].observations.shape[:2] == (1, 2)
    assert rollout.tracks[1].observations.shape[2] >= 9
    np.testing.assert_array_equal(rollout.tracks[0].rewards[:, :, :2], np.arange(8.0).reshape(2, 2, 2))
    np.testing.assert_array_equal(rollout.tracks[0].actions[:, :, :2], 3.0)
    kept = []
    for env, stop, episode in ((0, 2, 0), (0, 3, 1), (1, 3, 0), (1, 6, 1)):
        assert rollout.missing
        kept.append(rollout.finish(env, stop, episode, finals()))
    assert kept == [True, False, True, True]
    assert not rollout.missing
    assert [(piece.env, piece.start, piece.stop, piece.begun) for piece in rollout.pieces] == [
        (0, 0, 2, 0), (1, 0, 3, 0), (1, 3, 6, 0),
    ]  # fmt: skip


def test_decisions_of_each_agent_stand_one_behind_the_other() -> None:
    """The first environment ends after step 4, with 2, 1 and 3 decisions; the second continues with 1, 0 and 2."""
    everyone = np.ones((3, 2), dtype=np.bool_)
    rollout = DecisionRollout(SIZES, 8, np.array([6, 0]), everyone.copy())
    assert not rollout.missing
    group, alone = rollout.tracks
    group.counts[:, 0], alone.counts[:, 0] = [2, 1], [3]
    rollout.end(PAIR, 3, masks(2, (1, 0)), masks(2))
    rollout.end(ALONE, 3, masks(1), masks(1, (0, 0)))
    assert rollout.finish(0, 4, 9)
    assert [track.counts[:, 0].tolist() for track in rollout.tracks] == [[3, 2], [4]]  # behind the last observation
    group.counts[0, 0] += 1
    group.counts[:, 1], alone.counts[:, 1] = [1, 0], [2]
    rollout.close(7)
    found = [
        (piece.env, piece.start, piece.stop, piece.begun, piece.episode,
         [(span.start, span.length, span.terminated, span.truncated) for span in piece.spans])
        for piece in rollout.pieces
    ]  # fmt: skip
    cut = (False, False)
    assert found == [
        (0, 0, 4, 6, 9, [(0, 2, *cut), (0, 1, True, False), (0, 3, False, True)]),
        (0, 4, 7, 0, -1, [(3, 1, *cut), (2, 0, *cut), (4, 0, *cut)]),
        (1, 0, 7, 0, -1, [(0, 1, *cut), (0, 0, *cut), (0, 2, *cut)]),
    ]
    again = DecisionRollout(SIZES, 8, np.zeros(2, dtype=np.int64), everyone, np.array([1, 0]))
    assert again.missing
    assert [again.finish(1, 3, 0), again.finish(0, 5, 0), again.finish(0, 9, 1)] == [False, True, False]
    assert not again.missing
    again.close(9)
    assert [(piece.env, piece.start, piece.stop) for piece in again.pieces] == [(0, 0, 5), (1, 3, 9)]


def test_a_track_of_decisions_grows_and_hands_over_what_has_begun() -> None:
    names = ("observations", "actions", "inputs", "log_probabilities")
    rng = np.random.default_rng(2)
    rollout = DecisionRollout([(2, 3, 1, 2)], 8, np.zeros(4, dtype=np.int64), np.ones((2, 4), dtype=np.bool_))
    (track,) = rollout.tracks
    written: dict[str, list[Any]] = {name: [] for name in (*names, "rewards", "steps")}
    agents, rows = np.indices((2, 4))
    for count in range(100):
        track.counts[...] = count
        rollout.reserve(0)
        assert count + 2 < min(getattr(track, name).shape[2] for name in written)
        for name, values in written.items():
            array = getattr(track, name)
            values.append((100 * rng.random((2, 4, *array.shape[3:]))).astype(array.dtype))
            array[agents, rows, track.counts] = values[-1]
    for name, values in written.items():
        np.testing.assert_array_equal(getattr(track, name)[:, :, :100], np.stack(values, axis=2))
    track.counts[...] = rng.integers(0, 100, (2, 4))
    pending, fresh = track.pending(), DecisionTrack((2, 3, 1, 2), 4, 8)
    fresh.resume(pending)
    assert set(pending) == set(names)
    for name in names:
        for agent, row in np.ndindex(2, 4):
            expected = written[name][track.counts[agent, row]][agent, row]
            np.testing.assert_array_equal(getattr(fresh, name)[agent, row, 0], expected)
    track.observations[...] = 0.0
    assert pending["observations"].any()  # copies


def test_an_episode_of_decisions_tells_rllib_of_their_steps() -> None:
    rollout = filled(DecisionRollout(SIZES[1:], 8, np.array([3]), np.ones((1, 1), dtype=np.bool_)))
    (track,) = rollout.tracks
    track.counts[:], track.steps[0, 0, :2] = 2, [4, 9]
    rollout.end(slice(1), 12, masks(1)[:, :1], ~masks(1)[:, :1])
    rollout.finish(0, 13, 0, finals()[1:])
    slot = AgentSlot("pilot", "default_policy", 0, 0, 0)
    (episode,) = single_agent_episodes(rollout, slot, SPACES["green"], ["name"], 7)
    assert set(episode.extra_model_outputs) == {
        "action_dist_inputs", "action_logp", "decision_steps", "weights_seq_no",
    }  # fmt: skip
    assert (episode.t_started, episode.is_truncated, episode.is_terminated) == (3, True, False)
    np.testing.assert_array_equal(episode.get_observations(), track.observations[0, 0, :3])
    batch = batches_of([episode], lambda name: True)["default_policy"]
    assert len(batch) == 2
    np.testing.assert_array_equal(batch.steps, [4, 9])


def test_levels_are_whole_numbers_in_an_episode() -> None:
    rollout = filled(Rollout(SIZES[1:], 3, np.array([0]), np.ones((1, 1), dtype=np.bool_)))
    rollout.close(3)
    slot, spaces = AgentSlot("pilot", "default_policy", 0, 0, 0), (SPACES["green"][0], MultiDiscrete([9000] * 2))
    (episode,) = single_agent_episodes(rollout, slot, spaces, ["name"], 7)
    assert episode.get_actions().dtype == spaces[1].dtype
    np.testing.assert_array_equal(episode.get_actions(), rollout.tracks[0].actions[0, 0, :3])


def test_an_episode_that_is_sent_to_another_process_contains_only_its_own_steps() -> None:
    """The arrays of a rollout are large, and those of an episode are views of them."""
    rollout = filled(Rollout(SIZES[1:], 5000, np.array([0]), np.ones((1, 1), dtype=np.bool_)))
    rollout.end(slice(1), 4, ~masks(1)[:, :1], masks(1)[:, :1])
    rollout.finish(0, 5, 0, finals()[1:])
    slot = AgentSlot("pilot", "default_policy", 0, 0, 0)
    (episode,) = single_agent_episodes(rollout, slot, SPACES["green"], ["name"], 7)
    assert len(pickle.dumps(episode)) < 10_000
    assert pickle.loads(pickle.dumps(episode)).get_return() == episode.get_return()


def test_the_learner_takes_no_steps_of_the_time_before() -> None:
    outputs = {"action_dist_inputs": np.arange(10.0).reshape(5, 2), "action_logp": np.arange(5.0)}
    episode = SingleAgentEpisode(
        observations=np.arange(6.0)[:, None], actions=np.arange(5.0)[:, None], rewards=np.arange(5.0),
        infos=[{}] * 6, extra_model_outputs={**outputs, "weights_seq_no": np.array([1.0, 1.0, 4.0, 4.0, 7.0])},
        terminated=True, len_lookback_buffer=2,
    )  # fmt: skip
    episode.to_numpy()
    found = batches_of([episode], lambda name: True)["default_policy"]
    assert (len(found), found.terminated, found.steps) == (3, [True], None)
    np.testing.assert_array_equal(found.all_observations[:, 0], [2, 3, 4, 5])
    np.testing.assert_array_equal(found.actions[:, 0], [2, 3, 4])
    np.testing.assert_array_equal(found.inputs, outputs["action_dist_inputs"][2:])


class Steps:
    """A stand-in for a team's step: keeps the actions, and ends the agents that `ends` names."""

    def __init__(self, env: Any) -> None:
        self.team, self.actions = env.team, list[Any]()
        self.ends: dict[str, tuple[bool, bool]] = {}
        self.over = False
        env.team.step = self

    def __call__(self, actions: Any) -> Any:
        self.actions.append([np.array(one) for one in actions])
        groups = []
        for group in self.team.groups:
            ends = np.array([[self.ends.get(agent, (False, False)) for agent in group.agents]])
            rewards = 1.0 + group.first + np.arange(group.size, dtype=np.float64)[None]
            observations = np.full((1, group.size, group.observation_layout.size), 0.5, np.float32)
            groups.append(
                SimpleNamespace(
                    observation=observations, reward=rewards, terms={"near": rewards / 2.0},
                    active=np.ones((1, group.size), bool), terminated=ends[..., 0], truncated=ends[..., 1],
                )
            )  # fmt: skip
        outcome = np.array([DoneStatus.RUNNING])
        return SimpleNamespace(groups=tuple(groups), over=np.array([self.over]), outcome=outcome)


def team_env(**more: Any) -> Any:
    return TeamMultiAgentEnv({"experiment": {"team": TEAM}, "seed": 3, "maker": MAKER, **more})


def test_an_agent_that_ends_is_named_and_a_whole_truncation_is_not() -> None:
    env = team_env()
    env.reset()
    steps = Steps(env)
    actions = {"red": np.array([1, 2, 3]), "blue": np.array([4, 5, 6]), "green": np.array([7, 8, 9])}
    steps.ends = {"blue": (False, True)}
    observations, rewards, terminated, truncated, infos = env.step(actions)
    assert [one.tolist() for one in steps.actions[0]] == [[[[1, 2, 3], [4, 5, 6]]], [[[7, 8, 9]]]]
    assert {agent: len(one) for agent, one in observations.items()} == {"red": 11, "blue": 11, "green": 7}
    assert rewards == {"red": 1.0, "blue": 2.0, "green": 3.0}
    assert infos == {"red": {}, "blue": {}, "green": {}}
    nobody = {"red": False, "blue": False, "green": False, "__all__": False}
    assert (terminated, truncated) == (nobody, {**nobody, "blue": True})
    assert (env.agents, env.reports) == (["red", "green"], {})
    steps.ends, steps.over = {"red": (True, False), "green": (False, True)}, True
    observations, rewards, terminated, truncated, _ = env.step({**actions, "blue": "ignored"})
    assert steps.actions[1][0].tolist() == [[[1, 2, 3], [0, 0, 0]]]
    assert set(observations) == set(rewards) == {"red", "green"}
    assert terminated == {"red": True, "green": False, "__all__": False}
    assert truncated == {"red": False, "__all__": True}
    assert env.reports[0]["return"] == 12.0
    env.reset()
    assert env.agents == ["red", "blue", "green"]
    steps.ends = dict.fromkeys(actions, (True, False))
    *_, terminated, truncated, _ = env.step(actions)
    assert terminated == {"red": True, "blue": True, "green": True, "__all__": True}
    assert truncated == nobody
    assert env.reports[0]["return"] == 6.0


@pytest.mark.parametrize("flat", [True, False])
def test_a_flat_action_is_a_combination_of_levels(flat: bool) -> None:
    levels = {"agents": ["pilot"], "policies": ["pilot"], "size": 11, "choices": (3, 2, 5)}
    numbers = {"agents": ["other"], "policies": ["other"], "size": 11}
    env = team_env(experiment={"team": [levels, numbers]}, flat_actions=flat)
    assert env.action_spaces["other"].shape == (3,)
    assert [getattr(env.action_spaces["pilot"], name, None) is not None for name in ("n", "nvec")] == [flat, not flat]
    env.reset()
    steps = Steps(env)
    env.step({"pilot": 17 if flat else np.array([1, 1, 2]), "other": np.array([0.1, 0.2, 0.3])})
    np.testing.assert_array_equal(np.concatenate(steps.actions[0])[:, 0], [[1, 1, 2], [0.1, 0.2, 0.3]])
    one = TrainingEnv({"experiment": {"team": [levels]}, "seed": 3, "maker": MAKER, "flat_actions": flat}, 2)
    one.reset()
    assert one.action_space.shape == ((2,) if flat else (2, 3))
    taken: list[Any] = []
    step = one.team.step
    one.team.step = lambda actions: taken.append(np.array(actions)) or step(actions)
    one.step(np.array([17, 29]) if flat else np.array([[1, 1, 2], [2, 1, 4]]))
    np.testing.assert_array_equal(taken[0][0][:, 0], [[1, 1, 2], [2, 1, 4]])


def test_the_place_and_the_seeds_of_one_environment() -> None:
    env = team_env()
    assert env.agents == env.possible_agents == ["red", "blue", "green"]
    assert {agent: space.shape for agent, space in env.observation_spaces.items()} == {
        "red": (11,), "blue": (11,), "green": (7,),
    }  # fmt: skip
    assert env.reports == {}
    team, seeds = env.team, list[Any]()
    env.place(0, False)
    assert env.team is team
    env.place(9, True)
    assert env.team is not team
    assert env.team.slots.tolist() == [9]
    reset = env.team.reset
    env.team.reset = lambda seed=None: seeds.append(seed) or reset(seed=seed)
    env.reset(seed=5)
    assert seeds == [None]  # RLlib's seed is not used


@pytest.mark.parametrize("kind", [TeamMultiAgentEnv, lambda config: TrainingEnv(config, 2)], ids=["team", "one"])
def test_decisions_that_last_are_not_for_rllibs_own_runner(kind: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(DummyTeam, "decides", True)
    with pytest.raises(SafeInspectError, match="CoastGlue"):
        kind({"experiment": {}, "seed": 3, "maker": MAKER})


def test_an_environment_that_has_ended_takes_no_action_and_begins_again() -> None:
    env = TrainingEnv({"experiment": {"drift": 0.2}, "seed": 3, "maker": MAKER}, 3)
    start, _ = env.reset()
    taken: list[Any] = []
    step = env.team.step
    env.team.step = lambda actions: taken.append(np.array(actions[0])) or step(actions)
    ended, again = np.zeros(3, dtype=bool), 0
    for _ in range(60):
        observations, rewards, terminated, truncated, _ = env.step(np.ones((3, 3), np.float32))
        np.testing.assert_array_equal(taken[-1][:, 0], np.where(ended[:, None], 0.0, np.ones(3)))
        assert (observations[ended, 5] == 0).all()
        assert (rewards[ended] == 0.0).all()
        assert not (terminated | truncated)[ended].any()
        assert set(env.reports) == set(np.flatnonzero(terminated | truncated))
        again += int(ended.sum())
        ended = terminated | truncated
    assert again > 5
    assert len(start) == 3


class Runner(env_runners.BatchedEnvRunner):
    """A runner without what RLlib builds."""

    def __init__(self, **attributes: Any) -> None:
        vars(self).update(attributes)


def test_a_runner_takes_whole_steps_and_begins_anew_after_whole_episodes() -> None:
    called: list[Any] = []

    class Fake:
        def reset(self) -> None:
            called.append("reset")

        def roll(self, *given: Any) -> Any:
            called.append(("roll", *given))

        def roll_episodes(self, *given: Any) -> Any:
            called.append(("episodes", *given))

    runner = Runner(_sampler=Fake(), num_envs=4, _needs_initial_reset=True, config=None)
    runner._roll(num_timesteps=8, explore=True)
    runner._roll(num_timesteps=9, explore=False)
    runner._roll(num_timesteps=1, explore=True, force_reset=True)
    runner._roll(num_episodes=6, explore=True)
    runner._roll(explore=True)
    runner._roll(num_timesteps=4, explore=True)
    assert called == [
        "reset", ("roll", 2, True), ("roll", 3, False), "reset", ("roll", 1, True),
        ("episodes", 6, True), ("episodes", 0, True), "reset", ("roll", 1, True),
    ]  # fmt: skip
    with pytest.raises(AssertionError, match="random actions"):
        runner._roll(num_timesteps=4, explore=True, random_actions=True)


def test_a_sample_is_named_by_seed_slot_and_episode_and_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    rollout = seven_steps()
    logged: list[Any] = []
    simulation = SimpleNamespace(episodes=np.array([20, 30]))
    sampler = SimpleNamespace(reports=["one", "two"], environment=SimpleNamespace(simulation=simulation))
    runner = Runner(
        config=SimpleNamespace(env_config={}), _sampler=sampler, _seed_of_slots=255, _slot=40, _done=["none"],
        metrics="logger", agent_slots=SLOTS, _metrics_num_env_steps_sampled="counted",
        _log_env_steps=lambda **given: logged.append(given),
        _roll=lambda **given: logged.append(given) or rollout, _episodes=lambda found, names: (found, names),
    )  # fmt: skip
    monkeypatch.setattr(env_runners, "log_steps", lambda *given: logged.append(given) or 14)
    found, names = runner._sample(num_timesteps=9, explore=False, force_reset=True)
    assert found is rollout
    assert names == ["ff-40-8", "ff-41-0", "ff-40-20"]
    assert logged == [
        {"num_timesteps": 9, "explore": False, "force_reset": True},
        ("logger", rollout, SLOTS, 2, False),
        {"metric": "counted", "num_steps": 14},
    ]  # fmt: skip
    assert (runner._done, sampler.reports) == (["none", "one", "two"], [])


def test_a_runner_logs_each_episode_once(monkeypatch: pytest.MonkeyPatch) -> None:
    logged: list[Any] = []
    monkeypatch.setattr(env_runners, "log_episodes", lambda *given: logged.append(("episodes", *given)))
    monkeypatch.setattr(env_runners, "log_reports", lambda *given: logged.append(("reports", *given)))
    metrics = SimpleNamespace(reduce=lambda: "reduced")
    runner = Runner(env="there", config="config", metrics=metrics, agent_slots=SLOTS, _done=["one"])
    assert runner.get_metrics() == runner.get_metrics() == "reduced"
    assert logged == [("episodes", metrics, "config", ["one"], SLOTS, False), ("reports", metrics, "config", ["one"])]
