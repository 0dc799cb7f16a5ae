"""Policies that fly, with made-up nets: what a loop, a rollout and the batched sampler make of their outputs."""

from __future__ import annotations

import itertools
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
from random_checkpoint import SHIPPED, TEAM, discrete, experiment_of, make_module, scaled, single_run
from ray.rllib.core.columns import Columns

from safe_inspect.config.spec import PolicySpec
from safe_inspect.environments.layout import action_layout, observation_layout
from safe_inspect.errors import ArgumentError, CheckpointError, SafeInspectError
from safe_inspect.experiments.modules import checkpoints, policy, sources
from safe_inspect.experiments.modules.checkpoints import check_frozen, known_info
from safe_inspect.experiments.modules.policy import FrozenPolicy, TrainedPolicy, frozen_spec
from safe_inspect.experiments.modules.saved_policy import BestChoices, TorchHurdle, distribution_of_module
from safe_inspect.experiments.modules.sources import LoadedPolicy, load_policy
from safe_inspect.experiments.modules.tanh_net import LEAST_ROWS, PolicyNet
from safe_inspect.random.action_draws import NO_NOISE, Categorical, Gaussian, Hurdle, draw_choices, draw_in_rollout

pytestmark = pytest.mark.ray


@pytest.fixture(scope="module")
def continuous() -> Any:
    return experiment_of(path=SHIPPED)


@pytest.fixture(scope="module")
def levels() -> Any:
    return experiment_of(discrete, SHIPPED)


class Pilot:
    """A policy that returns the first elements of its observation and records its arguments."""

    def __init__(self, recurrent: bool = False) -> None:
        self.recurrent, self.told = recurrent, list[Any]()

    def __call__(self, rows: np.ndarray) -> np.ndarray:
        assert rows.dtype == np.float32
        return rows[:, :3].astype(np.float64)

    def draw(self, rows: np.ndarray, seed: int) -> np.ndarray:
        self.told.append(seed)
        return -self(rows)

    def reset(self, rows: Any) -> None:
        self.told.append(rows if rows is None else rows.tolist())


def loaded(experiment: Any, pilot: Pilot) -> LoadedPolicy:
    return LoadedPolicy(experiment.spec, experiment.spec.agents[0], pilot)


def test_actions_are_clipped_where_they_are_numbers_and_whole_where_they_are_levels(
    continuous: Any, levels: Any
) -> None:
    agent = continuous.spec.agents[0]
    size, layout = observation_layout(agent).size, action_layout(agent)
    seen = np.random.default_rng(0).normal(scale=3.0, size=(20, size))
    pilot = Pilot()
    flying = loaded(continuous, pilot)
    assert (flying.agent, flying.spec, flying.recurrent) == (agent.name, continuous.spec, False)
    actions = flying.predict(seen)
    np.testing.assert_allclose(actions, np.clip(seen[:, :3], layout.low, layout.high), rtol=1e-6)
    assert actions.dtype == np.float32
    assert (actions == layout.high).any()
    np.testing.assert_array_equal(flying.predict(seen[4]), actions[4])
    np.testing.assert_array_equal(flying.predict(seen[4].tolist(), episode_start="ignored"), actions[4])
    assert pilot.told == []
    drawn = flying.predict(seen, np.random.default_rng(6))
    np.testing.assert_allclose(drawn, np.clip(-seen[:, :3], layout.low, layout.high), rtol=1e-6)
    assert pilot.told == [int(np.random.default_rng(6).integers(2**63))]
    whole = np.arange(2.0 * observation_layout(levels.spec.agents[0]).size).reshape(2, -1)
    chosen = loaded(levels, Pilot()).predict(whole)
    assert chosen.dtype == np.int64
    np.testing.assert_array_equal(chosen, whole[:, :3])
    for wrong in (seen[0, 1:], seen[None], 3.0, "abc"):
        with pytest.raises(ArgumentError):
            flying.predict(wrong)  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="deterministic"):
        flying.predict(seen, deterministic=True)


