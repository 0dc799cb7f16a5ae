"""The fast learner against RLlib's own: same advantages, same losses, same weights, same checkpoints."""

from __future__ import annotations

import copy
import math

import numpy as np
import pytest
from algorithms import build, parts_of, targets
from dummy_environment import CHOOSING, ONE, TEAM

pytestmark = pytest.mark.ray

TEAMS = pytest.mark.parametrize("team", [ONE, TEAM], ids=["one", "team"])


LOSSES = {
    "policy_loss",
    "vf_loss",
    "vf_loss_unclipped",
    "entropy",
    "mean_kl_loss",
    "total_loss",
    "curr_kl_coeff",
    "curr_entropy_coeff",
    "default_optimizer_learning_rate",
    "gradients_default_optimizer_global_norm",
}


def learner_of(algo):
    return algo.learner_group._learner


def weights_of(algo):
    """Return all weights, by policy and name."""
    return {
        (name, key): value.detach().clone().numpy()
        for name, module in learner_of(algo).module.items()
        for key, value in module.named_parameters()
    }


def advised(algo, episodes):
    from safe_inspect.experiments.learning.ppo_learner import batches_of

    learner = learner_of(algo)
    batches = batches_of(episodes, learner.should_module_be_updated)
    for name, batch in batches.items():
        batch.advise(learner._values(name, batch.all_observations), algo.config.gamma, algo.config.lambda_)
    return batches


def standardised_anew(learner):
    """Have RLlib standardise advantages over the steps that are learned from, without its artificial ones."""
    from ray.rllib.connectors.connector_v2 import ConnectorV2

    class Anew(ConnectorV2):
        def __call__(self, *, batch, **kwargs):
            for columns in batch.values():
                kept = columns["advantages"][columns["loss_mask"]]
                columns["advantages"] = (columns["advantages"] - kept.mean()) / kept.std(correction=0)
            return batch

    learner._learner_connector.append(Anew())


def update(algo, episodes, steps):
    return learner_of(algo).update(
        episodes=episodes, timesteps={"num_env_steps_sampled_lifetime": steps}, num_epochs=1, minibatch_size=None
    )


@TEAMS
def test_advantages_at_terminations_truncations_and_cuts(algorithm, team):
    import torch

    algo = algorithm({"drift": 0.03, "team": team})
    episodes = algo.env_runner.sample(num_timesteps=1500)
    batches = advised(algo, episodes)
    expected = {}
    kinds = set()
    for part in parts_of(episodes):
        kinds.add("terminated" if part.is_terminated else "truncated" if part.is_truncated else "cut")
        name = part.module_id or "default_policy"
        observations = torch.from_numpy(np.asarray(part.get_observations(), np.float32))
        with torch.no_grad():
            values = learner_of(algo).module[name].compute_values({"obs": observations}).numpy().astype(np.float64)
        assert abs(values[-1]) > 1e-6  # else a missing bootstrap could not be seen
        found = targets(part.get_rewards(), values, part.is_terminated, 0.99, 0.95)
        expected.setdefault(name, []).append(np.column_stack((found, found - values[:-1], part.get_rewards())))
    assert kinds == {"terminated", "truncated", "cut"}
    assert batches.keys() == expected.keys()
    for name, batch in batches.items():
        wanted, advantage, rewards = np.concatenate(expected[name]).T
        np.testing.assert_array_equal(batch.rewards, rewards.astype(np.float32))
        np.testing.assert_allclose(batch.targets, wanted, atol=1e-5)
        advantage = (advantage - advantage.mean()) / advantage.std()
        np.testing.assert_allclose(batch.advantages, advantage, atol=1e-4)


