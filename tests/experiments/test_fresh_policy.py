"""The first weights of a policy, and what of the task a checkpoint keeps."""

from __future__ import annotations

import numpy as np
import pytest
from dummy_environment import CHOOSING, ONE, TEAM

from safe_inspect.experiments.settings.translation import translate_rllib

pytestmark = pytest.mark.ray
NET = {"fcnet_hiddens": [16, 16], "orthogonal": True}


def learning_module(algo, name="default_policy"):
    return algo.learner_group._learner.module[name].unwrapped()


def test_a_fresh_policy_prefers_the_choice_that_is_asked_for(algorithm):
    import torch

    algo = algorithm({"team": CHOOSING}, model_config={**NET, "initial_choice": 1, "initial_probability": 0.91})
    for module in (algo.env_runner.module, learning_module(algo)):
        with torch.no_grad():
            logits = module.forward_inference({"obs": torch.zeros(4, 11)})["action_dist_inputs"]
        for part in logits.split((3, 2, 5), dim=-1):
            np.testing.assert_allclose(torch.softmax(part, -1)[:, 1].numpy(), 0.91, atol=0.002)
    pieces = algo.env_runner.sample(num_timesteps=2000)
    chosen = np.concatenate([piece.get_actions() for piece in pieces])
    np.testing.assert_allclose((chosen == 1).mean(axis=0), 0.91, atol=0.03)


def test_a_fresh_gaussian_policy_has_the_deviation_that_is_asked_for(algorithm):
    import torch

    algo = algorithm({"team": TEAM}, model_config={**NET, "initial_std": 0.1, "initial_choice": 1})
    for name in ("shared", "own"):
        module = learning_module(algo, name)
        with torch.no_grad():
            inputs = module.forward_inference({"obs": torch.randn(50, module.observation_space.shape[0])})
        inputs = inputs["action_dist_inputs"]
        np.testing.assert_allclose(inputs[:, 3:].exp().numpy(), 0.1, rtol=0.1)
        assert inputs[:, :3].abs().max() < 0.1


def test_orthogonal_weights(algorithm):
    module = learning_module(algorithm({"team": ONE}, model_config=NET))
    hidden = module.encoder.actor_encoder.net.mlp[2].weight.detach().numpy()
    np.testing.assert_allclose(hidden @ hidden.T, 2.0 * np.eye(16), atol=1e-5)
    last = module.pi.net.mlp[0].weight.detach().numpy()
    np.testing.assert_allclose(last @ last.T, 1e-4 * np.eye(6), atol=1e-9)


def test_only_ppo_has_these_keys():
    found = translate_rllib({"algorithm": "SAC", "model_config": {"initial_std": 0.1}})
    assert [problem.message for problem in found.problems] == ["only PPO has the key `initial_std`"]


@pytest.mark.parametrize("team", [ONE, TEAM], ids=["one", "team"])
def test_a_checkpoint_keeps_what_of_the_task_lives_through_resets(algorithm, team, tmp_path):
    algo = algorithm({"team": team})
    algo.train()
    algo.env_runner.env.team.carried = {"scale": np.linspace(-0.3, -0.1, algo.env_runner.num_envs)}
    algo.save_to_path(str(tmp_path / "checkpoint"))
    other = algorithm({"team": team})
    other.restore_from_path(str(tmp_path / "checkpoint"))
    np.testing.assert_array_equal(other.env_runner.env.team.carried["scale"], algo.env_runner.env.team.carried["scale"])
    assert "task" not in algo.env_runner.get_state(components=["rl_module"])
    other.train()


def saved(algo, folder):
    """Save an algorithm as a run does, sealed."""
    from safe_inspect.experiments.modules.checkpoints import Checkpoint

    algo.save_to_path(str(folder))
    Checkpoint(folder, 1, 100, 1.0).seal()
    return str(folder)


def test_a_team_begins_with_what_one_has_learned(algorithm, tmp_path):
    one = algorithm({"team": ONE}, model_config=NET, seed=3)
    one.train()
    checkpoint = saved(one, tmp_path / "checkpoint")
    wide = [{**TEAM[0]}, {**TEAM[1], "size": 11}]
    team = algorithm({"team": wide}, model_config={**NET, "initial_weights": checkpoint}, seed=4)
    wanted = learning_module(one).state_dict()
    for name in ("shared", "own"):
        found = learning_module(team, name).state_dict()
        assert found.keys() == wanted.keys()
        for key, value in found.items():
            np.testing.assert_array_equal(value.numpy(), wanted[key].numpy())
    team.train()
    # What is saved stands by itself: it does not ask for the other checkpoint again.
    assert learning_module(team, "own").get_ctor_args_and_kwargs()[1]["model_config"]["initial_weights"] is None
    later = saved(team, tmp_path / "later")
    (tmp_path / "checkpoint").rename(tmp_path / "gone")
    from safe_inspect.experiments.modules.policy import trained_policy

    assert trained_policy(later, "own")(np.zeros((2, 11), np.float32)).shape == (2, 3)


def test_weights_that_do_not_fit_are_one_message(algorithm, tmp_path):
    from safe_inspect.errors import CheckpointError

    checkpoint = saved(algorithm({"team": ONE}, model_config=NET), tmp_path / "checkpoint")
    with pytest.raises(CheckpointError, match="its weights do not match this policy"):
        algorithm({"team": CHOOSING}, model_config={**NET, "initial_weights": checkpoint})
    with pytest.raises(CheckpointError, match="nowhere"):
        algorithm({"team": ONE}, model_config={**NET, "initial_weights": str(tmp_path / "nowhere")})
    with pytest.raises(CheckpointError, match="a policy that the package ships; did you mean `burn-and-coast`"):
        algorithm({"team": ONE}, model_config={**NET, "initial_weights": "burn-and-cost"})