def test_a_recurrent_policy_is_told_where_episodes_begin(continuous: Any) -> None:
    pilot = Pilot(recurrent=True)
    flying, size = loaded(continuous, pilot), observation_layout(continuous.spec.agents[0]).size
    rows = np.zeros((3, size))
    for first in (rows[:1], rows):
        with pytest.raises(ArgumentError, match="episode_start"):
            flying.predict(first, episode_start=False)
    flying.predict(rows, episode_start=np.array([True, True, True]))
    flying.predict(rows, episode_start=np.array([False, True, False]))
    flying.predict(rows, episode_start=False)
    flying.predict(rows, episode_start=True)
    assert pilot.told == [None, [False, True, False], [False] * 3, None]
    wrong = (None, np.ones(3), np.ones(2, dtype=bool), [[True, True, True]])
    for starts in wrong:
        with pytest.raises(ArgumentError, match="episode_start"):
            flying.predict(rows, episode_start=starts)  # type: ignore[arg-type]
    for count, starts in ((2, False), (4, np.array([True, False, True, True]))):
        with pytest.raises(ArgumentError, match="episode_start"):
            flying.predict(np.zeros((count, size)), episode_start=starts)
    assert len(pilot.told) == 4
    flying.predict(rows[0], episode_start=True)
    flying.predict(rows[0], episode_start=np.array(False))
    assert pilot.told[4:] == [None, [False]]


def test_a_policy_is_loaded_for_the_agent_that_it_flies(monkeypatch: pytest.MonkeyPatch) -> None:
    spec = experiment_of(path=TEAM).spec
    first, second, third = [agent.name for agent in spec.agents]
    one, other, asked = Pilot(), Pilot(), list[Any]()
    found: Any = one

    def opened(sources: Any, wanted: Any) -> Any:
        asked.append((sources, wanted.cfg, wanted.overrides, wanted.sampled))
        return [SimpleNamespace(experiment=SimpleNamespace(spec=spec), policies=found)]

    monkeypatch.setattr(sources, "open_candidates", opened)
    assert load_policy("here", "cfg", ["a=1"]).agent == first
    assert asked == [(["here"], "cfg", ("a=1",), False)]
    assert load_policy(Path("here"), agent=third).agent == third
    found = {second: one, third: one}
    assert load_policy("here").agent == second
    found = {second: one, third: other}
    with pytest.raises(SafeInspectError, match="`agent`"):
        load_policy("here")
    assert load_policy("here", agent=third)._policy is other
    with pytest.raises(SafeInspectError, match=first):
        load_policy("here", agent=first)
    with pytest.raises(ArgumentError):
        load_policy(3)  # type: ignore[arg-type]
    asked.clear()
    with pytest.raises(SafeInspectError, match="RandomThrust"):
        load_policy("RandomThrust")
    assert not asked


class Cell:
    """A stand-in for a recurrent module: returns the scaled sum of its observations and counts its steps."""

    def __init__(self, recurrent: bool) -> None:
        self.recurrent, self.model_config = recurrent, dict[str, Any]()

    def eval(self) -> Cell:
        return self

    def is_stateful(self) -> bool:
        return self.recurrent

    def get_initial_state(self) -> Any:
        return {"h": {"sum": np.full(5, 0.25, np.float32)}, "count": np.zeros((), np.float32)}

    def forward_inference(self, batch: Any) -> Any:
        seen = batch[Columns.OBS]
        if not self.recurrent:
            return {Columns.ACTION_DIST_INPUTS: seen[:, :5]}
        state, seen = batch[Columns.STATE_IN], seen[:, 0]
        assert batch[Columns.OBS].shape == (len(seen), 1, 6)
        total, count = state["h"]["sum"] + seen[:, :5], state["count"] + 1.0
        outputs = (total * count[:, None])[:, None]
        return {Columns.ACTION_DIST_INPUTS: outputs, Columns.STATE_OUT: {"h": {"sum": total}, "count": count}}


def trained(monkeypatch: pytest.MonkeyPatch, distribution: Any, recurrent: bool = False, **more: Any) -> TrainedPolicy:
    monkeypatch.setattr(policy, "distribution_of_module", lambda module: distribution)
    return TrainedPolicy(Cell(recurrent), **more)