@pytest.mark.parametrize(
    ("team", "more"),
    [
        (ONE, {}),
        (TEAM, {}),
        (CHOOSING, {"entropy_coeff": 0.02}),
        (ONE, {"lr": [[0, 3e-3], [2000, 1e-3]], "entropy_coeff": [[0, 0.05], [2000, 0.01]], "vf_clip_param": 0.02}),
        (ONE, {"grad_clip": 0.05, "grad_clip_by": "global_norm"}),
        (ONE, {"grad_clip": 0.002, "grad_clip_by": "value", "use_kl_loss": False}),
        (ONE, {"model_config": {"fcnet_hiddens": [16], "vf_share_layers": True}, "log_gradients": True}),
        (ONE, {"model_config": {"fcnet_hiddens": [16], "free_log_std": True, "fcnet_activation": "relu"}}),
    ],
    ids=["one", "team", "choosing", "schedules", "norm", "value", "shared", "free"],
)
def test_whole_batch_updates_equal_those_of_rllib(algorithm, team, more):
    settings = {"lr": 2e-3, "clip_param": 0.05, **more}
    fast = algorithm({"drift": 0.03, "team": team}, **settings)
    stock = algorithm({"drift": 0.03, "team": team}, learner="stock", **settings)
    assert type(learner_of(fast)) is not type(learner_of(stock))
    standardised_anew(learner_of(stock))
    stock.learner_group.set_state(fast.learner_group.get_state())
    before = weights_of(fast)
    episodes = fast.env_runner.sample(num_timesteps=1000)
    for steps in (1000, 2000, 3000):
        mine, theirs = (
            {
                name: {key: float(value) for key, value in values.items() if not isinstance(value, dict)}
                for name, values in reduced(update(algo, copy.deepcopy(episodes), steps)).items()
            }
            for algo in (fast, stock)
        )
        for name in before_names(before):
            assert mine[name].keys() & LOSSES == theirs[name].keys() & LOSSES
            for key in mine[name].keys() & LOSSES:
                assert mine[name][key] == pytest.approx(theirs[name][key], rel=2e-3, abs=2e-5), key
    expected = weights_of(stock)
    for key, value in weights_of(fast).items():
        np.testing.assert_allclose(value, expected[key], atol=1e-5, err_msg=str(key))
    moved = [np.abs(value - before[key]).max() for key, value in expected.items()]
    assert max(moved) > 1e-3
    for name in before_names(before):
        mine, theirs = (float(learner_of(algo).curr_kl_coeffs_per_module[name]) for algo in (fast, stock))
        assert mine == theirs
        assert more.get("use_kl_loss", True) == (abs(mine - 0.2) > 1e-6)


def test_nets_by_autograd_learn_the_same(algorithm, monkeypatch):
    from safe_inspect.experiments.learning import ppo_nets

    private, plain = (algorithm({"drift": 0.03}, lr=2e-3) for _ in range(2))
    plain.learner_group.set_state(private.learner_group.get_state())
    episodes = private.env_runner.sample(num_timesteps=1000)
    before = weights_of(private)
    for steps in (1000, 2000, 3000):
        update(private, copy.deepcopy(episodes), steps)
    monkeypatch.setattr(ppo_nets, "linear_layers", lambda *_: None)
    monkeypatch.setattr(ppo_nets, "FastAdam", ppo_nets.TorchAdam)
    for steps in (1000, 2000, 3000):
        update(plain, copy.deepcopy(episodes), steps)
    expected = weights_of(private)
    for key, value in weights_of(plain).items():
        np.testing.assert_allclose(value, expected[key], atol=1e-5, err_msg=str(key))
    assert max(np.abs(value - before[key]).max() for key, value in expected.items()) > 1e-3


def before_names(weights):
    return {name for name, _ in weights}


def reduced(results):
    """Return what a learner's results come to."""
    from ray.rllib.utils.metrics.metrics_logger import MetricsLogger

    logger = MetricsLogger(root=True)
    logger.aggregate([results])
    return logger.peek()


