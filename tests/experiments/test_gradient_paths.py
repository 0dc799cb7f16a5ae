"""By which path the fast learner computes gradients, and why: that of the shipped experiments is the quick one."""

from __future__ import annotations

import logging

import numpy as np
import pytest
from gymnasium.spaces import Box, MultiDiscrete

from safe_inspect.config.data import configs_root
from safe_inspect.config.experiment import load_experiment
from safe_inspect.experiments.settings.policies import read_policies
from safe_inspect.experiments.settings.translation import translate_rllib

EXPERIMENTS = sorted(
    f"{path.parent.name}/{path.name}"
    for path in configs_root().glob("*/experiment*.yml")
    if path.parent.name != "tumbling-rendezvous"  # missions, which learn nothing
)


NET = {"fcnet_hiddens": [8], "fcnet_activation": "tanh", "vf_share_layers": False}


def built(model, actions=None):
    """Return a policy's module that observes five numbers."""
    from safe_inspect.experiments.modules.policy import policy_spec

    spec = policy_spec(model)
    spec.observation_space = Box(-np.inf, np.inf, (5,))
    spec.action_space = actions or Box(-1.0, 1.0, (3,))
    return spec.build()


def reasons(module, together=False):
    from safe_inspect.experiments.learning.ppo_nets import nets_of

    return [net.why_autograd for net in nets_of(module, together)]


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_shipped_experiments_learn_by_the_quick_path(name):
    experiment = load_experiment(configs_root() / name)
    settings = translate_rllib(experiment.rllib).settings
    if settings["algorithm"] != "PPO":
        pytest.skip("only PPO has the fast learner")
    assert settings["learner"] == "fast"
    assert not settings.get("grad_clip")
    policies, _, _ = read_policies(experiment.policies.values(), "PPO")
    for own in [policy.config for policy in policies.values() if policy.trains] or [{}]:
        model = {**settings["model_config"], **own.get("model_config", {})}
        model.pop("initial_weights", None)  # of the task's observations
        for actions in (None, MultiDiscrete([11, 11, 11])):
            assert reasons(built(model, actions)) == ["", ""]


def test_what_autograd_learns_says_why():
    assert reasons(built(NET)) == ["", ""]
    assert reasons(built(NET), True) == ["the gradients of policy and value function are clipped together"]
    assert reasons(built({**NET, "fcnet_activation": "relu"})) == ["its layers are not linear with tanh between"] * 2
    shared = reasons(built({**NET, "vf_share_layers": True}))
    assert shared == ["its module is not RLlib's own with an encoder for each net"]


def test_layers_that_are_not_those_of_the_module_are_left_to_autograd():
    module = built(NET)
    encoder = module.encoder
    encoder.actor_encoder, encoder.critic_encoder = encoder.critic_encoder, encoder.actor_encoder
    assert reasons(module) == ["", ""]  # the module has exchanged them too
    module.pi.__class__ = type("Doubled", (type(module.pi),), {"_forward": lambda self, inputs: 2.0 * self.net(inputs)})
    assert reasons(module) == ["its module is not RLlib's own with an encoder for each net"]

    class Own(type(built(NET))):
        def compute_values(self, batch, embeddings=None):
            return 2.0 * super().compute_values(batch, embeddings)

    module = built(NET)
    module.__class__ = Own
    assert reasons(module) == ["its module is not RLlib's own with an encoder for each net"]


@pytest.mark.parametrize(
    "more", [{}, {"fcnet_activation": "relu"}, {"fcnet_use_layernorm": True}, {"free_log_std": True}]
)
def test_the_declared_layers_give_what_the_module_gives(more):
    import torch

    from safe_inspect.experiments.learning.ppo_nets import nets_of
    from safe_inspect.experiments.modules.tanh_net import PolicyNet

    module = built({**NET, "fcnet_hiddens": [16, 16], **more})
    seen = {"obs": torch.linspace(-2.0, 2.0, 16 * 5).reshape(16, 5)}
    wanted = module.forward_train(seen)["action_dist_inputs"].detach(), module.compute_values(seen).detach()
    policy, values = nets_of(module)
    torch.testing.assert_close(policy.make_pass(16).forward(seen["obs"]), wanted[0], rtol=1e-5, atol=1e-5)
    torch.testing.assert_close(values.make_pass(16).forward(seen["obs"])[:, 0], wanted[1], rtol=1e-5, atol=1e-5)
    net = PolicyNet(module, 16)
    assert net._plain is not None
    net.observations[:] = seen["obs"].numpy()
    np.testing.assert_allclose(net(True), wanted[0].numpy(), rtol=1e-5, atol=1e-5)


@pytest.mark.ray
def test_a_training_logs_its_path(algorithm, caplog):
    from dummy_environment import ONE

    told = {}
    for activation in ("tanh", "relu"):
        algo = algorithm({"team": ONE}, model_config={"fcnet_hiddens": [8], "fcnet_activation": activation})
        learner = algo.learner_group._learner
        with caplog.at_level(logging.INFO, "safe_inspect.experiments.learning.ppo_learner"):
            for steps in (500, 1000):
                episodes = algo.env_runner.sample(num_timesteps=500)
                learner.update(
                    episodes=episodes, timesteps={"num_env_steps_sampled_lifetime": steps}, num_epochs=1,
                    minibatch_size=None,
                )  # fmt: skip
        lines = [message for name, _, message in caplog.record_tuples if name.endswith("ppo_learner")]
        told[activation] = (lines, dict(learner.why_autograd))
        caplog.clear()
    name, why = "default_policy", "its layers are not linear with tanh between"
    assert told["tanh"] == ([f"{name} learns by the gradients of its layers in closed form"], {name: ""})
    assert told["relu"] == ([f"{name} learns by Torch's autograd, because {why}"], {name: why})