def test_a_recurrent_policy_keeps_the_state_of_each_row(monkeypatch: pytest.MonkeyPatch) -> None:
    flying, seen = trained(monkeypatch, Categorical((3, 2)), True), np.arange(18, dtype=np.float32).reshape(3, 6)
    mine = seen[:, :5]
    assert flying.recurrent
    threads = torch.get_num_threads()
    np.testing.assert_allclose(flying.inputs(seen), 0.25 + mine)
    np.testing.assert_allclose(flying.inputs(seen), 2.0 * (0.25 + 2.0 * mine))
    flying.reset(np.array([False, True, False]))
    expected = 3.0 * (0.25 + 3.0 * mine)
    expected[1] = 0.25 + mine[1]
    np.testing.assert_allclose(flying.inputs(seen), expected)
    np.testing.assert_allclose(flying.inputs(seen[:2]), 0.25 + mine[:2])  # another number of rows
    np.testing.assert_allclose(flying.inputs(seen), 0.25 + mine)
    flying.reset()
    flying.reset(np.array([True, False, False]))
    np.testing.assert_allclose(flying.inputs(seen), 0.25 + mine)
    flying.begin(SimpleNamespace(slots=np.arange(3), deputies=np.zeros(3)))  # type: ignore[arg-type]
    np.testing.assert_allclose(flying.inputs(seen), 0.25 + mine)
    assert torch.get_num_threads() == threads
    with pytest.raises(ArgumentError):
        flying.inputs(np.full((1, 6), np.nan, dtype=np.float32))


@pytest.mark.parametrize(
    "distribution", [Categorical((3, 2)), Hurdle(2), Gaussian(2)], ids=["levels", "hurdle", "numbers"]
)
@pytest.mark.parametrize("sampled", [None, True, False])
def test_a_rollout_draws_what_the_policy_says(monkeypatch: pytest.MonkeyPatch, distribution: Any, sampled: Any) -> None:
    seen = np.random.default_rng(1).normal(size=(40, 6)).astype(np.float32)
    monkeypatch.setattr(Cell, "forward_inference", lambda self, batch: {
        Columns.ACTION_DIST_INPUTS: batch[Columns.OBS][:, : distribution.inputs]
    })  # fmt: skip
    flying = trained(monkeypatch, distribution, sampled=sampled, seed=8)
    inputs = seen[:, : distribution.inputs]
    flight: Any = SimpleNamespace(slots=100 + np.arange(40), deputies=np.arange(40) % 3)
    nowhere = np.arange(40), np.zeros(40, dtype=np.int64)
    choosing = not isinstance(distribution, Gaussian)
    quiet = distribution.without_noise(inputs) if sampled is None and isinstance(distribution, Hurdle) else inputs
    for begun, (slots, deputies) in ((False, nowhere), (True, (flight.slots, flight.deputies))):
        if begun:
            flying.begin(flight)
        drawn = sampled if sampled is not None else begun and choosing
        for step in range(2):
            expected = draw_in_rollout(distribution, quiet, drawn, 8, slots, deputies, step)
            np.testing.assert_array_equal(flying(seen), expected)
    chosen = flying.draw(seen, 12)
    np.testing.assert_array_equal(chosen, draw_choices(distribution, inputs, 12))
    assert (chosen != flying.draw(seen, 13)).any() == choosing
    flying.begin(flight)
    one = flying(seen)
    flying.begin(SimpleNamespace(slots=flight.slots[7:8], deputies=flight.deputies[7:8]))  # type: ignore[arg-type]
    np.testing.assert_array_equal(flying(seen[7:8]), one[7:8])