def test_the_gradients_are_those_of_rllibs_loss():
    import torch
    from ray.rllib.core.distribution.torch.torch_distribution import TorchDiagGaussian

    from safe_inspect.experiments.learning import ppo_kernels

    generator = np.random.default_rng(3)
    count, width = 400, 3
    inputs, old = (0.5 * generator.standard_normal((count, 2 * width)) for _ in range(2))
    actions, advantages = generator.standard_normal((count, width)), generator.standard_normal(count)
    rows = generator.permutation(count)[:150]
    new = torch.tensor(inputs[rows], requires_grad=True)
    now, before = TorchDiagGaussian.from_logits(new), TorchDiagGaussian.from_logits(torch.tensor(old[rows]))
    taken, weight = torch.tensor(actions[rows]), torch.tensor(advantages[rows])
    density = before.logp(taken)
    ratio = torch.exp(now.logp(taken) - density)
    surrogate = torch.min(weight * ratio, weight * torch.clamp(ratio, 0.8, 1.2))
    loss = torch.mean(-surrogate - 0.03 * now.entropy()) + 0.4 * before.kl(now).mean()
    loss.backward()
    assert 0.2 < float(((ratio > 1.2) | (ratio < 0.8)).double().mean()) < 0.95
    all_density = np.zeros(count)
    all_density[rows] = density.numpy()
    found, sums = np.empty((150, 2 * width)), np.empty(3)
    form = ppo_kernels.Form(0, np.array([], dtype=np.int64))
    sampled = ppo_kernels.Sampled(actions, old, all_density, advantages)
    terms = ppo_kernels.Terms(0.2, 0.5, 0.7, 0.03, 0.4, True)
    ppo_kernels.policy_gradient(rows, inputs[rows], form, sampled, terms, found, sums)
    np.testing.assert_allclose(found, new.grad.numpy(), atol=1e-12)
    expected = (surrogate.mean(), now.entropy().mean(), before.kl(now).mean())
    np.testing.assert_allclose(sums / 150, [float(value) for value in expected], rtol=1e-10)

    values, goals = torch.tensor(inputs[rows, 0], requires_grad=True), torch.tensor(advantages)
    squared = (values - goals[rows]) ** 2
    (0.7 * torch.clamp(squared, 0, 0.5).mean()).backward()
    found, sums = np.empty(150), np.empty(2)
    ppo_kernels.value_gradient(rows, inputs[rows, 0], advantages, terms, found, sums)
    np.testing.assert_allclose(found, values.grad.numpy(), atol=1e-12)
    np.testing.assert_allclose(sums / 150, [float(squared.clamp(0, 0.5).mean()), float(squared.mean())], rtol=1e-10)


def test_the_gradients_of_choices_are_those_of_rllibs_loss():
    import torch
    from ray.rllib.core.distribution.torch.torch_distribution import TorchMultiCategorical

    from safe_inspect.experiments.learning import ppo_kernels

    generator = np.random.default_rng(4)
    count, sizes = 400, np.array([3, 2, 5])
    made = TorchMultiCategorical.get_partial_dist_cls(space=None, input_lens=sizes.tolist())
    inputs, old = (0.5 * generator.standard_normal((count, sizes.sum())) for _ in range(2))
    actions, advantages = generator.integers(0, sizes, (count, 3)).astype(float), generator.standard_normal(count)
    rows = generator.permutation(count)[:150]
    new = torch.tensor(inputs[rows], requires_grad=True)
    now, before = made.from_logits(new), made.from_logits(torch.tensor(old[rows]))
    taken, weight = torch.tensor(actions[rows]), torch.tensor(advantages[rows])
    density = before.logp(taken)
    ratio = torch.exp(now.logp(taken) - density)
    surrogate = torch.min(weight * ratio, weight * torch.clamp(ratio, 0.8, 1.2))
    loss = torch.mean(-surrogate - 0.03 * now.entropy()) + 0.4 * before.kl(now).mean()
    loss.backward()
    assert 0.2 < float(((ratio > 1.2) | (ratio < 0.8)).double().mean()) < 0.95
    all_density = np.zeros(count)
    all_density[rows] = density.numpy()
    found, sums = np.empty((150, sizes.sum())), np.empty(3)
    sampled = ppo_kernels.Sampled(actions, old, all_density, advantages)
    terms = ppo_kernels.Terms(0.2, 0.5, 0.7, 0.03, 0.4, True)
    ppo_kernels.policy_gradient(rows, inputs[rows], ppo_kernels.Form(0, sizes), sampled, terms, found, sums)
    np.testing.assert_allclose(found, new.grad.numpy(), atol=1e-12)
    expected = (surrogate.mean(), now.entropy().mean(), before.kl(now).mean())
    np.testing.assert_allclose(sums / 150, [float(value) for value in expected], rtol=1e-10)


