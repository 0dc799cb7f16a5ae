"""The fast learner in this process, without Ray: minibatches against PPO in plain Torch, its terms and its counts."""

from __future__ import annotations

import copy
import logging
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
from algorithms import build, parts_of, targets
from dummy_environment import ONE, TEAM
from ray.rllib.core.distribution.torch.torch_distribution import TorchDiagGaussian

from safe_inspect.experiments.learning import ppo_learner
from safe_inspect.experiments.learning.ppo_kernels import Terms
from safe_inspect.experiments.learning.ppo_learner import batches_of, minibatches
from safe_inspect.experiments.sampling.env_runners import BatchedEnvRunner, BatchedTeamRunner

pytestmark = [pytest.mark.ray, pytest.mark.filterwarnings("ignore")]

SETTINGS = {"lr": 3e-3, "clip_param": 0.1, "vf_clip_param": 0.05, "vf_loss_coeff": 0.6, "entropy_coeff": 0.03}


def learner_of(team: Any, **more: Any) -> tuple[Any, Any]:
    """Return a learner, and a runner for it."""
    config = build({"drift": 0.03, "team": team}, **{**SETTINGS, "seed": 5, **more})
    torch.manual_seed(2)
    runner = (BatchedEnvRunner if len(team) == 1 else BatchedTeamRunner)(config=config)
    learner = config.build_learner(env=None, spaces=runner.get_spaces())
    runner.set_state({"rl_module": learner.get_state()["rl_module"], "weights_seq_no": 0})
    return learner, runner


def learned(module: Any, parts: list[Any], seed: tuple[int, str, int], clip: Any, kl: float) -> Any:
    """Return a module after an update of two epochs in minibatches of 64, with autograd and Torch's Adam."""
    seen, acted, old, log, advantages, wanted = ([] for _ in range(6))
    for part in parts:
        observations = torch.from_numpy(part.get_observations())
        with torch.no_grad():
            values = module.compute_values({"obs": observations}).numpy().astype(np.float64)
        found = targets(part.get_rewards(), values, part.is_terminated, 0.99, 0.95)
        for whole, piece in (
            (seen, observations[:-1]), (acted, part.get_actions()), (wanted, found), (advantages, found - values[:-1]),
            (old, part.get_extra_model_outputs("action_dist_inputs")),
            (log, part.get_extra_model_outputs("action_logp")),
        ):  # fmt: skip
            whole.append(torch.as_tensor(piece, dtype=torch.float32))
    seen, acted, old, log, advantages, wanted = map(torch.cat, (seen, acted, old, log, advantages, wanted))
    advantages = (advantages - advantages.mean()) / advantages.std(correction=0)
    optimiser = torch.optim.Adam(module.parameters(), lr=3e-3)
    for rows in map(torch.from_numpy, minibatches(len(seen), 64, 2, True, seed)):
        batch = {"obs": seen[rows]}
        now = TorchDiagGaussian.from_logits(module.forward_train(batch)["action_dist_inputs"])
        before = TorchDiagGaussian.from_logits(old[rows])
        ratio = torch.exp(now.logp(acted[rows]) - log[rows])
        surrogate = torch.minimum(advantages[rows] * ratio, advantages[rows] * ratio.clamp(0.9, 1.1))
        errors = (module.compute_values(batch) - wanted[rows]) ** 2
        loss = -surrogate - 0.03 * now.entropy() + kl * before.kl(now) + 0.6 * errors.clamp(max=0.05)
        optimiser.zero_grad()
        loss.mean().backward()
        clip(list(module.parameters()))
        optimiser.step()
    return module


def by_norm(parameters: list[Any]) -> None:
    for parameter in parameters:
        torch.nn.utils.clip_grad_norm_(parameter, 0.05)


