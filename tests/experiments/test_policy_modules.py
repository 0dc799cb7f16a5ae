"""The modules of policies without an algorithm: first weights, which module each algorithm learns, what is refused."""

from __future__ import annotations

import dataclasses
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from gymnasium.spaces import Box, MultiDiscrete

from safe_inspect.errors import CheckpointError, ConfigError
from safe_inspect.experiments.modules.checkpoints import INFO, Weights, initial_weights

pytestmark = pytest.mark.ray
SEEN = Box(-np.inf, np.inf, (5,), dtype=np.float32)
THRUST = Box(-1.0, 1.0, (3,), dtype=np.float32)
LEVELS = MultiDiscrete([3, 2, 5])
NET: dict[str, Any] = {"fcnet_hiddens": [8, 6], "fcnet_activation": "tanh", "vf_share_layers": False}


def module_of(space: Any, **model: Any) -> Any:
    from ray.rllib.core.rl_module.default_model_config import DefaultModelConfig

    from safe_inspect.experiments.modules.policy import FreshPolicy

    torch.manual_seed(3)
    settings = {**dataclasses.asdict(DefaultModelConfig(**NET)), **model}
    return FreshPolicy(observation_space=SEEN, action_space=space, model_config=settings)


def last_of(head: Any) -> tuple[Any, Any]:
    layer = [part for part in head.modules() if isinstance(part, torch.nn.Linear)][-1]
    return layer.weight.detach().numpy(), layer.bias.detach().numpy()


@pytest.mark.parametrize(("given", "probability"), [({}, 0.9), ({"initial_probability": 0.75}, 0.75)])
@pytest.mark.parametrize("choice", [0, 1])
def test_the_biases_prefer_a_choice_and_no_other(given: dict[str, float], probability: float, choice: int) -> None:
    _, bias = last_of(module_of(LEVELS, initial_choice=choice, **given).pi)
    for part in np.split(bias.astype(np.float64), [3, 5]):
        shares = np.exp(part) / np.exp(part).sum()
        others = np.full(len(part), (1.0 - probability) / (len(part) - 1))
        others[choice] = probability
        np.testing.assert_allclose(shares, others, rtol=1e-6)


def test_a_choice_beyond_the_last_is_refused() -> None:
    with pytest.raises(ValueError, match=r"`initial_choice` \(2\) is beyond the last of 2 choices, 1"):
        module_of(LEVELS, initial_choice=2)
    _, bias = last_of(module_of(MultiDiscrete([1]), initial_choice=0).pi)
    assert bias.tolist() == pytest.approx([math.log(9.0)])


def test_keys_of_other_actions_change_nothing() -> None:
    plain = [parameter.detach().numpy() for parameter in module_of(LEVELS).parameters()]
    levels = module_of(LEVELS, initial_std=0.2, hurdle=True, initial_burn_probability=0.2)
    assert all(np.array_equal(one, p.detach()) for one, p in zip(plain, levels.parameters(), strict=True))
    plain = [parameter.detach().numpy() for parameter in module_of(THRUST).parameters()]
    numbers = module_of(THRUST, initial_choice=7)
    assert all(np.array_equal(one, p.detach()) for one, p in zip(plain, numbers.parameters(), strict=True))


def test_the_biases_of_deviations_and_of_burns() -> None:
    module = module_of(THRUST, initial_std=0.2)
    assert module.log_deviations() == slice(3, 6)
    _, bias = last_of(module.pi)
    np.testing.assert_allclose(bias[3:], math.log(0.2), rtol=1e-6)
    _, plain = last_of(module_of(THRUST).pi)
    np.testing.assert_array_equal(bias[:3], plain[:3])
    for given, logit in (({}, 0.0), ({"initial_burn_probability": 0.2}, math.log(0.25))):
        module = module_of(THRUST, hurdle=True, initial_std=0.1, **given)
        assert module.log_deviations() == slice(4, 7)
        _, bias = last_of(module.pi)
        assert len(bias) == 7
        assert bias[0] == pytest.approx(logit)
        np.testing.assert_allclose(bias[4:], math.log(0.1), rtol=1e-6)


def test_orthogonal_weights_have_their_gains_and_no_biases() -> None:
    module = module_of(THRUST, orthogonal=True)
    for encoder in (module.encoder.actor_encoder, module.encoder.critic_encoder):
        for layer in encoder.net.mlp:
            if isinstance(layer, torch.nn.Linear):
                weight = layer.weight.detach().double().numpy()
                square = weight @ weight.T if len(weight) <= weight.shape[1] else weight.T @ weight
                np.testing.assert_allclose(square, 2.0 * np.eye(len(square)), atol=1e-5)
                assert not layer.bias.any()
    for head, gain in ((module.pi, 0.01), (module.vf, 1.0)):
        weight, bias = last_of(head)
        np.testing.assert_allclose(weight @ weight.T, gain**2 * np.eye(len(weight)), atol=1e-5 * gain)
        assert not bias.any()


@pytest.fixture(scope="module")
def shipped() -> Weights:
    return initial_weights("docking")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"taste": 3}, "file: the policy has the unknown setting `taste` of another version"),
        ({"fcnet_activation": "sour"}, "file: the policy's settings are damaged ("),
        ({"fcnet_hiddens": [7]}, "file: its weights do not match this policy ("),
    ],
)
def test_a_file_that_describes_no_module_is_refused(shipped: Weights, changes: dict[str, Any], message: str) -> None:
    from safe_inspect.experiments.modules.policy import build_module

    wrong = dataclasses.replace(shipped, model={**shipped.model, **changes})
    with pytest.raises(CheckpointError) as caught:
        build_module(wrong, "file")
    assert str(caught.value).startswith(message)


