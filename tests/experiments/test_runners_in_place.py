"""The batched runners in this process, without Ray: slots, evaluation, what a checkpoint holds."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch
from algorithms import build, parts_of
from dummy_environment import CHOOSING, ONE, TEAM

from safe_inspect.experiments.sampling.env_runners import TASK, BatchedEnvRunner, BatchedTeamRunner, TeamSpaces
from safe_inspect.experiments.sampling.environment import stream_seed

pytestmark = [pytest.mark.ray, pytest.mark.filterwarnings("ignore")]


def runner_of(team: Any, worker: int = 0, envs: int = 8, like: Any = None, **more: Any) -> Any:
    """Return a runner, with the weights of another."""
    kind = BatchedEnvRunner if len(team) == 1 else BatchedTeamRunner
    evaluation = more.pop("in_evaluation", False)
    config = build({"drift": 0.03, "team": team}, num_envs_per_env_runner=envs, **more)
    if evaluation:
        config.in_evaluation = True
    torch.manual_seed(3)
    found = kind(config=config, worker_index=worker)
    if like is not None:
        found.set_state({"rl_module": like.get_state()["rl_module"], "weights_seq_no": 6})
    return found


def steps_of(episodes: Any) -> dict[Any, np.ndarray]:
    """Return what each agent saw, did and got, by slot, episode and step."""
    found = {}
    for part in parts_of(episodes):
        observations, actions, rewards = part.get_observations(), part.get_actions(), part.get_rewards()
        for t in range(len(part)):
            key = (part.agent_id, *observations[t][2:4].tolist(), part.t_started + t)
            assert key not in found
            found[key] = np.concatenate((observations[t], actions[t], [rewards[t]]))
    return found


@pytest.mark.parametrize("team", [ONE, CHOOSING, TEAM], ids=["one", "choosing", "team"])
def test_runners_share_the_slots_of_one(team: Any) -> None:
    whole = runner_of(team)
    expected: dict[Any, np.ndarray] = {}
    for steps in (30, 25):
        expected |= steps_of(whole.sample(num_timesteps=8 * steps, explore=True))
    names: dict[Any, str] = {}
    for worker in (1, 2):
        part = runner_of(team, worker, 4, whole)
        found: dict[Any, np.ndarray] = {}
        for steps in (119, 101):  # whole steps of four environments: 30 and 26
            episodes = part.sample(num_timesteps=steps, explore=True)
            found |= steps_of(episodes)
            for episode in episodes:
                slot, number = parts_of([episode])[0].get_observations()[0][2:4].tolist()
                assert episode.id_ == f"0-{int(slot)}-{int(number)}"
                assert names.setdefault((slot, number), episode.id_) == episode.id_
        assert {key[1] for key in found} == set(range(4 * (worker - 1), 4 * worker))
        shared = [key for key in expected if key in found]
        assert len(shared) > 100
        for key in shared:
            np.testing.assert_array_equal(found[key], expected[key])
    assert len({key[2] for key in expected}) > 1


def test_a_runner_knows_its_spaces_and_tells_the_callbacks(monkeypatch: pytest.MonkeyPatch) -> None:
    from safe_inspect.experiments.sampling.env_runners import RunCallbacks

    told: list[Any] = []
    monkeypatch.setattr(RunCallbacks, "on_environment_created", lambda self, **given: told.append(given))
    one, several = runner_of(ONE, 3, 4), runner_of(TEAM)
    assert [given["env_runner"] for given in told] == [one, several]
    assert told[0]["env"] is one.env
    assert (told[0]["env_context"].worker_index, told[1]["env_context"].worker_index) == (3, 0)
    assert told[0]["env_context"]["seed"] == 0
    assert isinstance(one.env, TeamSpaces)
    assert one.env.unwrapped is one.env
    assert (one.env.num_envs, one.num_envs, one.env.team.slots.tolist()) == (4, 4, [8, 9, 10, 11])
    assert one.env.single_observation_space.shape == one.env.observation_space.shape == (11,)
    assert one.env.single_action_space.shape == one.env.action_space.shape == (3,)
    assert {name: space.shape for name, space in several.env.observation_space.items()} == {
        "red": (11,), "blue": (11,), "green": (7,),
    }  # fmt: skip
    assert set(several.env.single_action_space) == {"red", "blue", "green"}
    assert [slot.policy for slot in several.agent_slots] == ["shared", "shared", "own"]
    assert [slot.policy for slot in one.agent_slots] == ["default_policy"]
    one.assert_healthy()
    one.env = None
    with pytest.raises(AssertionError):
        one.assert_healthy()


@pytest.mark.parametrize("team", [ONE, TEAM], ids=["one", "team"])
def test_whole_episodes_are_flown_and_logged(team: Any) -> None:
    training, evaluation = runner_of(team), runner_of(team, in_evaluation=True, seed=4)
    assert evaluation._seed_of_slots == stream_seed(4, 0, True)
    episodes = evaluation.sample(num_episodes=11, explore=False)
    assert len(episodes) == 11
    for part in parts_of(episodes):
        assert part.t_started == 0
        assert part.is_terminated or part.is_truncated
        inputs = part.get_extra_model_outputs("action_dist_inputs")
        np.testing.assert_array_equal(part.get_actions(), inputs[:, : inputs.shape[1] // 2])
    names = [episode.id_.split("-") for episode in episodes]
    assert {name[0] for name in names} == {f"{stream_seed(4, 0, True):x}"}
    assert [sum(int(name[1]) == slot for name in names) for slot in range(8)] == [2, 2, 2, 1, 1, 1, 1, 1]
    found = evaluation.get_metrics()
    assert found["num_episodes"].peek() == 11
    # RLlib counts the steps of an environment, not those of its agents.
    lengths = [episode.env_steps() for episode in episodes]
    assert found["num_env_steps_sampled"].peek() == sum(lengths)
    assert found["episode_len_mean"].peek() == pytest.approx(np.mean(lengths))
    assert np.isnan(evaluation.get_metrics()["episode_len_mean"].peek())
    training.sample(num_timesteps=8 * 10)
    assert any(part.t_started == 10 for part in parts_of(training.sample(num_timesteps=8)))
    training.sample(num_episodes=1)
    assert all(part.t_started == 0 for part in parts_of(training.sample(num_timesteps=8)))
    assert any(part.t_started for part in parts_of(training.sample(num_timesteps=8)))
    assert all(part.t_started == 0 for part in parts_of(training.sample(num_timesteps=8, force_reset=True)))


def test_what_lives_through_resets_is_in_the_state_of_a_runner() -> None:
    first, second, evaluation = runner_of(ONE), runner_of(ONE), runner_of(ONE, in_evaluation=True)
    first.env.team.carried = {"scale": np.arange(8.0)}
    state = first.get_state()
    assert state[TASK]["scale"].tolist() == list(range(8))
    assert TASK not in first.get_state(not_components=TASK)
    assert TASK not in first.get_state("rl_module")
    assert set(first.get_state(TASK)) >= {TASK}
    for runner in (second, evaluation):
        runner.sample(num_timesteps=80)
        runner.set_state(state)
    assert second.env.team.carried["scale"].tolist() == list(range(8))
    assert evaluation.env.team.carried["scale"].tolist() == [-0.1] * 8
    assert all(part.t_started == 0 for part in parts_of(second.sample(num_timesteps=8)))
    assert all(part.t_started == 10 or part.get_observations()[0][3] for part in evaluation.sample(num_timesteps=8))
    second.set_state({"rl_module": state["rl_module"], "weights_seq_no": 9})
    assert any(part.t_started for part in parts_of(second.sample(num_timesteps=8)))
    assert second._weights_seq_no == 9