@pytest.mark.parametrize(
    ("team", "more", "clip"),
    [
        (ONE, {"use_kl_loss": False}, lambda parameters: None),
        (TEAM, {"kl_coeff": 0.3}, lambda parameters: None),
        (ONE, {"kl_coeff": 0.3, "grad_clip": 0.1, "grad_clip_by": "global_norm"},
         lambda parameters: torch.nn.utils.clip_grad_norm_(parameters, 0.1)),
        (ONE, {"kl_coeff": 0.3, "grad_clip": 0.05, "grad_clip_by": "norm"}, by_norm),
        (TEAM, {"kl_coeff": 0.3, "grad_clip": 0.01, "grad_clip_by": "value"},
         lambda parameters: torch.nn.utils.clip_grad_value_(parameters, 0.01)),
    ],
    ids=["plain", "team", "global norm", "norm", "value"],
)  # fmt: skip
def test_minibatches_teach_what_ppo_in_plain_torch_learns(team: Any, more: dict[str, Any], clip: Any) -> None:
    learner, runner = learner_of(team, **more)
    assert learner.why_autograd == {}
    episodes = runner.sample(num_timesteps=320)
    before = {name: copy.deepcopy(module.unwrapped()) for name, module in learner.module.items()}
    kl = 0.0 if more.get("use_kl_loss") is False else 0.3
    for name, module in before.items():
        own = [part for part in parts_of(episodes) if (part.module_id or "default_policy") == name]
        before[name] = learned(module, own, (5, name, 1), clip, kl)
    found = learner.update(
        episodes=episodes, timesteps={"num_env_steps_sampled_lifetime": 320}, num_epochs=2, minibatch_size=64,
        shuffle_batch_per_epoch=True,
    )  # fmt: skip
    for name, module in before.items():
        for mine, theirs in zip(learner.module[name].unwrapped().parameters(), module.parameters(), strict=True):
            torch.testing.assert_close(mine, theirs, atol=3e-4, rtol=1e-3)
        steps = sum(len(part) for part in parts_of(episodes) if (part.module_id or "default_policy") == name)
        trained = 64 * -(-2 * steps // 64)
        assert found[name]["num_module_steps_trained"].peek() == trained
        assert found[name]["module_train_batch_size_mean"].peek() == 64
        assert found[name]["weights_seq_no"].peek() == 1
        norm = found[name].get("gradients_default_optimizer_global_norm")
        assert (norm is not None) == (more.get("grad_clip_by") == "global_norm")
    assert found["__all_modules__"]["num_env_steps_trained"].peek() == 2 * sum(map(len, episodes)) == 640
    assert set(learner.why_autograd) == set(before)
    assert [bool(why) for why in learner.why_autograd.values()] == [
        more.get("grad_clip_by") == "global_norm" for _ in before
    ]


def test_the_terms_of_the_loss_are_those_of_the_configuration() -> None:
    schedule = [[0, 0.05], [1000, 0.01]]
    learner, runner = learner_of(ONE, entropy_coeff=schedule, kl_coeff=0.3)
    batch = batches_of(runner.sample(num_timesteps=160), lambda name: True)["default_policy"]
    order = minibatches(len(batch), 32, 1, True, (5, "default_policy", 1))
    wanted = Terms(clip=0.1, value_clip=0.05, value=0.6, entropy=0.05, divergence=0.3, measured=True)
    found = [training.terms for training in learner._trainings("default_policy", batch, order)]
    assert [tuple(terms) for terms in found] == [pytest.approx(tuple(wanted))] * 2
    learner.entropy_coeff_schedulers_per_module["default_policy"].update(500)
    (policy, _) = learner._trainings("default_policy", batch, order)
    assert policy.terms.entropy == pytest.approx(0.03)
    without, _ = learner_of(ONE, use_kl_loss=False)
    (policy, _) = without._trainings("default_policy", batch, order)
    assert (policy.terms.divergence, policy.terms.measured, policy.clip_gradients) == (0.0, False, None)
    clipping, _ = learner_of(ONE, grad_clip=0.5, grad_clip_by="global_norm")
    (only,) = clipping._trainings("default_policy", batch, order)
    gradients = {"a": torch.tensor([3.0]), "b": torch.tensor([4.0])}
    assert float(only.clip_gradients(gradients)) == pytest.approx(5.0)
    assert [float(one) for one in gradients.values()] == pytest.approx([0.3, 0.4])


def test_without_more_a_batch_is_learned_once_and_whole() -> None:
    learner, runner = learner_of(ONE)
    episodes = runner.sample(num_timesteps=160)
    told: list[Any] = []
    learner.before_gradient_based_update = lambda **given: told.append(("before", given))
    learner.after_gradient_based_update = lambda **given: told.append(("after", given))
    found = learner.update(episodes=episodes)["default_policy"]
    learner.update(episodes=episodes, timesteps={"steps": 9})
    assert told == [(when, {"timesteps": given}) for given in ({}, {"steps": 9}) for when in ("before", "after")]
    assert (found["num_module_steps_trained"].peek(), found["module_train_batch_size_mean"].peek()) == (160, 160)
    assert learner.update(episodes=episodes, _no_metrics_reduce=True) is None
    assert learner.update(episodes=episodes, minibatch_size=40)["default_policy"]["weights_seq_no"].peek() == 4


def test_a_learner_in_a_process_of_its_own_sets_its_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    learner, _ = learner_of(ONE)
    threads: list[Any] = []
    monkeypatch.setattr(ppo_learner, "set_threads", threads.append)
    learner.build()
    assert not threads
    learner.config = learner.config.copy(copy_frozen=False)
    learner.config.num_learners = 1
    learner.build()
    assert threads == [learner.config.env_config]


def test_the_path_of_each_policy_is_told_once(caplog: pytest.LogCaptureFixture) -> None:
    learner = SimpleNamespace(why_autograd={})
    with caplog.at_level(logging.INFO, logger=ppo_learner.__name__):
        for name, why in (("a", ""), ("a", ""), ("b", "of a reason"), ("a", "of another"), ("a", "of another")):
            ppo_learner.FastPPOLearner._log_path(learner, name, why)  # type: ignore[arg-type]
    assert [(record.levelname, record.getMessage().split()[0]) for record in caplog.records] == [
        ("INFO", "a"), ("WARNING", "b"), ("WARNING", "a"),
    ]  # fmt: skip
    assert learner.why_autograd == {"a": "of another", "b": "of a reason"}


def test_policies_that_do_not_learn_are_left_to_rllib(monkeypatch: pytest.MonkeyPatch) -> None:
    learner, runner = learner_of(TEAM)
    episodes = runner.sample(num_timesteps=160)
    asked: list[Any] = []
    monkeypatch.setattr(ppo_learner.PPOTorchLearner, "update", lambda self, **keywords: asked.append(keywords))
    monkeypatch.setattr(learner, "should_module_be_updated", lambda name, batch=None: False)
    learner.update(episodes=episodes)
    assert asked == [{"episodes": episodes}]
