"""A policy with a hurdle distribution: its loss, its checkpoint, its file, and who refuses it."""

from __future__ import annotations

import numpy as np
import pytest
from random_checkpoint import experiment_of, save_run

from safe_inspect.config.data import configs_root
from safe_inspect.errors import ConfigError

pytestmark = pytest.mark.ray

ONE = configs_root() / "translational-inspection" / "experiment-burn-and-coast.yml"
STEPS = configs_root() / "translational-inspection" / "experiment-seed.yml"


@pytest.mark.parametrize("choices", [0, 4])
def test_the_loss_and_its_gradient_are_those_of_torch(choices):
    import torch

    from safe_inspect.experiments.learning.ppo_kernels import (
        ENTROPY,
        KL,
        SURROGATE,
        Form,
        Sampled,
        Terms,
        policy_gradient,
    )  # fmt: skip
    from safe_inspect.experiments.modules.saved_policy import TorchHurdle

    kind = type("Kind", (TorchHurdle,), {"numbers": 3, "choices": choices})
    torch.manual_seed(0)
    batch, rows = 60, np.arange(7, 55)
    old = torch.randn(batch, kind.required_input_dim(None), dtype=torch.float64) * 0.7
    old_distribution = kind(old)
    actions = old_distribution.sample()
    assert 10 < int((actions[:, 0] == 0.0).sum()) < 50
    old_log = old_distribution.logp(actions)
    advantages = torch.randn(batch, dtype=torch.float64)
    inputs = (old[7:55] + 0.3 * torch.randn(48, old.shape[1], dtype=torch.float64)).requires_grad_()
    new = kind(inputs)
    ratio = torch.exp(new.logp(actions[7:55]) - old_log[7:55])
    surrogate = torch.minimum(advantages[7:55] * ratio, advantages[7:55] * ratio.clamp(0.8, 1.2))
    entropy, divergence = new.entropy(), kind(old[7:55]).kl(new)
    (-surrogate - 0.03 * entropy + 0.2 * divergence).mean().backward()
    gradient, sums = np.empty(inputs.shape), np.empty(3)
    form = Form(1, np.array([choices] if choices else [], dtype=np.int64))
    sampled = Sampled(actions.numpy(), old.numpy(), old_log.numpy(), advantages.numpy())
    terms = Terms(0.2, 1.0, 1.0, 0.03, 0.2, True)
    policy_gradient(rows, inputs.detach().numpy(), form, sampled, terms, gradient, sums)
    np.testing.assert_allclose(gradient, inputs.grad.numpy(), atol=1e-12)
    for place, wanted in ((SURROGATE, surrogate), (ENTROPY, entropy), (KL, divergence)):
        assert sums[place] == pytest.approx(float(wanted.detach().sum()), abs=1e-9)


def test_drawn_actions_have_the_density_of_torch():
    import torch

    from safe_inspect.experiments.modules.saved_policy import TorchHurdle
    from safe_inspect.random.action_draws import Hurdle, draw_in_rollout

    kind = type("Kind", (TorchHurdle,), {"numbers": 3, "choices": 4})
    inputs = np.random.default_rng(0).normal(size=(200, 11)).astype(np.float32)
    slots = np.arange(200)
    action = draw_in_rollout(Hurdle(3, 4), inputs, True, 5, slots, 0 * slots, 3)
    log = kind(torch.from_numpy(inputs.astype(np.float64))).logp(torch.from_numpy(action)).numpy()
    assert np.isfinite(log).all()


def module_of(experiment, **model):
    """Return the module that a training builds, with random weights."""
    import torch

    from safe_inspect.environments.facades.spaces import action_space, box
    from safe_inspect.environments.layout import action_layout, observation_layout
    from safe_inspect.experiments.modules.policy import policy_spec
    from safe_inspect.experiments.settings.policies import policy_info

    agent = experiment.spec.agents[0]
    info = policy_info(experiment, "default_policy", [agent]).metadata()
    torch.manual_seed(1)
    spec = policy_spec({"fcnet_hiddens": [32], "vf_share_layers": False, **model}, info=info)
    spec.observation_space = box(observation_layout(agent))
    spec.action_space = action_space(action_layout(agent))
    spec.inference_only = False
    return spec.build()


def test_a_fresh_policy_burns_as_configured():
    import torch

    module = module_of(experiment_of(path=ONE), orthogonal=True, initial_burn_probability=0.2, initial_std=0.3)
    seen = torch.zeros(1, module.observation_space.shape[0])
    inputs = module.forward_inference({"obs": seen})["action_dist_inputs"][0].detach().numpy()
    assert len(inputs) == 1 + 6 + len(experiment_of(path=ONE).spec.agents[0].glues[0].wrapped[3].durations)
    assert inputs[0] == pytest.approx(np.log(0.25), abs=1e-5)
    np.testing.assert_allclose(inputs[4:7], np.log(0.3), atol=1e-5)
    steps = module_of(experiment_of(path=STEPS), hurdle=True)
    assert steps.pi.net.mlp[-1].out_features == 7
    assert steps.model_config["policy_info"]["distribution"] == "hurdle"


