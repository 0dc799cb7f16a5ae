"""The nodes of an exported file, one by one: each layer is Torch's, and steps that do nothing are left out."""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch

from safe_inspect.errors import CheckpointError
from safe_inspect.types import AnyArray

onnx = pytest.importorskip("onnx")
runtime = pytest.importorskip("onnxruntime")
pytestmark = pytest.mark.ray


def graph() -> Any:
    from safe_inspect.experiments.export.onnx_graph import _Graph

    return _Graph(onnx, "title")


def computed(made: Any, output: str, value: AnyArray) -> AnyArray:
    """Return what the nodes give for rows of the input ``x``."""
    from safe_inspect.experiments.export.onnx_graph import IR_VERSION, OPSET

    float32, tensor = onnx.TensorProto.FLOAT, onnx.helper.make_tensor_value_info
    whole = onnx.helper.make_graph(
        made.nodes, "g", [tensor("x", float32, ["N", value.shape[1]])], [tensor(output, float32, None)], made.constants
    )
    model = onnx.helper.make_model(whole, opset_imports=[onnx.helper.make_opsetid("", OPSET)], ir_version=IR_VERSION)
    session = runtime.InferenceSession(model.SerializeToString(), providers=["CPUExecutionProvider"])
    (found,) = session.run(None, {"x": value.astype(np.float32)})
    return np.asarray(found)


def kinds(made: Any) -> list[str]:
    return [node.op_type for node in made.nodes]


ROWS = np.random.default_rng(0).normal(0.0, 2.0, (9, 4))
LAYERS = {
    "Tanh": torch.nn.Tanh(), "Relu": torch.nn.ReLU(), "Sigmoid": torch.nn.Sigmoid(), "Elu": torch.nn.ELU(0.7),
    "LeakyRelu": torch.nn.LeakyReLU(0.3), "Identity": torch.nn.Identity(), "Sigmoid Mul": torch.nn.SiLU(),
    "Gemm": torch.nn.Linear(4, 3), "Gemm ": torch.nn.Linear(4, 3, bias=False),
    "LayerNormalization": torch.nn.LayerNorm(4, eps=0.1), "LayerNormalization ": torch.nn.LayerNorm(4, bias=False),
    "LayerNormalization  ": torch.nn.LayerNorm(4, elementwise_affine=False),
}  # fmt: skip


@pytest.mark.parametrize("name", LAYERS)
def test_a_layer_is_that_of_torch(name: str) -> None:
    layer, made = LAYERS[name], graph()
    with torch.no_grad():
        for place, parameter in enumerate(layer.parameters()):
            parameter += 0.3 + 0.1 * place
        wanted = layer(torch.as_tensor(ROWS, dtype=torch.float32)).numpy()
    found = computed(made, made.net([layer], "x"), ROWS)
    np.testing.assert_allclose(found, wanted, rtol=1e-5, atol=1e-6)
    assert kinds(made) == name.split()


def test_a_layer_of_another_kind_is_named_with_those_that_are_known() -> None:
    for layer in (torch.nn.Softplus(), torch.nn.LayerNorm((2, 2))):
        with pytest.raises(CheckpointError) as caught:
            graph().net([layer], "x")
        assert str(caught.value) == (
            f"title: the policy has a layer of the kind {type(layer).__name__}, which cannot be exported; supported: "
            "ELU, Identity, LayerNorm, LeakyReLU, Linear, ReLU, SiLU, Sigmoid, Tanh"
        )


@pytest.mark.parametrize(
    ("centre", "width", "nodes"),
    [
        ([0.0, 0.0, 0.0, 0.0], [1.0, 1.0, 1.0, 1.0], []),
        ([0.0, 0.0, 3.0, 0.0], [1.0, 1.0, 1.0, 1.0], ["Sub"]),
        ([0.0, 0.0, 0.0, 0.0], [1.0, 0.5, 1.0, 1.0], ["Div"]),
        ([1.0, 2.0, 3.0, 4.0], [5.0, 6.0, 7.0, 8.0], ["Sub", "Div"]),
    ],
)
def test_readings_are_normalised_where_that_changes_them(
    centre: list[float], width: list[float], nodes: list[str]
) -> None:
    made = graph()
    seen = [SimpleNamespace(centre=c, width=w) for c, w in zip(centre, width, strict=True)]
    output = made.normalised("x", SimpleNamespace(observation=seen))
    assert kinds(made) == nodes
    if nodes:
        np.testing.assert_allclose(
            computed(made, output, ROWS), (ROWS - np.array(centre)) / np.array(width), rtol=1e-5, atol=1e-6
        )
    else:
        assert output == "x"


