"""What RLlib makes of the environments with either runner: episodes, value targets, metrics, slots."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from algorithms import build, parts_of, targets
from dummy_environment import CHOOSING, ONE, TEAM, THREE
from training_values import QUICK

from safe_inspect.experiments.settings.policies import DEFAULT_MAKER
from safe_inspect.experiments.settings.translation import translate_rllib

pytestmark = pytest.mark.ray

CONFIGS = Path(__file__).parents[2] / "configs"


@pytest.mark.parametrize("runner", ["batched", "stock"])
@pytest.mark.parametrize("team", [ONE, TEAM], ids=["one", "team"])
def test_value_targets_at_terminations_truncations_and_cuts(algorithm, team, runner):
    import torch

    algo = algorithm({"drift": 0.03, "team": team}, env_runner=runner)
    episodes = algo.env_runner.sample(num_timesteps=1500)
    parts = parts_of(episodes)
    kinds = {"terminated" if part.is_terminated else "truncated" if part.is_truncated else "cut" for part in parts}
    assert kinds == {"terminated", "truncated", "cut"}
    learner = algo.learner_group._learner
    expected = {}
    for part in parts:
        name = part.module_id or "default_policy"
        observations = torch.from_numpy(np.asarray(part.get_observations(), np.float32))
        with torch.no_grad():
            values = learner.module[name].compute_values({"obs": observations}).numpy().astype(np.float64)
        assert abs(values[-1]) > 1e-6  # else a missing bootstrap could not be seen
        found = targets(part.get_rewards(), values, part.is_terminated, 0.99, 0.95)
        expected.setdefault(name, []).append((part.get_observations()[:-1], found))
    batch = learner._learner_connector(
        rl_module=learner.module, batch={}, episodes=episodes, shared_data={}, metrics=learner.metrics
    )
    assert set(batch) == set(expected)
    for name, columns in batch.items():
        kept = columns.get("loss_mask", torch.ones(len(columns["obs"]), dtype=torch.bool))
        found = np.column_stack((columns["obs"][kept].numpy(), columns["value_targets"][kept].numpy()))
        wanted = np.concatenate([np.column_stack(pair) for pair in expected[name]])
        order, same = (np.lexsort(rows[:, 2:6].T) for rows in (found, wanted))  # RLlib's order of agents is a set's
        np.testing.assert_allclose(found[order], wanted[same], atol=2e-5)


@pytest.mark.parametrize("runner", ["batched", "stock"])
def test_the_learner_keeps_the_raw_action_and_its_density(algorithm, runner):
    import torch

    algo = algorithm({}, env_runner=runner)
    pieces = algo.env_runner.sample(num_timesteps=500)
    actions = np.concatenate([piece.get_actions() for piece in pieces])
    assert np.abs(actions).max() > 1.0
    module = algo.env_runner.module
    for piece in pieces:
        with torch.no_grad():
            inputs = module.forward_exploration({"obs": torch.from_numpy(piece.get_observations()[:-1])})
        inputs = inputs["action_dist_inputs"]
        np.testing.assert_allclose(piece.get_extra_model_outputs("action_dist_inputs"), inputs.numpy(), atol=1e-6)
        density = module.get_exploration_action_dist_cls().from_logits(inputs)
        expected = density.logp(torch.from_numpy(piece.get_actions())).numpy()
        np.testing.assert_allclose(piece.get_extra_model_outputs("action_logp"), expected, atol=5e-6)


@pytest.mark.parametrize("runner", ["batched", "stock"])
def test_choices_are_drawn_with_their_probabilities(algorithm, runner):
    import torch

    algo = algorithm({"team": CHOOSING}, env_runner=runner)
    pieces = algo.env_runner.sample(num_timesteps=2000)
    actions = np.concatenate([piece.get_actions() for piece in pieces])
    assert np.issubdtype(actions.dtype, np.integer)
    inputs = torch.from_numpy(np.concatenate([piece.get_extra_model_outputs("action_dist_inputs") for piece in pieces]))
    first = 0
    density = 0.0
    for column, size in enumerate(CHOOSING[0]["choices"]):
        chances = torch.softmax(inputs[:, first : first + size].double(), dim=1).numpy()
        counts = np.bincount(actions[:, column], minlength=size)
        spread = np.sqrt((chances * (1.0 - chances)).sum(axis=0))
        assert (np.abs(counts - chances.sum(axis=0)) < 4.5 * spread).all()
        density = density + np.log(chances[np.arange(len(actions)), actions[:, column]])
        first += size
    told = np.concatenate([piece.get_extra_model_outputs("action_logp") for piece in pieces])
    np.testing.assert_allclose(told, density, atol=1e-5)
    if runner == "batched":
        modes = algo.env_runner.sample(num_timesteps=200, explore=False)
        for piece in modes:
            parts = np.split(piece.get_extra_model_outputs("action_dist_inputs"), [3, 5], axis=1)
            np.testing.assert_array_equal(piece.get_actions(), np.stack([part.argmax(axis=1) for part in parts], 1))


def paths(metrics, prefix=()):
    found = set()
    for key, value in metrics.items():
        found |= paths(value, (*prefix, key)) if isinstance(value, dict) else {"/".join(map(str, (*prefix, key)))}
    return found


#: What only the stock runners do, and measure.
STOCK_ALONE = ("connector", "env_to_module", "timer", "env_reset", "env_step", "rlmodule_inference")


@pytest.mark.parametrize("team", [ONE, TEAM], ids=["one", "team"])
def test_both_runners_report_the_same(algorithm, team):
    found = []
    for runner in ("batched", "stock"):
        algo = algorithm({"team": team, "drift": 0.03}, env_runner=runner)
        result = algo.train()
        keys = paths({key: result[key] for key in ("env_runners", "num_env_steps_sampled_lifetime")})
        keys -= {"num_env_steps_sampled_lifetime_throughput/throughput_since_last_restore"}
        found.append({key for key in keys if not any(word in key for word in STOCK_ALONE)})
        runners = result["env_runners"]
        total = sum(runners["num_agent_steps_sampled"].values())
        assert total == sum(runners["num_module_steps_sampled"].values())
        if team is TEAM:  # some agents end early
            assert total < 3 * runners["num_env_steps_sampled"]
        assert runners["num_env_steps_sampled"] == result["num_env_steps_sampled_lifetime"] >= 512
        assert runners["episode_return_mean"] == pytest.approx(sum(runners["reward"].values()), abs=1e-4)
        if team is TEAM:
            means = runners["agent_episode_returns_mean"]
            assert runners["episode_return_mean"] == pytest.approx(sum(means.values()), abs=1e-4)
            for agent, value in means.items():
                assert runners["agents"][agent]["return"] == pytest.approx(value, abs=1e-4)
            modules = runners["module_episode_returns_mean"]
            assert modules["shared"] == pytest.approx(means["red"] + means["blue"], abs=1e-4)
    assert found[0] == found[1]


def sampled(algo, calls):
    """Return what the runners sample, by agent, slot and time: observations, actions and rewards."""
    remote = algo.config.num_env_runners > 0
    found = {}

    def sample(runner):
        return [runner.sample(num_timesteps=steps * runner.num_envs) for steps in calls]

    for samples in algo.env_runner_group.foreach_env_runner(sample, local_env_runner=not remote):
        for part in (part for episodes in samples for part in parts_of(episodes)):
            slot, episode = int(part.get_observations()[0][2]), int(part.get_observations()[0][3])
            observations, actions, rewards = part.get_observations(), part.get_actions(), part.get_rewards()
            for t in range(len(part)):
                key = (part.agent_id, slot, episode, part.t_started + t)
                assert key not in found
                found[key] = np.concatenate((observations[t], actions[t], [rewards[t]]))
    return found


@pytest.mark.parametrize(
    "team",
    [
        pytest.param(ONE, id="one", marks=pytest.mark.long),
        pytest.param(THREE, id="three"),
        pytest.param(CHOOSING, id="choosing", marks=pytest.mark.long),
    ],
)
@pytest.mark.slow
def test_episodes_do_not_depend_on_the_number_of_runners(algorithm, team):
    found = [
        sampled(
            algorithm({"team": team, "sleep": 0.0}, num_env_runners=runners, num_envs_per_env_runner=envs), (30, 45)
        )
        for runners, envs in ((0, 4), (2, 2))
    ]
    assert len({key[1] for key in found[0]}) == 4
    for other in found[1:]:
        assert other.keys() == found[0].keys()
        for key, values in found[0].items():
            np.testing.assert_array_equal(other[key], values)


def real(folder):
    from safe_inspect.config.experiment import load_experiment

    return load_experiment(CONFIGS / folder / "experiment.yml")


@pytest.mark.parametrize(
    "folder",
    [
        pytest.param("translational-inspection", marks=pytest.mark.long),
        pytest.param("multiagent-translational-inspection", marks=pytest.mark.slow),
    ],
)
def test_the_real_environment_samples_alike_with_two_runners(algorithm, folder):
    experiment = real(folder)
    streams = []
    for runners, envs in ((0, 4), (2, 2)):
        algo = algorithm(
            experiment.resolved,
            DEFAULT_MAKER,
            tuple(experiment.policies.values()),
            num_env_runners=runners,
            num_envs_per_env_runner=envs,
        )
        samples = algo.env_runner_group.foreach_env_runner(
            lambda runner: runner.sample(num_timesteps=60 * runner.num_envs), local_env_runner=not runners
        )
        parts = [part for episodes in samples for part in parts_of(episodes)]
        streams.append({part.id_: part for part in parts})
    assert streams[0].keys() == streams[1].keys()
    for name, part in streams[0].items():
        np.testing.assert_array_equal(part.get_observations(), streams[1][name].get_observations())
        np.testing.assert_array_equal(part.get_actions(), streams[1][name].get_actions())


@pytest.mark.parametrize("team", [ONE, TEAM], ids=["one", "team"])
def test_evaluation_flies_as_many_whole_episodes_as_asked(algorithm, team):
    algo = algorithm({"team": team}, evaluation_interval=1, evaluation_duration=7, evaluation_config={"explore": False})
    result = algo.train()["evaluation"]["env_runners"]
    assert result["num_episodes"] == 7
    episodes = algo.eval_env_runner_group.local_env_runner.sample(num_episodes=5, explore=False)
    assert len(episodes) == 5
    assert all(episode.is_done for episode in episodes)
    for part in parts_of(episodes):
        assert part.t_started == 0
        np.testing.assert_array_equal(part.get_actions(), part.get_extra_model_outputs("action_dist_inputs")[:, :3])


def test_a_piece_of_several_agents_can_be_sliced(algorithm):
    """Several learners share the pieces: RLlib slices them."""
    algo = algorithm({"team": TEAM})
    algo.env_runner.sample(num_timesteps=160)
    for episode in algo.env_runner.sample(num_timesteps=640):
        if len(episode) < 6:
            continue
        first, second = episode[:4], episode.slice(slice(4, None), len_lookback_buffer=0)
        for agent, part in episode.agent_episodes.items():
            pieces = [piece.agent_episodes[agent] for piece in (first, second) if agent in piece.agent_episodes]
            rewards = np.concatenate([np.asarray(piece.get_rewards()) for piece in pieces])
            np.testing.assert_array_equal(rewards, part.get_rewards())
            np.testing.assert_array_equal(pieces[0].get_observations()[0], part.get_observations()[0])
            np.testing.assert_array_equal(pieces[-1].get_observations()[-1], part.get_observations()[-1])


def test_a_row_of_a_net_does_not_depend_on_the_others(algorithm):
    from safe_inspect.experiments.modules.tanh_net import PolicyNet

    algo = algorithm({}, model_config={"fcnet_hiddens": [256, 256]})
    module = algo.env_runner.module
    observations = np.random.default_rng(0).normal(size=(96, 11)).astype(np.float32)

    def flown(rows):
        found = []
        for start in range(0, 96, rows):
            net = PolicyNet(module, rows)
            net.observations[:] = observations[start : start + rows]
            found.append(net(True).copy())
        return np.concatenate(found)

    expected = flown(96)
    assert PolicyNet(module, 4)._plain is not None  # RLlib's own layers are known
    for rows in (1, 2, 3, 8, 16, 32, 48):
        np.testing.assert_array_equal(flown(rows), expected)


def test_what_the_batched_runner_cannot_do_the_stock_one_does(tmp_path, monkeypatch):
    base = "from ray.rllib.callbacks.callbacks import RLlibCallback"
    watching = "class Watching(RLlibCallback):\n    def on_episode_step(self, **kwargs):\n        pass\n"
    (tmp_path / "watching_callbacks.py").write_text(f"{base}\n{watching}")
    monkeypatch.syspath_prepend(tmp_path)
    assert build({}).env_runner_cls.__name__ == "BatchedEnvRunner"
    with pytest.warns(
        UserWarning, match="RLlib's stock runner samples, because a callback implements `on_episode_step"
    ):
        config = build({}, callbacks=["watching_callbacks.Watching"])
    assert config.env_runner_cls is None
    config = build({}, env_to_module_connector="ray.rllib.connectors.env_to_module.FlattenObservations")
    algo = config.build_algo()
    try:
        runners = algo.train()["env_runners"]
        assert "success_rate" in runners
        assert "env_to_module_connector" in runners
    finally:
        algo.stop()


def test_a_recurrent_policy_is_trained_with_the_stock_runner(algorithm):
    settings = translate_rllib({**QUICK, "model_config": {"use_lstm": True}})
    assert "RLlib's stock runner samples: the policy is recurrent (`use_lstm`)" in settings.notes
    algo = algorithm({}, model_config={"use_lstm": True, "lstm_cell_size": 8, "max_seq_len": 5})
    assert type(algo.env_runner).__name__ == "SingleAgentEnvRunner"
    assert np.isfinite(algo.train()["learners"]["default_policy"]["policy_loss"])
