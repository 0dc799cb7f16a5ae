"""The term of the loss that holds a policy near the one with which its training began, and that fades."""

from __future__ import annotations

import numpy as np
import pytest
from algorithms import build
from dummy_environment import CHOOSING, ONE

from safe_inspect.errors import ConfigError
from safe_inspect.experiments.settings.translation import translate_rllib
from safe_inspect.random.action_draws import Categorical, Gaussian
from safe_inspect.random.hurdle_draws import Hurdle

pytestmark = pytest.mark.ray


class Outputs:
    """A net whose outputs are numbers of its own, one row for each row of a batch of one minibatch."""

    def __init__(self, inputs):
        import torch

        self.parameters = [torch.nn.Parameter(torch.tensor(inputs))]
        self.gradients = None

    def make_pass(self, rows):
        return self

    def forward(self, observations):
        return self.parameters[0].detach(), None

    def backward(self, gradients):
        return [gradients[0].clone()]

    def step(self, gradients):
        self.gradients = gradients[0].clone()


def torch_kind(distribution):
    from ray.rllib.core.distribution.torch.torch_distribution import TorchDiagGaussian, TorchMultiCategorical

    from safe_inspect.experiments.modules.hurdle import TorchHurdle

    if isinstance(distribution, Hurdle):
        sizes = {"numbers": distribution.numbers, "choices": distribution.choices}
        return type("Kind", (TorchHurdle,), sizes).from_logits
    if isinstance(distribution, Categorical):
        return TorchMultiCategorical.get_partial_dist_cls(space=None, input_lens=list(distribution.sizes)).from_logits
    return TorchDiagGaussian.from_logits


@pytest.mark.parametrize(
    "distribution",
    [Gaussian(3), Categorical((3, 2, 5)), Hurdle(3, 6), Hurdle(3, 0)],
    ids=["normal", "choices", "decisions", "hurdle"],
)
def test_the_gradient_is_that_of_torch(distribution):
    import torch

    from safe_inspect.experiments.learning.ppo_batch import Batch
    from safe_inspect.experiments.learning.ppo_training import INITIAL_KL, TOTAL, NetTraining, Terms

    rng, count = np.random.default_rng(2), 60
    now, old, initial = (rng.normal(size=(count, distribution.inputs)).astype(np.float32) for _ in range(3))
    kind = torch_kind(distribution)
    torch.manual_seed(0)
    before = kind(torch.tensor(old))
    actions = before.sample()
    log = before.logp(actions)
    batch = Batch(
        np.zeros((count + 1, 1), np.float32), np.array([count]), np.array([True]), actions.numpy().astype(np.float32),
        old, log.numpy(), np.zeros(count, np.float32),
    )  # fmt: skip
    batch.advantages[:] = rng.normal(size=count)
    terms = Terms(0.2, 10.0, 1.0, 0.03, 0.4, True, 0.7)
    net = Outputs(now)
    training = NetTraining(net, net, batch, np.arange(count)[None], terms, None, distribution, initial)
    training.run()

    new = torch.tensor(now.astype(np.float64), requires_grad=True)
    mine, first = kind(new), kind(torch.tensor(initial.astype(np.float64)))
    before = kind(torch.tensor(old.astype(np.float64)))
    ratio = torch.exp(mine.logp(actions) - log)
    weight = torch.tensor(batch.advantages.astype(np.float64))
    surrogate = torch.min(weight * ratio, weight * ratio.clamp(0.8, 1.2))
    held = first.kl(mine).mean()
    loss = (-surrogate - 0.03 * mine.entropy() + 0.4 * before.kl(mine)).mean() + 0.7 * held
    loss.backward()
    np.testing.assert_allclose(net.gradients.numpy(), new.grad.numpy(), rtol=1e-4, atol=2e-6)
    assert training.losses[INITIAL_KL] == pytest.approx(held.item(), rel=1e-6)
    assert training.losses[TOTAL] == pytest.approx(loss.item(), rel=1e-5)


SCHEDULE = [[0, 3.0], [1024, 1.0], [2048, 0.0]]


@pytest.mark.parametrize("team", [ONE, pytest.param(CHOOSING, marks=pytest.mark.long)], ids=["numbers", "choices"])
def test_a_policy_stays_near_its_initial_one_until_the_term_has_faded(algorithm, tmp_path, team):
    from safe_inspect.experiments.runs.checkpoints import MODULES, Checkpoint, seal_checkpoint

    first = algorithm({"team": team})
    folder = tmp_path / "first"
    (folder / MODULES).mkdir(parents=True)
    first.learner_group._learner.module["default_policy"].save_to_path(folder / MODULES / "default_policy")
    seal_checkpoint(Checkpoint(folder, 0, 0, 0.0, ""))
    model = {"fcnet_hiddens": [16, 16], "initial_weights": str(folder)}
    more = {"model_config": model, "lr": 3e-3, "num_epochs": 6, "initial_kl_coeff": SCHEDULE}
    held = algorithm({"team": team}, **more)
    free = algorithm({"team": team}, **{**more, "initial_kl_coeff": [[0, 1e-9], [100000, 1e-9]]})
    found = [[algo.train()["learners"]["default_policy"] for _ in range(6)] for algo in (held, free)]
    near, far = ([result.get("mean_initial_kl_loss") for result in results] for results in found)
    assert 0.0 < max(near[:2]) < 0.3 * max(far[:2])
    assert np.isnan(near[-1])  # the term has faded, and costs nothing any more
    assert [result["curr_initial_kl_coeff"] for result in found[0]][-1] == 0.0
    learner = held.learner_group._learner
    assert [learner._initial["default_policy"].coefficient(steps) for steps in (0, 512, 1536, 9999)] == [3, 2, 0.5, 0]


def test_mistakes_are_told_before_the_training():
    with pytest.raises(ConfigError, match="begins with fresh weights has no initial policy"):
        build({}, initial_kl_coeff=0.5)
    for more, expected in (
        ({"algorithm": "APPO"}, "only PPO has the key `initial_kl_coeff`"),
        ({"learner": "stock"}, "only the fast learner"),
        ({"num_learners": 2}, "several learners share a batch"),
        ({"model_config": {"use_lstm": True}}, "recurrent"),
    ):
        (problem,) = translate_rllib({"initial_kl_coeff": 0.5, **more}).problems
        assert expected in problem.message
        assert problem.path == "rllib_configs.initial_kl_coeff"
    (problem,) = translate_rllib({"initial_kl_coeff": [[5, 1.0]]}).problems
    assert "begins with step 0" in problem.message