@pytest.mark.parametrize(("path", "model"), [(ONE, {}), (STEPS, {"hurdle": True})], ids=["decisions", "steps"])
def test_checkpoint_and_file_fly_alike(tmp_path, path, model):
    import torch

    pytest.importorskip("onnx")
    from safe_inspect.evaluation.onnx_policy import load_onnx
    from safe_inspect.evaluation.rollouts import rollout
    from safe_inspect.experiments.export import export_policy
    from safe_inspect.experiments.modules.policy import trained_policy
    from safe_inspect.experiments.modules.sources import load_policy

    experiment = experiment_of(path=path)
    module = module_of(experiment, **model)
    with torch.no_grad():
        module.pi.net.mlp[-1].weight *= 8.0
    checkpoint = save_run(tmp_path, experiment, {"default_policy": module}, keep_info=True)
    done = export_policy(checkpoint, tmp_path / "policy.onnx")
    assert done.info.distribution == "hurdle"
    assert done.difference.passes
    for sampled in (None, True, False):
        own = trained_policy(checkpoint, sampled=sampled, seed=4)
        file = load_onnx(done.path, sampled, seed=4)
        first = rollout(experiment.spec, own, 6, seed=2)
        second = rollout(file.prepare(experiment.spec), file, 6, seed=2)
        np.testing.assert_array_equal(first.length, second.length)
        np.testing.assert_allclose(first.delta_v, second.delta_v, atol=1e-4)
        assert first.delta_v.max() > 0.0
    policies = [load_policy(source) for source in (done.path, checkpoint)]
    env = policies[0].make()
    observation, _ = env.reset(seed=1)
    actions = [policy.predict(observation) for policy in policies]
    np.testing.assert_allclose(*actions, atol=1e-5)
    assert all(env.action_space.contains(action) for action in actions)
    drawn = [
        np.stack([policy.predict(observation, generator) for _ in range(40)])
        for policy, generator in zip(policies, map(np.random.default_rng, (3, 3)), strict=True)
    ]
    np.testing.assert_allclose(*drawn, atol=1e-5)
    assert len(np.unique(drawn[0], axis=0)) > 1


@pytest.mark.parametrize(
    ("settings", "wrong"),
    [
        ({"learner": "stock"}, "`learner: stock`"),
        ({"env_runner": "stock"}, "`env_runner: stock`"),
        ({"algorithm": "APPO"}, "`algorithm: APPO`"),
    ],
)
def test_decisions_that_last_are_learned_by_our_ppo_alone(settings, wrong):
    from algorithms import build

    from safe_inspect.experiments.settings.policies import DEFAULT_MAKER

    experiment = experiment_of(path=ONE)
    with pytest.raises(ConfigError, match="decisions that last") as caught:
        build(experiment.resolved, DEFAULT_MAKER, tuple(experiment.policies.values()), **settings)
    assert wrong in str(caught.value)


def test_zero_must_be_no_thrust():
    def uneven(agent):
        agent["parts"][0]["config"]["properties"] = {"low": 0.0, "high": 0.1}

    experiment = experiment_of(uneven, path=ONE)
    with pytest.raises(ConfigError, match=r"for which X Thrust gives 0\.05 N"):
        module_of(experiment)


def test_training_continues_from_its_state(algorithm, tmp_path):
    from safe_inspect.experiments.settings.policies import DEFAULT_MAKER

    experiment = experiment_of(path=ONE)
    more = {"train_batch_size_per_learner": 400, "minibatch_size": 16, "num_envs_per_env_runner": 4, "num_epochs": 1}
    algo = algorithm(experiment.resolved, DEFAULT_MAKER, tuple(experiment.policies.values()), **more)
    first = algo.train()
    assert first["env_runners"]["num_env_steps_sampled"] == 400
    decisions = first["env_runners"]["num_module_steps_sampled"]["default_policy"]
    assert 0 < decisions < 200
    assert np.isfinite(first["learners"]["default_policy"]["policy_loss"])
    path = algo.save_to_path(str(tmp_path / "state"))
    other = algorithm(experiment.resolved, DEFAULT_MAKER, tuple(experiment.policies.values()), **more)
    other.restore_from_path(path)
    for key, value in algo.env_runner.module.state_dict().items():
        np.testing.assert_array_equal(value, other.env_runner.module.state_dict()[key])
    assert other.train()["env_runners"]["num_env_steps_sampled_lifetime"] == 800
