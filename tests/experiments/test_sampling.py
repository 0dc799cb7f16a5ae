"""What RLlib's stock runner and learner make of the environments: value targets, actions, slots."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from training_values import MAKER, QUICK

from safe_inspect.experiments.environment import DEFAULT_MAKER
from safe_inspect.experiments.translation import translate_rllib

pytestmark = pytest.mark.ray

EXPERIMENT = Path(__file__).parents[2] / "configs" / "translational-inspection" / "experiment.yml"


def build(experiment, maker=MAKER, **more):
    """Return an algorithm, without Tune."""
    from safe_inspect.experiments import environment
    from safe_inspect.experiments.algorithm import build_config, environment_settings

    settings = translate_rllib({**QUICK, **more})
    assert not settings.problems
    environment.register(maker)
    return build_config(settings, environment_settings(experiment, settings.settings, maker=maker))


@pytest.fixture
def algorithm(ray_session, tmp_path, monkeypatch):
    from ray.tune.trainable import trainable

    monkeypatch.setattr(trainable, "DEFAULT_STORAGE_PATH", str(tmp_path))  # else in the home folder, without Tune
    built = []

    def make(*arguments, **more):
        config = build(*arguments, **more)
        built.append(config.build_algo())
        return built[-1]

    yield make
    for item in built:
        item.stop()


def targets(rewards, values, terminated, gamma, factor):
    """Return the value targets of one piece of an episode by generalised advantage estimation.

    A_t = delta_t + gamma lambda A_(t+1) with delta_t = r_t + gamma V_(t+1) - V_t, and the target is A_t + V_t. After
    a termination V is 0; after a truncation, or where the batch cuts the episode, it is the net's.
    """
    after = np.append(values[1:-1], 0.0 if terminated else values[-1])
    advantage, found = 0.0, np.zeros(len(rewards))
    for t in reversed(range(len(rewards))):
        advantage = rewards[t] + gamma * after[t] - values[t] + gamma * factor * advantage
        found[t] = advantage + values[t]
    return found


def test_value_targets_at_terminations_truncations_and_cuts(algorithm):
    import torch

    algo = algorithm({"drift": 0.03})
    pieces = algo.env_runner.sample(num_timesteps=1500)
    kinds = {(bool(piece.is_terminated), bool(piece.is_truncated)) for piece in pieces}
    assert kinds == {(True, False), (False, True), (False, False)}
    learner = algo.learner_group._learner
    module = learner.module["default_policy"]
    expected, values_after = [], []
    for piece in pieces:
        observations = torch.from_numpy(np.asarray(piece.get_observations(), np.float32))
        with torch.no_grad():
            values = module.compute_values({"obs": observations}).numpy().astype(np.float64)
        values_after.append(values[-1])
        expected.append(targets(piece.get_rewards(), values, piece.is_terminated, 0.99, 0.95))
    assert np.abs(values_after).min() > 1e-6  # else a missing bootstrap could not be seen
    batch = learner._learner_connector(
        rl_module=learner.module, batch={}, episodes=pieces, shared_data={}, metrics=learner.metrics
    )["default_policy"]
    found = batch["value_targets"][batch["loss_mask"]].numpy()
    np.testing.assert_allclose(found, np.concatenate(expected), atol=2e-5)


def test_the_learner_keeps_the_raw_action_and_the_environment_gets_the_clipped_one(algorithm):
    algo = algorithm({})
    pieces = algo.env_runner.sample(num_timesteps=500)  # the small environment asserts that actions are in bounds
    actions = np.concatenate([piece.get_actions() for piece in pieces])
    assert np.abs(actions).max() > 1.0


def rollouts(algo, steps):
    """Step the environments of all runners with actions that depend on the slot; return them by slot."""

    def roll(runner):
        env = runner.env.unwrapped
        observations, _ = env.reset()
        first = max(runner.worker_index - 1, 0) * env.num_envs
        rate = 0.3 + 0.1 * (first + np.arange(env.num_envs))
        found = [observations]
        for step in range(steps):
            push = np.sin(step * rate)[:, None] * np.array([1.0, -0.7, 0.4])
            found.append(env.step(push.astype(np.float32))[0])
        return first, np.stack(found, axis=1)

    remote = algo.config.num_env_runners > 0
    results = algo.env_runner_group.foreach_env_runner(roll, local_env_runner=not remote)
    return np.concatenate([rows for _, rows in sorted(results, key=lambda item: item[0])])


@pytest.mark.parametrize("which", ["dummy", "inspection"])
def test_episodes_do_not_depend_on_the_number_of_runners(algorithm, which):
    if which == "dummy":
        experiment, maker = {}, MAKER
    else:
        from safe_inspect.config.experiment import load_experiment

        experiment, maker = load_experiment(EXPERIMENT).resolved, DEFAULT_MAKER
    steps = 150
    found = [
        rollouts(algorithm(experiment, maker, num_env_runners=runners, num_envs_per_env_runner=envs), steps)
        for runners, envs in ((0, 4), (1, 4), (2, 2))
    ]
    assert found[0].shape == (4, steps + 1, 11)
    assert len(np.unique(found[0][:, 0], axis=0)) == 4  # each slot has a start of its own
    np.testing.assert_array_equal(found[0], found[1])
    np.testing.assert_array_equal(found[0], found[2])