@pytest.mark.parametrize(("rows", "size", "epochs"), [(100, 30, 3), (100, None, 2), (40, 64, 2), (90, 30, 1)])
def test_minibatches_use_each_step_in_each_epoch(rows, size, epochs):
    from safe_inspect.experiments.learning.ppo_learner import minibatches

    order = minibatches(rows, size, epochs, True, (5, "a policy", 7))
    assert order.shape == (math.ceil(epochs * rows / min(size or rows, rows)), min(size or rows, rows))
    used = order.ravel()
    for epoch in range(epochs):
        assert sorted(used[epoch * rows : (epoch + 1) * rows]) == list(range(rows))
    np.testing.assert_array_equal(order, minibatches(rows, size, epochs, True, (5, "a policy", 7)))
    if size is not None and size < rows:
        assert (order != minibatches(rows, size, epochs, True, (5, "a policy", 8))).any()
        assert (order[0] == np.arange(size)).sum() < size / 2


def test_nets_that_learn_side_by_side_learn_the_same(algorithm):
    found = []
    for threads in (1, 2):
        algo = algorithm({"drift": 0.03, "team": TEAM}, learner_threads=threads, num_epochs=3, minibatch_size=100)
        algo.train()
        found.append(weights_of(algo))
    for key, value in found[0].items():
        np.testing.assert_array_equal(value, found[1][key])


@TEAMS
def test_checkpoints_go_from_either_learner_to_the_other(algorithm, tmp_path, team):
    algos = {name: algorithm({"drift": 0.03, "team": team}, learner=name) for name in ("fast", "stock")}
    for name, other in (("fast", "stock"), ("stock", "fast")):
        algos[name].train()
        algos[name].save_to_path(tmp_path / name)
        algos[other].restore_from_path(str(tmp_path / name))
        mine, theirs = (learner_of(algos[key]).get_state() for key in (name, other))
        assert mine["weights_seq_no"] == theirs["weights_seq_no"]
        import tree

        for part in ("rl_module", "optimizer"):
            tree.assert_same_structure(mine[part], theirs[part])
            for a, b in zip(tree.flatten(mine[part]), tree.flatten(theirs[part]), strict=True):
                np.testing.assert_array_equal(a, b)
        before = weights_of(algos[other])
        algos[other].train()
        assert all((value != before[key]).any() for key, value in weights_of(algos[other]).items())


@TEAMS
def test_both_learners_report_the_same(algorithm, team):
    found = []
    for name in ("fast", "stock"):
        learners = algorithm({"drift": 0.03, "team": team}, learner=name, num_epochs=2).train()["learners"]
        found.append({(module, key) for module, values in learners.items() for key in values})
    constant = "diff_num_grad_updates_vs_sampler_policy"
    assert found[0] == {key for key in found[1] if "connector" not in key[1] and key[1] != constant}


def test_a_policy_that_does_not_learn_stays_as_it_is(algorithm):
    algo = algorithm({"drift": 0.03, "team": TEAM})
    learner_of(algo).config.policies_to_train = ["own"]
    before = weights_of(algo)
    algo.train()
    after = weights_of(algo)
    assert {key for key, value in before.items() if (value != after[key]).any()} == {
        key for key in before if key[0] == "own"
    }


def test_what_the_fast_learner_cannot_do_the_stock_one_does(ray_session):
    connector = "ray.rllib.connectors.learner.AddNextObservationsFromEpisodesToTrainBatch"
    algo = build({}, learner_connector=connector).build_algo()
    try:
        learners = algo.train()["learners"]
        assert "learner_connector" in "".join(learners["__all_modules__"])
        assert "policy_loss" in learners["default_policy"]
    finally:
        algo.stop()


@pytest.mark.long
def test_a_learner_in_a_separate_process(algorithm):
    algo = algorithm({"drift": 0.03}, num_learners=1)
    result = algo.train()["learners"]["default_policy"]
    assert math.isfinite(result["policy_loss"])
