"""What an ONNX file computes around a net, against Torch: normalisers, commands, levels, and RLlib's heads."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from random_checkpoint import discrete, experiment_of, make_module, scaled

from safe_inspect.errors import CheckpointError
from safe_inspect.experiments.settings.policies import policy_info
from safe_inspect.types import AnyArray

pytest.importorskip("onnxscript")
runtime = pytest.importorskip("onnxruntime")
pytestmark = pytest.mark.ray


class Inputs(torch.nn.Module):
    """Net whose outputs are its first inputs."""

    def __init__(self, count: int) -> None:
        super().__init__()
        self.count = count

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        """Return the columns."""
        return observation[:, : self.count]


def computed(net: torch.nn.Module, info: Any, readings: AnyArray) -> list[AnyArray]:
    from safe_inspect.experiments.onnx_graph import build_file

    session = runtime.InferenceSession(build_file(net, info, "here"), providers=["CPUExecutionProvider"])
    found: list[AnyArray] = session.run(None, {"observation": readings.astype(np.float32)})
    return found


def info_of(change: Any = None, **changes: Any) -> Any:
    experiment = experiment_of(change)
    return replace(policy_info(experiment, "default_policy", list(experiment.spec.agents), exportable=True), **changes)


@pytest.mark.parametrize("distribution", ["gaussian", "hurdle"])
def test_means_become_commands_within_their_limits(distribution: str) -> None:
    info = info_of(scaled, distribution=distribution)
    gates = int(distribution == "hurdle")
    readings = np.random.default_rng(0).normal(0.0, 200.0, (40, len(info.observation)))
    thrust, inputs = computed(Inputs(gates + 6), info, readings)
    centre, width = (np.array([getattr(one, name) for one in info.observation]) for name in ("centre", "width"))
    normalised = (readings.astype(np.float32) - centre) / width
    np.testing.assert_allclose(inputs, normalised[:, : gates + 6], rtol=1e-5, atol=1e-5)
    mean = inputs[:, gates : gates + 3]
    if gates:
        assert 5 < (inputs[:, 0] > 0.0).sum() < 35
        mean = np.where(inputs[:, :1] > 0.0, mean, 0.0)
    gain, offset, low, high = (
        np.array([getattr(one, name) for one in info.action]) for name in ("gain", "offset", "low", "high")
    )
    np.testing.assert_allclose(thrust, np.clip(offset + gain * mean, low, high), rtol=1e-5, atol=1e-5)


def test_a_level_is_chosen_by_the_first_of_the_largest_logits() -> None:
    class Logits(torch.nn.Module):
        def forward(self, observation: torch.Tensor) -> torch.Tensor:
            return torch.floor(observation[:, :1] + torch.arange(13.0) % 5.0 / 4.0)

    info = info_of(discrete)
    readings = np.random.default_rng(1).uniform(-300.0, 300.0, (50, len(info.observation)))
    thrust, inputs = computed(Logits(), info, readings)
    first = 0
    for column, element in enumerate(info.action):
        logits = inputs[:, first : first + len(element.levels)]
        np.testing.assert_allclose(thrust[:, column], np.array(element.levels, np.float32)[logits.argmax(axis=1)])
        first += len(element.levels)
    assert first == 13
    assert (inputs[:, :3] == inputs[:, :3].max(axis=1, keepdims=True)).sum(axis=1).max() > 1


def test_the_best_of_the_other_choices_counts_for_each_choice() -> None:
    from safe_inspect.experiments.modules.saved_policy import BestChoices

    values = np.random.default_rng(1).normal(size=(5, 12)).astype(np.float32)
    table = values.reshape(5, 2, 3, 2)
    wanted = np.concatenate([table.max(axis=(2, 3)), table.max(axis=(1, 3)), table.max(axis=(1, 2))], axis=1)
    np.testing.assert_array_equal(BestChoices((2, 3, 2))(torch.as_tensor(values)).numpy(), wanted)
    np.testing.assert_array_equal(BestChoices((12,))(torch.as_tensor(values)).numpy(), values)


@pytest.mark.parametrize("clip", [True, False])
@pytest.mark.parametrize("free", [True, False])
def test_the_outputs_of_a_policy_have_their_deviations_within_the_limit(clip: bool, free: bool) -> None:
    from ray.rllib.core.columns import Columns

    from safe_inspect.experiments.onnx_graph import RllibNet

    model = {"free_log_std": free, "log_std_clip_param": 0.01 if clip else 20.0}
    module = make_module(experiment_of().spec.agents[0], **model)
    with torch.no_grad():
        for parameter in module.pi.parameters():
            parameter += torch.linspace(-0.9, 1.1, parameter.numel()).reshape(parameter.shape)
        seen = torch.randn(9, 11, generator=torch.Generator().manual_seed(0))
        wanted = module.forward_inference({Columns.OBS: seen})[Columns.ACTION_DIST_INPUTS]
        (found,) = RllibNet(module, "here")(seen)
    assert (wanted[:, 3:].abs().max() <= 0.01) == clip
    torch.testing.assert_close(found, wanted)


def test_the_file_is_the_same_each_time_and_names_no_place_of_this_machine() -> None:
    from safe_inspect.experiments.onnx_graph import build_file

    net, info = torch.nn.Linear(11, 6), info_of()
    content = build_file(net, info, "here")
    assert content == build_file(net, info, "here")
    assert b".py" not in content
    assert b"/" + torch.__file__.encode().split(b"/")[1] + b"/" not in content


def test_a_net_that_torch_cannot_export_is_refused() -> None:
    class Branching(torch.nn.Module):
        def forward(self, observation: torch.Tensor) -> torch.Tensor:
            return observation[:, :6] if observation.sum() > 0.0 else -observation[:, :6]

    with pytest.raises(CheckpointError, match=r"^here: the policy cannot be exported by torch.onnx \(.*data-dependent"):
        computed(Branching(), info_of(), np.zeros((1, 11)))