def test_a_policy_without_a_known_distribution_does_not_fly(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(CheckpointError):
        trained(monkeypatch, None)


@pytest.mark.parametrize("change", [None, discrete], ids=["numbers", "levels"])
def test_a_frozen_policy_explores_without_noise(change: Any) -> None:
    agent = experiment_of(change, SHIPPED).spec.agents[0]
    module = make_module(agent, module_class=FrozenPolicy)
    batch = {Columns.OBS: torch.randn(7, observation_layout(agent).size)}
    plain = module.forward_inference(batch)[Columns.ACTION_DIST_INPUTS]
    found = module.forward_exploration(batch)[Columns.ACTION_DIST_INPUTS]
    if change is None:
        plain = torch.cat((plain[:, :3], torch.full((7, 3), NO_NOISE)), dim=1)
    torch.testing.assert_close(found, plain, rtol=0.0, atol=0.0)


@pytest.fixture(scope="module")
def checkpoint(tmp_path_factory: pytest.TempPathFactory, continuous: Any) -> Path:
    return single_run(tmp_path_factory.mktemp("frozen") / "run", continuous, seed=4)


def frozen_of(checkpoint: Path, *agents: str) -> PolicySpec:
    return PolicySpec("old", agents, "", {}, checkpoint=str(checkpoint), source_policy="default_policy")


def test_a_frozen_policy_has_the_weights_of_its_checkpoint(checkpoint: Path, continuous: Any) -> None:
    saved = make_module(continuous.spec.agents[0], seed=4).state_dict()
    spec = frozen_spec(frozen_of(checkpoint))
    assert spec.module_class is FrozenPolicy
    torch.manual_seed(11)
    module = spec.build()
    found = module.state_dict()
    assert found.keys() == saved.keys()
    assert all(torch.equal(value, saved[name]) for name, value in found.items())
    assert "frozen_from" not in module.model_config
    assert module.model_config["fcnet_hiddens"] == [32, 32]
    spec.inference_only = True  # a runner gets its weights from the learner
    runner = spec.build().state_dict()
    assert not torch.equal(runner["pi.net.mlp.0.weight"], saved["pi.net.mlp.0.weight"])


def test_frozen_policies_fit_the_agents_that_they_fly(
    checkpoint: Path, continuous: Any, levels: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    agent = continuous.spec.agents[0].name
    mine, others = ({agent: one.spec.agents[0]} for one in (continuous, levels))
    check_frozen(frozen_of(checkpoint, agent), mine)
    check_frozen(PolicySpec("new", (agent,), "PPO", {}), others)
    with pytest.raises(CheckpointError, match="action"):
        check_frozen(frozen_of(checkpoint, agent), others)
    units = {agent: experiment_of(scaled, SHIPPED).spec.agents[0]}  # as many elements, which mean other things
    with pytest.raises(CheckpointError):
        check_frozen(frozen_of(checkpoint, agent), units)
    read = checkpoints.read_weights
    for name in ("choices", "twin_q"):

        def marked(path: Path, name: str = name) -> Any:
            weights = read(path)
            return type(weights)(**{**vars(weights), "model": {**weights.model, name: True}})

        monkeypatch.setattr(checkpoints, "read_weights", marked)
        with pytest.raises(CheckpointError, match="PPO"):
            check_frozen(frozen_of(checkpoint, agent), mine)


def test_a_checkpoint_gives_its_policy(checkpoint: Path, continuous: Any) -> None:
    saved = make_module(continuous.spec.agents[0], seed=4)
    found = policy.trained_policy(checkpoint, "default_policy", sampled=True, seed=7)
    assert (found.sampled, found.seed, found.recurrent) == (True, 7, False)
    assert known_info(found.module.model_config, "").distribution == "gaussian"
    seen = np.random.default_rng(3).normal(size=(5, observation_layout(continuous.spec.agents[0]).size))
    seen = seen.astype(np.float32)
    with torch.no_grad():
        wanted = saved.forward_inference({Columns.OBS: torch.from_numpy(seen)})[Columns.ACTION_DIST_INPUTS]
    np.testing.assert_allclose(found.inputs(seen), wanted, atol=1e-6)
    with pytest.raises(CheckpointError, match="another"):
        policy.trained_policy(checkpoint, "another")


def test_a_policy_computes_in_one_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    flying, threads, before = trained(monkeypatch, Categorical((3, 2))), list[int](), torch.get_num_threads()
    forward = flying.module.forward_inference
    flying.module.forward_inference = lambda batch: threads.append(torch.get_num_threads()) or forward(batch)
    torch.set_num_threads(2)
    try:
        flying.inputs(np.zeros((1, 6), dtype=np.float32))
        assert (threads, torch.get_num_threads()) == ([1], 2)
    finally:
        torch.set_num_threads(before)


@pytest.mark.parametrize(
    ("model", "kind", "numbers", "choices"),
    [({}, Gaussian, 0, 0), ({"hurdle": True}, Hurdle, 3, 0), ({"hurdle": True, "coasts": 4}, Hurdle, 2, 4)],
)
def test_a_module_has_the_distribution_of_its_settings(
    continuous: Any, model: dict[str, Any], kind: Any, numbers: int, choices: int
) -> None:
    agent = continuous.spec.agents[0]
    plain = make_module(agent)
    module = type(plain)(
        observation_space=plain.observation_space, action_space=plain.action_space,
        model_config={**plain.model_config, **model},
    )  # fmt: skip
    found = distribution_of_module(module)
    assert type(found) is kind
    if kind is Hurdle:
        assert (found.numbers, found.choices) == (numbers, choices)  # type: ignore[union-attr]
        outputs = module.forward_inference({Columns.OBS: torch.zeros(2, observation_layout(agent).size)})
        assert outputs[Columns.ACTION_DIST_INPUTS].shape == (2, 1 + 2 * numbers + choices)


@pytest.mark.parametrize("choices", [(4,), (3, 2), (2, 3, 4)])
def test_the_best_choice_of_each_element_is_that_of_the_best_combination(choices: tuple[int, ...]) -> None:
    values = torch.randn(6, int(np.prod(choices)))
    found = BestChoices(choices)(values).split(list(choices), dim=-1)
    combinations = list(itertools.product(*map(range, choices)))  # the last varies fastest
    for row in range(6):
        best = combinations[int(values[row].argmax())]
        assert tuple(int(part[row].argmax()) for part in found) == best
        for element, count in enumerate(choices):
            for choice in range(count):
                wanted = [k for k, one in enumerate(combinations) if one[element] == choice]
                assert float(found[element][row, choice]) == float(values[row, wanted].max())


class TwoNumbers(TorchHurdle):
    numbers, choices = 2, 3


class Numbers(TorchHurdle):
    numbers, choices = 2, 0


def test_a_hurdle_distribution_has_the_density_that_its_draws_have() -> None:
    p, log_std = 0.3, np.log([0.5, 2.0])
    shares = np.array([0.2, 0.5, 0.3])
    logits = np.concatenate([[np.log(p / (1.0 - p))], [1.0, -2.0], log_std, np.log(shares) + 0.7])
    kind = TwoNumbers(torch.tensor(logits)[None])
    torch.manual_seed(2)
    drawn = kind.sample(sample_shape=torch.Size([20_000]))[:, 0]
    assert drawn.shape == (20_000, 3)
    burns = (drawn[:, :2] != 0.0).any(dim=1)
    assert torch.equal(burns, (drawn[:, :2] != 0.0).all(dim=1))
    assert float(burns.double().mean()) == pytest.approx(p, abs=0.014)
    np.testing.assert_allclose(drawn[burns, :2].mean(dim=0), [1.0, -2.0], atol=0.1)
    np.testing.assert_allclose(drawn[burns, :2].std(dim=0), [0.5, 2.0], rtol=0.05)
    counts = np.bincount(drawn[:, 2].long().numpy(), minlength=3) / 20_000
    np.testing.assert_allclose(counts, shares, atol=0.015)
    still = kind.logp(torch.tensor([[0.0, 0.0, 1.0]], dtype=torch.float64))
    assert float(still) == pytest.approx(np.log((1.0 - p) * 0.5))
    moving = kind.logp(torch.tensor([[1.5, 0.0, 2.0]], dtype=torch.float64))
    gaussian = -0.5 * (1.0 + 1.0) - log_std.sum() - np.log(2.0 * np.pi)
    assert float(moving) == pytest.approx(np.log(p * 0.3) + gaussian)
    # The entropy is the mean of the negative logarithm of the density.
    assert float(kind.entropy()) == pytest.approx(-float(kind.logp(drawn[:, None]).mean()), abs=0.05)
    alone = Numbers(torch.tensor(logits[:5])[None])
    assert alone.sample().shape == (1, 2)
    assert (TwoNumbers.required_input_dim(None), Numbers.required_input_dim(None)) == (8, 5)
    assert float(alone.entropy() + (-shares * np.log(shares)).sum()) == pytest.approx(float(kind.entropy()))
    assert float(alone.logp(torch.tensor([[0.0, 0.0]], dtype=torch.float64))) == pytest.approx(np.log(1.0 - p))
    assert float(kind.kl(kind)) == pytest.approx(0.0)
    q, mean, log_other, others = 0.6, np.array([0.5, 0.0]), np.log([0.8, 1.5]), np.array([0.6, 0.3, 0.1])
    other = TwoNumbers(torch.tensor(np.concatenate([[np.log(q / (1.0 - q))], mean, log_other, np.log(others)]))[None])
    shift = np.exp(2.0 * log_std) + (np.array([1.0, -2.0]) - mean) ** 2
    numbers = (log_other - log_std + 0.5 * shift / np.exp(2.0 * log_other) - 0.5).sum()
    burning = p * np.log(p / q) + (1.0 - p) * np.log((1.0 - p) / (1.0 - q))
    assert float(kind.kl(other)) == pytest.approx(burning + p * numbers + (shares * np.log(shares / others)).sum())
    alike = Numbers(torch.tensor(np.concatenate([[np.log(q / (1.0 - q))], mean, log_other]))[None])
    assert float(alone.kl(alike)) == pytest.approx(burning + p * numbers)
    for call in (kind.rsample, kind.to_deterministic):
        with pytest.raises(NotImplementedError):
            call()


@pytest.mark.parametrize("rows", [3, LEAST_ROWS + 5])
@pytest.mark.parametrize(
    ("change", "model"),
    [
        (None, {}), (discrete, {}), (None, {"fcnet_hiddens": [20, 32]}), (discrete, {"fcnet_activation": "relu"}),
        (None, {"log_std_clip_param": 0.05}), (None, {"free_log_std": True}),
    ],
    ids=["numbers", "levels", "narrow", "relu", "clipped", "free"],
)  # fmt: skip
def test_the_sampler_has_the_outputs_of_the_module(change: Any, rows: int, model: dict[str, Any]) -> None:
    agent = experiment_of(change, SHIPPED).spec.agents[0]
    module = make_module(agent, **model)
    net = PolicyNet(module, rows)
    assert net.observations.shape == (rows, observation_layout(agent).size)
    assert type(net.distribution) is type(distribution_of_module(module))
    for _ in range(2):
        net.observations[:] = np.random.default_rng(rows).normal(size=net.observations.shape)
        seen = torch.from_numpy(net.observations.copy())
        with torch.no_grad():
            expected = module.forward_exploration({Columns.OBS: seen})[Columns.ACTION_DIST_INPUTS]
        np.testing.assert_allclose(net(True), expected, atol=5e-6)
        with torch.no_grad():
            module.pi.net.mlp[-1].bias += 0.5  # the net is the module's
    if "log_std_clip_param" in model:
        assert float(expected[:, 3:].abs().max()) == pytest.approx(0.05)


def test_a_module_is_asked_for_exploration_or_inference() -> None:
    asked: list[Any] = []

    class Asked:
        observation_space = SimpleNamespace(shape=(2,))

        def forward_exploration(self, batch: Any) -> Any:
            asked.append(("exploration", tuple(batch[Columns.OBS].shape)))
            return {Columns.ACTION_DIST_INPUTS: 2.0 * batch[Columns.OBS]}

        def forward_inference(self, batch: Any) -> Any:
            asked.append(("inference", tuple(batch[Columns.OBS].shape)))
            return {Columns.ACTION_DIST_INPUTS: 3.0 * batch[Columns.OBS]}

    net = PolicyNet(Asked(), 3)
    net.observations[:] = np.arange(6.0).reshape(3, 2)
    np.testing.assert_array_equal(net(True), 2.0 * np.arange(6.0).reshape(3, 2))
    np.testing.assert_array_equal(net(False), 3.0 * np.arange(6.0).reshape(3, 2))
    assert asked == [("exploration", (LEAST_ROWS, 2)), ("inference", (LEAST_ROWS, 2))]
    assert net.distribution is None