def test_a_file_gives_its_module_with_its_weights(shipped: Weights) -> None:
    from safe_inspect.experiments.modules.policy import FreshPolicy, build_module

    module = build_module(shipped, "file")
    assert type(module) is FreshPolicy
    state = module.get_state()
    assert all(np.array_equal(state[name], value) for name, value in shipped.arrays.items())


def texts(distribution: str, levels: list[float], offset: float = 0.0) -> dict[str, str]:
    action = [{"name": "X", "unit": "N", "offset": offset, "levels": []}] if distribution != "categorical" else []
    action += [{"name": "T", "unit": "s", "offset": 1.0, "levels": levels}] if levels else []
    return {"distribution": distribution, "action": json.dumps(action)}


def test_each_algorithm_learns_its_own_module() -> None:
    from safe_inspect.experiments.modules import policy
    from safe_inspect.experiments.modules.saved_policy import AppoPolicy, DqnPolicy, SacPolicy

    model = {"fcnet_hiddens": [4], "initial_std": 0.1}
    info = texts("gaussian", [])
    found = {name: policy.policy_spec(model, name, info) for name in ("PPO", "IMPALA", "APPO", "SAC")}
    kinds = (policy.FreshPolicy, policy.FreshPolicy, AppoPolicy, SacPolicy)
    assert [spec.module_class for spec in found.values()] == list(kinds)
    for name, spec in found.items():
        assert spec.model_config["fcnet_hiddens"] == [4]
        assert spec.model_config[INFO] == info
        assert ("initial_std" in spec.model_config) == (name != "SAC")
    dqn = policy.policy_spec({}, "DQN", texts("categorical", [0.0, 1.0, 2.0]))
    assert dqn.module_class is DqnPolicy
    assert dqn.model_config["choices"] == [3]
    assert dqn.model_config[INFO]["distribution"] == "greedy"
    assert "choices" not in policy.policy_spec({}, "DQN").model_config


def test_decisions_that_last_have_the_hurdle_distribution_and_thrust_may() -> None:
    from safe_inspect.experiments.modules.policy import policy_spec

    lasting = policy_spec({}, "PPO", texts("hurdle", [1.0, 2.0])).model_config
    assert (lasting["hurdle"], lasting["coasts"], lasting[INFO]["distribution"]) == (True, 2, "hurdle")
    asked = policy_spec({"hurdle": True}, "PPO", texts("gaussian", [])).model_config
    assert (asked["hurdle"], "coasts" in asked, asked[INFO]["distribution"]) == (True, False, "hurdle")
    levels = policy_spec({"hurdle": True}, "PPO", texts("categorical", [1.0])).model_config
    assert levels[INFO]["distribution"] == "categorical"
    plain = policy_spec({}, "PPO", texts("gaussian", [], 0.5)).model_config
    assert plain[INFO]["distribution"] == "gaussian"
    with pytest.raises(ConfigError) as caught:
        policy_spec({"hurdle": True}, "PPO", texts("gaussian", [], 0.5))
    assert str(caught.value) == (
        "agent_config: a hurdle policy coasts by actions of 0, for which X gives 0.5 N; give the controller limits "
        "that are symmetric about 0"
    )


def test_weights_of_a_folder_are_named_for_processes_of_other_folders(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from safe_inspect.experiments.modules import policy

    asked: list[Any] = []
    monkeypatch.setattr(policy, "starting_weights", lambda *given: asked.append(given))
    monkeypatch.chdir(tmp_path)
    own = policy.policy_spec({"initial_weights": "run"}).model_config
    assert own["initial_weights"] == str(tmp_path / "run")
    assert asked == [("run", {INFO: {}})]
    assert policy.policy_spec({"initial_weights": "docking"}).model_config["initial_weights"] == "docking"


@pytest.mark.parametrize("inference_only", [False, True])
def test_weights_to_begin_with_are_those_of_the_learner_alone(
    monkeypatch: pytest.MonkeyPatch, inference_only: bool
) -> None:
    from safe_inspect.experiments.modules import policy

    source = {name: value + np.float32(1.0) for name, value in module_of(THRUST).get_state().items()}
    monkeypatch.setattr(policy, "starting_weights", lambda name, model: source if name == "there" else None)
    from ray.rllib.core.rl_module.default_model_config import DefaultModelConfig

    settings = {**dataclasses.asdict(DefaultModelConfig(**NET)), "initial_weights": "there"}
    module: Any = policy.FreshPolicy(
        observation_space=SEEN, action_space=THRUST, model_config=settings, inference_only=inference_only
    )
    assert module.model_config["initial_weights"] is None
    same = [np.array_equal(value.detach(), source[name]) for name, value in module.named_parameters()]
    assert all(same) is not inference_only
    assert any(same) is not inference_only


def test_combinations_of_levels_that_dqn_cannot_learn() -> None:
    from safe_inspect.experiments.modules.saved_policy import choices_of

    def info(*counts: int) -> dict[str, str]:
        return {"action": json.dumps([{"levels": [0.0] * count} for count in counts])}

    assert choices_of(info(64, 64)) == [64, 64]
    with pytest.raises(ConfigError) as caught:
        choices_of(info(17, 241))
    assert str(caught.value) == (
        "rllib_configs.algorithm: DQN learns the value of each combination of levels, and there are 4,097 of them; use "
        "PPO, or levels with at most 4,096 combinations"
    )
