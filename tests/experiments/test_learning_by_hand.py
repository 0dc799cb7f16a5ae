"""What PPO learns from, and what it learns, in small cases: by hand, or computed a second time with plain Torch."""

from __future__ import annotations

import copy
import warnings
from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from ray.rllib.env.single_agent_episode import SingleAgentEpisode

from safe_inspect.experiments.learning import ppo_learner
from safe_inspect.experiments.learning.ppo_kernels import Batch, Terms
from safe_inspect.experiments.learning.ppo_learner import batches_of, minibatches
from safe_inspect.experiments.learning.ppo_nets import AutogradPass, Net, NetTraining, _explained, joined, part_of
from safe_inspect.experiments.modules.saved_policy import TorchHurdle
from safe_inspect.random.action_draws import Categorical, Hurdle

pytestmark = pytest.mark.ray

SEED = (5, "a policy", 7)


def batch_of(rewards: Sequence[float], lengths: Sequence[int], terminated: Sequence[bool], steps: Any = None) -> Batch:
    """Return a batch whose observations count from 0, those behind the pieces too."""
    rows, places = sum(lengths), sum(lengths) + len(lengths)
    return Batch(
        np.arange(places, dtype=np.float32)[:, None], np.array(lengths), np.array(terminated),
        np.zeros((rows, 1), np.float32), np.zeros((rows, 2), np.float32), np.zeros(rows, np.float32),
        np.array(rewards), steps=steps,
    )  # fmt: skip


def test_advantages_of_two_pieces_by_hand() -> None:
    """With gamma lambda = 1/4: a piece of two steps that is cut, and one of two steps that terminates."""
    batch = batch_of([1.0, 2.0, 3.0, 4.0], [2, 2], [False, True])
    np.testing.assert_array_equal(batch.observations[:, 0], [0, 1, 3, 4])
    assert len(batch) == 4
    batch.advise(np.array([0.5, 1.0, 2.0, 1.0, 3.0, 99.0]), 0.5, 0.5)
    # delta = 1 + 1/2 - 1/2, 2 + 1 - 1; 3 + 3/2 - 1, 4 - 3
    advantages = np.array([1.0 + 0.25 * 2.0, 2.0, 3.5 + 0.25 * 1.0, 1.0])
    np.testing.assert_allclose(batch.targets, np.add(advantages, [0.5, 1.0, 1.0, 3.0]), rtol=1e-15)
    np.testing.assert_allclose(batch.advantages, (advantages - advantages.mean()) / advantages.std(), rtol=1e-14)


def test_a_decision_discounts_what_follows_by_its_steps() -> None:
    one, other = (batch_of([1.0, 2.0], [2], [False], steps) for steps in (None, np.array([3, 2])))
    values = np.array([0.0, 8.0, 16.0])
    one.advise(values, 0.5, 0.0)
    np.testing.assert_allclose(one.targets, [1.0 + 8.0 / 2.0, 2.0 + 16.0 / 2.0], rtol=1e-15)
    other.advise(values, 0.5, 0.0)
    np.testing.assert_allclose(other.targets, [1.0 + 8.0 / 8.0, 2.0 + 16.0 / 4.0], rtol=1e-15)


def test_advantages_that_hardly_differ_are_not_blown_up() -> None:
    batch = batch_of([1.0, 1.0 + 4e-5], [1, 1], [True, True])
    batch.advise(np.zeros(4), 0.9, 0.9)
    np.testing.assert_allclose(batch.advantages, [-0.2, 0.2], rtol=1e-9)  # of the least deviation, 1e-4


def test_minibatches_without_an_order_follow_one_another() -> None:
    np.testing.assert_array_equal(minibatches(5, 3, 2, False, SEED), [[0, 1, 2], [3, 4, 0], [1, 2, 3], [4, 0, 1]])
    np.testing.assert_array_equal(minibatches(3, None, 2, True, SEED), [[0, 1, 2]] * 2)
    np.testing.assert_array_equal(minibatches(3, 9, 1, True, SEED), [[0, 1, 2]])
    np.testing.assert_array_equal(minibatches(4, 2, 1, False, SEED), [[0, 1], [2, 3]])