def elements(gain: Sequence[float], offset: Sequence[float]) -> list[Any]:
    limits = ((-1.0, 1.0), (-0.5, 2.0))
    return [
        SimpleNamespace(gain=g, offset=o, low=low, high=high)
        for g, o, (low, high) in zip(gain, offset, limits, strict=True)
    ]


@pytest.mark.parametrize("gates", [False, True])
@pytest.mark.parametrize(
    ("gain", "offset", "nodes"),
    [
        ((1.0, 1.0), (0.0, 0.0), []),
        ((1.0, 2.0), (0.0, 0.0), ["Mul"]),
        ((1.0, 1.0), (0.25, 0.0), ["Add"]),
        ((0.5, 3.0), (0.25, -0.1), ["Mul", "Add"]),
    ],
)
def test_means_become_commands_within_their_limits(
    gates: bool, gain: Sequence[float], offset: Sequence[float], nodes: list[str]
) -> None:
    made = graph()
    found = computed(made, made.scaled("x", elements(gain, offset), gates), ROWS)
    mean = ROWS[:, int(gates) : int(gates) + 2]
    if gates:
        mean = np.where(ROWS[:, :1] > 0.0, mean, 0.0)
    wanted = np.clip(np.array(offset) + np.array(gain) * mean, [-1.0, -0.5], [1.0, 2.0])
    np.testing.assert_allclose(found, wanted, rtol=1e-5, atol=1e-6)
    gate = ["Slice", "Greater", "Where"] if gates else []
    assert kinds(made) == ["Slice", *gate, *nodes, "Max", "Min"]


def test_a_level_is_chosen_by_the_first_of_the_largest_logits() -> None:
    made = graph()
    rows = np.array([[9.0, 1.0, 3.0, 2.0], [9.0, 3.0, 3.0, 1.0], [9.0, 0.0, 1.0, 1.0], [9.0, -3.0, -2.0, -1.0]])
    found = computed(made, made.chosen("x", 1, (-0.5, 0.0, 2.0)), rows)
    assert found.tolist() == [[0.0], [-0.5], [0.0], [2.0]]


def test_the_best_of_the_other_choices_counts_for_each_choice() -> None:
    from safe_inspect.experiments.modules.saved_policy import BestChoices

    values = np.random.default_rng(1).normal(size=(5, 12)).astype(np.float32)
    table = values.reshape(5, 2, 3, 2)
    wanted = np.concatenate([table.max(axis=(2, 3)), table.max(axis=(1, 3)), table.max(axis=(1, 2))], axis=1)
    layer, made = BestChoices((2, 3, 2)), graph()
    np.testing.assert_array_equal(layer(torch.as_tensor(values)).numpy(), wanted)
    np.testing.assert_array_equal(computed(made, made.net([layer], "x"), values), wanted)
    alone, single = BestChoices((12,)), graph()
    np.testing.assert_array_equal(alone(torch.as_tensor(values)).numpy(), values)
    np.testing.assert_array_equal(computed(single, single.net([alone], "x"), values), values)


@pytest.mark.parametrize("clip", [True, False])
@pytest.mark.parametrize("free", [True, False])
def test_the_outputs_of_a_head_have_their_deviations_within_the_limit(clip: bool, free: bool) -> None:
    from ray.rllib.core.models.configs import FreeLogStdMLPHeadConfig, MLPHeadConfig

    config = (FreeLogStdMLPHeadConfig if free else MLPHeadConfig)(
        input_dims=[4], hidden_layer_dims=[], output_layer_dim=6, clip_log_std=clip, log_std_clip_param=0.25
    )
    head = config.build("torch")
    with torch.no_grad():
        for parameter in head.parameters():
            parameter += torch.linspace(-0.9, 1.1, parameter.numel()).reshape(parameter.shape)
        wanted = head(torch.as_tensor(ROWS, dtype=torch.float32)).numpy()
    assert (np.abs(wanted[:, 3:]).max() <= 0.25) == clip
    made = graph()
    np.testing.assert_allclose(
        computed(made, made.net([head], "x"), ROWS),
        wanted,
        rtol=1e-5,
        atol=1e-6,
    )