@given(st.integers(2, 40), st.integers(1, 50), st.integers(1, 4))
def test_epochs_are_whole_and_only_the_last_minibatch_is_filled_up(rows: int, size: int, epochs: int) -> None:
    order = minibatches(rows, size, epochs, True, SEED)
    used = order.ravel()
    assert epochs * rows <= len(used) < epochs * rows + order.shape[1]
    for first in range(0, len(used), rows):
        epoch = used[first : first + rows]
        assert len(set(epoch.tolist())) == len(epoch)
        assert set(epoch.tolist()) <= set(range(rows))


@pytest.mark.parametrize("other", [(6, "a policy", 7), (5, "another", 7), (5, "a policy", 8)])
def test_run_policy_and_update_have_orders_of_their_own(other: tuple[int, str, int]) -> None:
    assert (minibatches(40, 20, 1, True, SEED) != minibatches(40, 20, 1, True, other)).any()
    first, second = minibatches(40, 40 // 2, 2, True, SEED).reshape(2, 40)
    assert (first != second).any()


def episode(
    steps: int, first: float, weights: float | None = 4.0, decisions: Any = None, module: str | None = None
) -> SingleAgentEpisode:
    """Return an episode whose numbers count up from a first one."""
    rows = first + np.arange(steps + 1.0)[:, None]
    outputs = {"action_dist_inputs": np.repeat(20.0 * rows[:-1], 2, axis=1), "action_logp": 30.0 * rows[:-1, 0]}
    if weights is not None:
        outputs["weights_seq_no"] = np.full(steps, weights)
    if decisions is not None:
        outputs["decision_steps"] = decisions
    return SingleAgentEpisode(
        observations=rows, actions=10.0 * rows[:-1], rewards=40.0 * rows[:-1, 0], infos=[{}] * (steps + 1),
        extra_model_outputs=outputs, module_id=module, agent_id="agent", len_lookback_buffer=0,
    )  # fmt: skip


def test_pieces_of_a_policy_stand_one_behind_the_other() -> None:
    team = SimpleNamespace(
        agent_episodes={"a": episode(2, 100.0, module="own"), "b": episode(1, 200.0, module="shared")}
    )
    given_ = [
        episode(3, 0.0, 1.0), team, episode(0, 5.0), episode(1, 10.0, 9.0), episode(2, 300.0, module="left"),
    ]  # fmt: skip
    batches = batches_of(given_, lambda name: name != "left")
    assert list(batches) == ["default_policy", "own", "shared"]
    batch = batches["default_policy"]
    assert batch.lengths.tolist() == [3, 1]
    assert batch.all_observations[:, 0].tolist() == [0, 1, 2, 3, 10, 11]
    assert batch.observations[:, 0].tolist() == [0, 1, 2, 10]
    for array, factor in ((batch.actions, 10), (batch.inputs, 20), (batch.log_probabilities, 30), (batch.rewards, 40)):
        assert (array.dtype, array.flags.c_contiguous) == (np.float32, True)
        assert array.reshape(4, -1)[:, -1].tolist() == [0, factor, 2 * factor, 10 * factor]
    assert batch.steps is None


def test_steps_of_decisions() -> None:
    given_ = [episode(2, 0.0, None, np.array([3, 1])), episode(1, 5.0, 2.0, np.array([7]))]
    batch = batches_of(given_, lambda name: True)["default_policy"]
    assert batch.steps is not None
    assert batch.steps.tolist() == [3, 1, 7]


class Nets(torch.nn.Module):
    """A policy and a value function that share a layer."""

    def __init__(self, inputs: int) -> None:
        super().__init__()
        torch.manual_seed(3)
        self.body, self.policy, self.value = torch.nn.Linear(4, 6), torch.nn.Linear(6, inputs), torch.nn.Linear(6, 1)

    def forward(self, observations: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        hidden = torch.tanh(self.body(observations))
        return self.policy(hidden), self.value(hidden).squeeze(-1)

    def columns(self, observations: torch.Tensor) -> tuple[torch.Tensor, ...]:
        inputs, values = self(observations)
        return inputs, values[:, None]


class Gaussian:
    """Normal distributions of the elements of an action, from means and logarithms of deviations."""

    def __init__(self, inputs: torch.Tensor) -> None:
        mean, log_std = inputs.chunk(2, dim=-1)
        self._each = torch.distributions.Normal(mean, log_std.exp())

    def logp(self, actions: torch.Tensor) -> torch.Tensor:
        return self._each.log_prob(actions).sum(dim=-1)

    def entropy(self) -> torch.Tensor:
        return self._each.entropy().sum(dim=-1)

    def kl(self, other: Any) -> torch.Tensor:
        return torch.distributions.kl_divergence(self._each, other._each).sum(dim=-1)


class Choices:
    """A categorical distribution over 3 values and one over 2."""

    def __init__(self, inputs: torch.Tensor) -> None:
        self._each = [torch.distributions.Categorical(logits=part) for part in inputs.split([3, 2], dim=-1)]

    def logp(self, actions: torch.Tensor) -> torch.Tensor:
        return sum(one.log_prob(actions[:, k]) for k, one in enumerate(self._each))  # type: ignore[return-value]

    def entropy(self) -> torch.Tensor:
        return sum(one.entropy() for one in self._each)  # type: ignore[return-value]

    def kl(self, other: Any) -> torch.Tensor:
        pairs = zip(self._each, other._each, strict=True)
        return sum(torch.distributions.kl_divergence(one, two) for one, two in pairs)  # type: ignore[return-value]


class Burns(TorchHurdle):
    """A hurdle distribution over 2 numbers, and one of 4 choices."""

    numbers, choices = 2, 4


def actions_of(kind: Any, rows: int, generator: np.random.Generator) -> np.ndarray:
    if kind is Gaussian:
        return generator.normal(size=(rows, 2))
    if kind is Choices:
        return generator.integers(0, (3, 2), (rows, 2)).astype(np.float64)
    burns = generator.random((rows, 1)) < 0.5
    return np.column_stack((burns * generator.normal(size=(rows, 2)), generator.integers(0, 4, rows)))


@pytest.mark.parametrize(
    ("kind", "inputs", "distribution"),
    [(Gaussian, 4, None), (Choices, 5, Categorical((3, 2))), (Burns, 9, Hurdle(2, 4))],
    ids=["gaussian", "choices", "hurdle"],
)
@pytest.mark.parametrize("clipped", [True, False])
def test_minibatches_teach_what_plain_torch_learns(kind: Any, inputs: int, distribution: Any, clipped: bool) -> None:
    generator = np.random.default_rng(8)
    rows, size = 24, 8
    terms = Terms(clip=0.15, value_clip=1.5, value=0.7, entropy=0.04, divergence=0.3, measured=clipped)
    nets, plain = Nets(inputs), Nets(inputs)
    actions = actions_of(kind, rows, generator)
    old = 0.6 * generator.normal(size=(rows, inputs))
    log = kind(torch.from_numpy(old)).logp(torch.from_numpy(actions)).numpy()
    whole = generator.normal(size=(rows + 1, 4)).astype(np.float32)
    batch = Batch(
        whole, np.array([rows]), np.array([False]),
        *(array.astype(np.float32) for array in (actions, old, log, generator.normal(size=rows))),
    )  # fmt: skip
    batch.advise(generator.normal(size=rows + 1), 0.9, 0.8)
    order = minibatches(rows, size, 2, True, SEED)

    def clip(gradients: dict[Any, torch.Tensor]) -> torch.Tensor:
        norm = torch.nn.utils.get_total_norm(list(gradients.values()))
        for gradient in gradients.values():
            gradient.mul_(torch.clamp(0.2 / norm, max=1.0))
        return norm

    parameters = list(nets.parameters())
    optimiser, reference = (torch.optim.Adam(net.parameters(), lr=0.02) for net in (nets, plain))
    training = NetTraining(
        Net(lambda count: AutogradPass(nets.columns, parameters), parameters), part_of(optimiser, parameters), batch,
        order, terms, clip if clipped else None, distribution,
    )  # fmt: skip
    training.run()
    for chosen in order:
        found, values = plain(torch.from_numpy(batch.observations[chosen]))
        now, before = kind(found), kind(torch.from_numpy(batch.inputs[chosen]))
        advantages = torch.from_numpy(batch.advantages[chosen])
        ratio = torch.exp(
            now.logp(torch.from_numpy(batch.actions[chosen])) - torch.from_numpy(batch.log_probabilities)[chosen]
        )
        surrogate = torch.minimum(advantages * ratio, advantages * ratio.clamp(0.85, 1.15)).mean()
        entropy, divergence = now.entropy().mean(), before.kl(now).mean()
        errors = (values - torch.from_numpy(batch.targets[chosen])) ** 2
        value = errors.clamp(max=1.5).mean()
        total = -surrogate - 0.04 * entropy + 0.3 * divergence + 0.7 * value
        reference.zero_grad()
        total.backward()
        norm = torch.nn.utils.clip_grad_norm_(plain.parameters(), 0.2 if clipped else np.inf)
        reference.step()
    for mine, theirs in zip(nets.parameters(), plain.parameters(), strict=True):
        torch.testing.assert_close(mine, theirs, atol=2e-4, rtol=1e-3)
        torch.testing.assert_close(mine.grad, theirs.grad, atol=2e-3, rtol=1e-3)
    targets = torch.from_numpy(batch.targets[order[-1]])
    expected = {
        "total_loss": total, "policy_loss": -surrogate, "entropy": entropy, "vf_loss": value,
        "mean_kl_loss": divergence if clipped else 0.0, "vf_loss_unclipped": errors.mean(),
        "vf_explained_var": 1.0 - (targets - values).var(correction=0) / targets.var(correction=0),
    }  # fmt: skip
    assert training.losses == pytest.approx(
        {name: float(torch.as_tensor(one).detach()) for name, one in expected.items()}, abs=2e-3
    )
    assert float(errors.detach().mean()) > float(value.detach()) + 1e-2  # some of them are clipped
    assert (training.norm is not None) == clipped
    if clipped:
        assert float(training.norm) == pytest.approx(float(norm), rel=2e-3)
        assert float(norm) > 0.2


def test_nets_that_share_nothing_learn_apart_what_they_learn_together() -> None:
    generator, rows = np.random.default_rng(1), 12
    terms = Terms(clip=0.2, value_clip=2.0, value=0.5, entropy=0.01, divergence=0.2, measured=True)
    old, actions = 0.3 * generator.normal(size=(rows, 4)), generator.normal(size=(rows, 2))
    log = Gaussian(torch.from_numpy(old)).logp(torch.from_numpy(actions)).numpy()
    batch = Batch(
        generator.normal(size=(rows + 1, 4)).astype(np.float32), np.array([rows]), np.array([True]),
        *(array.astype(np.float32) for array in (actions, old, log, generator.normal(size=rows))),
    )  # fmt: skip
    batch.advise(generator.normal(size=rows + 1), 0.9, 0.8)
    order = minibatches(rows, 6, 2, True, SEED)

    def trained(policy: Any, value: Any, ways: Any) -> dict[str, float]:
        optimiser = torch.optim.Adam([*policy.parameters(), *value.parameters()], lr=0.02)
        trainings = []
        for way, parameters, *acts_and_values in ways:
            net = Net(
                lambda count, way=way, parameters=parameters: AutogradPass(way, parameters), parameters,
                *acts_and_values,
            )  # fmt: skip
            trainings.append(NetTraining(net, part_of(optimiser, parameters), batch, order, terms))
        for training in trainings:
            training.run()
        return dict(joined(trainings))

    torch.manual_seed(5)
    first = [torch.nn.Linear(4, 4), torch.nn.Linear(4, 1)]
    second = copy.deepcopy(first)
    together = trained(*first, [(
        lambda seen: (first[0](seen), first[1](seen)), [*first[0].parameters(), *first[1].parameters()]
    )])  # fmt: skip
    apart = trained(*second, [
        (lambda seen: (second[0](seen),), list(second[0].parameters()), True, False),
        (lambda seen: (second[1](seen),), list(second[1].parameters()), False, True),
    ])  # fmt: skip
    assert apart == pytest.approx(together, abs=1e-6)
    for one, other in zip(first, second, strict=True):
        for mine, theirs in zip(one.parameters(), other.parameters(), strict=True):
            torch.testing.assert_close(mine, theirs)


def test_of_targets_that_do_not_vary_nothing_is_explained() -> None:
    assert _explained(np.full(4, 2.0), np.full(4, 2.0)) == -1.0
    assert _explained(np.array([0.0, 2.0]), np.array([0.5, 1.5])) == 0.75
    assert _explained(np.array([0.0, 2.0]), np.array([3.0, 1.5])) == -1.0


def test_the_losses_of_the_nets_of_a_policy_are_added() -> None:
    trainings: Any = [
        SimpleNamespace(losses={"total": 1.0, "a": 2.0}),
        SimpleNamespace(losses={"total": 4.0, "b": 8.0}),
    ]
    assert joined(trainings) == {"total": 5.0, "a": 2.0, "b": 8.0}


class Logger:
    """Keeps what is logged."""

    def __init__(self) -> None:
        self.logged: dict[Any, Any] = {}

    def log_value(self, key: Any, value: float, **how: Any) -> None:
        assert key not in self.logged
        self.logged[key] = value, how

    def log_dict(self, values: dict[str, float], *, key: str, window: int) -> None:
        self.logged |= {(key, name): (value, {"window": window}) for name, value in values.items()}


class Learner(ppo_learner.FastPPOLearner):
    """A learner without what RLlib builds."""

    def __init__(self, **attributes: Any) -> None:
        vars(self).update(metrics=Logger(), _weights_seq_no=9, why_autograd={}, **attributes)


def test_the_steps_of_an_update_are_counted() -> None:
    learner = Learner()
    learner._log_steps("own", np.zeros((3, 20), dtype=np.int64))
    lifetime = {"reduce": "lifetime_sum", "with_throughput": True}
    assert learner.metrics.logged == {
        ("own", "weights_seq_no"): (9, {"window": 1}),
        ("own", "module_train_batch_size_mean"): (20, {"reduce": "mean"}),
        ("own", "num_module_steps_trained"): (60, {"reduce": "sum"}),
        ("own", "num_module_steps_trained_lifetime"): (60, lifetime),
        ("__all_modules__", "num_module_steps_trained_lifetime"): (60, lifetime),
        ("__all_modules__", "num_module_steps_trained"): (60, {"reduce": "sum", "with_throughput": True}),
    }


@pytest.mark.parametrize(
    ("norm", "wanted", "logged"), [(3.0, False, 3.0), (3.0, True, 3.0), (None, False, None), (None, True, 5.0)]
)
def test_the_norm_of_the_gradients_is_logged_where_it_is_known_or_wanted(
    norm: float | None, wanted: bool, logged: float | None
) -> None:
    parameters = [torch.nn.Parameter(torch.zeros(1)) for _ in range(3)]
    parameters[0].grad, parameters[2].grad = torch.tensor([3.0]), torch.tensor([-4.0])
    learner = Learner(
        config=SimpleNamespace(get_config_for_module=lambda name: SimpleNamespace(log_gradients=wanted)),
        get_optimizers_for_module=lambda name: [("adam", torch.optim.Adam(parameters))],
    )
    trainings: Any = [SimpleNamespace(losses={"total": 1.0}, norm=norm)]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        learner._log_losses("own", trainings)
    expected: dict[Any, Any] = {("own", "total"): (1.0, {"window": 1})}
    if logged is not None:
        expected["own", "gradients_adam_global_norm"] = logged, {"window": 1}
    assert learner.metrics.logged == expected
    trainings[0].losses["total"] = float("nan")
    learner.metrics.logged.clear()
    with pytest.warns(UserWarning, match="total"):
        learner._log_losses("own", trainings)


def test_values_are_those_of_the_last_net_in_parts_of_any_size(monkeypatch: pytest.MonkeyPatch) -> None:
    nets, made = Nets(4), list[int]()

    def make_pass(rows: int) -> AutogradPass:
        made.append(rows)
        return AutogradPass(nets.columns, list(nets.parameters()))

    monkeypatch.setattr(ppo_learner, "nets_of", lambda module: [None, Net(make_pass, list(nets.parameters()))])
    learner = Learner(_module={"own": SimpleNamespace(unwrapped=lambda: nets)})
    observations = np.random.default_rng(0).normal(size=(2 * 1024 + 5, 4)).astype(np.float32)
    with torch.no_grad():
        expected = nets(torch.from_numpy(observations))[1].numpy()
    np.testing.assert_allclose(learner._values("own", observations), expected, atol=1e-6)
    assert sorted(made) == [5, 1024]
    np.testing.assert_allclose(learner._values("own", observations[:7]), expected[:7], atol=1e-6)


@pytest.mark.parametrize(("threads", "expected"), [(None, None), (1, None), (2, 2), (9, 3)])
def test_nets_learn_side_by_side_in_as_many_threads_as_asked(
    monkeypatch: pytest.MonkeyPatch, threads: int | None, expected: int | None
) -> None:
    ran, pools = list[str](), list[int]()

    class Training(NetTraining):
        def __init__(self, name: str) -> None:
            self.name = name

        def run(self) -> None:
            ran.append(self.name)

    class Pool:
        def __init__(self, count: int, name: str, initializer: Any, values: tuple[int]) -> None:
            assert (initializer, values) == (torch.set_num_threads, (torch.get_num_threads(),))
            pools.append(count)

        def __enter__(self) -> Pool:
            return self

        def __exit__(self, *_: object) -> None: ...

        def map(self, function: Any, trainings: Any) -> Any:
            assert function is NetTraining.run
            return (training.run() for training in trainings)

    monkeypatch.setattr(ppo_learner, "ThreadPoolExecutor", Pool)
    settings = {} if threads is None else {ppo_learner.THREADS: threads}
    Learner(config=SimpleNamespace(learner_config_dict=settings))._run([Training(name) for name in "abc"])
    assert ran == ["a", "b", "c"]
    assert pools == ([] if expected is None else [expected])


def test_a_batch_of_nothing_goes_to_rllibs_learner(monkeypatch: pytest.MonkeyPatch) -> None:
    stock, own = list[Any](), list[Any]()

    class Served(Learner):
        def should_module_be_updated(self, name: str) -> bool:
            return True

        def _learn(self, batches: Any, steps: int, **keywords: Any) -> str:
            own.append((len(batches["default_policy"]), steps, keywords))
            return "own"

    def update(self: Any, *arguments: Any, **keywords: Any) -> str:
        stock.append((arguments, keywords))
        return "stock"

    monkeypatch.setattr(ppo_learner.PPOTorchLearner, "update", update)
    learner, episodes = Served(), [episode(3, 0.0), episode(2, 0.0)]
    assert learner.update(episodes=episodes, num_epochs=4) == "own"
    assert own.pop() == (5, 5, {"episodes": episodes, "num_epochs": 4})
    called = list[str]()
    data = SimpleNamespace(
        validate=lambda: called.append("validate"), solve_refs=lambda: called.append("solve"), episodes=episodes[:1]
    )
    assert learner.update(training_data=data) == "own"
    assert (own.pop()[:2], called) == ((3, 3), ["validate", "solve"])
    assert learner.update(episodes=[]) == "stock"
    assert (len(stock), own) == (1, [])
