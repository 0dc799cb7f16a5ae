"""Conversion of a policy's module to an ONNX graph. Importing this module loads Ray and Torch, but not `onnx`.

The graph is written node by node, because the nets are small. So it contains only plain layers that every runtime
supports, and the file does not depend on an exporter.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch

from safe_inspect.errors import CheckpointError, SafeInspectError
from safe_inspect.evaluation.policy_file import NEXT_STATE, CommandedElement, PolicyInfo, element_columns
from safe_inspect.experiments.export.net_layers import STATE, NetLayers, lstm_weights
from safe_inspect.experiments.modules.saved_policy import BestChoices
from safe_inspect.types import AnyArray
from safe_inspect.version import __version__

#: Versions of ONNX that `LayerNormalization` needs and that runtimes since 2022 support.
OPSET, IR_VERSION = 17, 8

_SIMPLE = {
    torch.nn.Tanh: ("Tanh", ()),
    torch.nn.ReLU: ("Relu", ()),
    torch.nn.Sigmoid: ("Sigmoid", ()),
    torch.nn.ELU: ("Elu", ("alpha",)),
    torch.nn.LeakyReLU: ("LeakyRelu", (("alpha", "negative_slope"),)),
    torch.nn.Identity: ("Identity", ()),
}


def require_onnx() -> Any:
    """Return the module `onnx`.

    Raises:
        SafeInspectError: The package onnx is not installed.
    """
    try:
        import onnx  # type: ignore[import-untyped,import-not-found,unused-ignore]
    except ImportError:
        raise SafeInspectError(
            "ONNX files are written by the package onnx, which is not installed; pip install 'safe_inspect[onnx]'"
        ) from None
    return onnx


def build_file(net: NetLayers, info: PolicyInfo, title: str) -> bytes:
    """Return the bytes of the ONNX file of a policy, without its seal.

    Args:
        net: The layers of the policy.
        info: The description of the policy for the file.
        title: Name of the checkpoint in messages.

    Raises:
        CheckpointError: A layer is of an unsupported kind.
        SafeInspectError: The package onnx is not installed.
    """
    onnx = require_onnx()
    graph = _Graph(onnx, title)
    value = graph.normalised("observation", info)
    inputs = graph.outputs(net, value)
    graph.node("Identity", [inputs], name="action_dist_inputs")
    numbers = [element for element in info.action if not element.levels]
    gates = info.distribution == "hurdle"
    first = gates + 2 * len(numbers)
    parts = [graph.scaled(inputs, numbers, gates)] if numbers else []
    for element in info.action[len(numbers) :]:
        parts.append(graph.chosen(inputs, first, element.levels))
        first += len(element.levels)
    graph.node("Concat", parts, name="thrust", axis=1)
    width = first

    def tensor(name: str, size: int) -> Any:
        return onnx.helper.make_tensor_value_info(name, onnx.TensorProto.FLOAT, ["N", size])

    state = info.state.items()
    model = onnx.helper.make_model(
        onnx.helper.make_graph(
            graph.nodes,
            "policy",
            [tensor("observation", len(info.observation)), *(tensor(name, size) for name, size in state)],
            [
                tensor("thrust", len(info.action)),
                tensor("action_dist_inputs", width),
                *(tensor(NEXT_STATE + name, size) for name, size in state),
            ],
            graph.constants,
        ),
        opset_imports=[onnx.helper.make_opsetid("", OPSET)],
        ir_version=IR_VERSION,
        producer_name="safe_inspect",
        producer_version=__version__,
    )
    onnx.helper.set_model_props(model, info.metadata())
    onnx.checker.check_model(model, full_check=True)
    content: bytes = model.SerializeToString(deterministic=True)
    return content


class _Graph:
    """Builder of the nodes and constants of a graph. Its methods return the names of outputs."""

    def __init__(self, onnx: Any, title: str) -> None:
        self._onnx, self._title = onnx, title
        self.nodes: list[Any] = []
        self.constants: list[Any] = []

    def node(self, kind: str, inputs: Sequence[str], *, name: str = "", **attributes: Any) -> str:
        """Add a node and return the name of its output."""
        name = name or f"{kind.lower()}_{len(self.nodes)}"
        self.nodes.append(self._onnx.helper.make_node(kind, list(inputs), [name], name=f"node_{name}", **attributes))
        return name

    def constant(self, value: Any, name: str = "constant", dtype: Any = np.float32) -> str:
        """Add a constant and return its name."""
        name = f"{name}_{len(self.constants)}"
        array = np.ascontiguousarray(np.asarray(value), dtype=dtype)
        self.constants.append(self._onnx.numpy_helper.from_array(array, name))
        return name

    def normalised(self, value: str, info: PolicyInfo) -> str:
        """Add (value - centre) / width, element by element."""
        centre, width = element_columns(info.observation, "centre"), element_columns(info.observation, "width")
        if np.any(centre != 0.0):
            value = self.node("Sub", [value, self.constant(centre, "centre")])
        return self.node("Div", [value, self.constant(width, "width")]) if np.any(width != 1.0) else value

    def net(self, layers: Any, value: str) -> str:
        """Add the layers one after the other."""
        for layer in layers:
            value = self._layer(layer, value)
        return value

    def outputs(self, net: NetLayers, value: str) -> str:
        """Add the layers of a policy, which give the inputs of the action distribution."""
        value = self.net(net.dense, value)
        if net.lstm is not None:
            value = self.lstm(net.lstm, value)
        value = self.net(net.head, value)
        if net.log_std is not None:
            log_std = self.constant(_array(net.log_std)[None, :], "log_std")
            spread = self.node("Expand", [log_std, self.node("Shape", [value])])
            return self.node("Concat", [value, spread], axis=1)
        if net.limit is None:
            return value
        last: Any = net.head[-1]
        width = int(last.out_features) // 2
        bounds = [self.constant(-net.limit, "log_std_low"), self.constant(net.limit, "log_std_high")]
        spread = self.node("Clip", [self.part(value, width, 2 * width), *bounds])
        return self.node("Concat", [self.part(value, 0, width), spread], axis=1)

    def lstm(self, layer: torch.nn.LSTM, value: str) -> str:
        """Add one step of an LSTM from the inputs `STATE` to the outputs with the prefix `NEXT_STATE`.

        Returns:
            The name of the first output, which is the output of the LSTM.
        """
        axis = self.constant([0], "axis", np.int64)  # axis of time
        weights = [self.constant(array, name) for name, array in lstm_weights(layer).items()]
        held = [self.node("Unsqueeze", [name, axis]) for name in STATE]
        step = [self.node("Unsqueeze", [value, axis]), *weights, "", *held]
        after = [f"stepped_{name}" for name in STATE]
        self.nodes.append(
            self._onnx.helper.make_node("LSTM", step, ["", *after], name="node_lstm", hidden_size=layer.hidden_size)
        )
        hidden, _ = (
            self.node("Squeeze", [one, axis], name=NEXT_STATE + name) for one, name in zip(after, STATE, strict=True)
        )
        return hidden

    def scaled(self, inputs: str, elements: Sequence[CommandedElement], gates: bool) -> str:
        """Add clip(offset + gain * mean, low, high); in a hurdle policy the mean is 0 where its logit is negative."""
        value = self.part(inputs, int(gates), gates + len(elements))
        gain, offset, low, high = (element_columns(elements, name) for name in ("gain", "offset", "low", "high"))
        if gates:
            zero = self.constant([0.0], "zero")
            value = self.node("Where", [self.node("Greater", [self.part(inputs, 0, 1), zero]), value, zero])
        if np.any(gain != 1.0):
            value = self.node("Mul", [value, self.constant(gain, "gain")])
        if np.any(offset != 0.0):
            value = self.node("Add", [value, self.constant(offset, "offset")])
        value = self.node("Max", [value, self.constant(low, "low")])
        return self.node("Min", [value, self.constant(high, "high")])

    def chosen(self, inputs: str, first: int, levels: Sequence[float]) -> str:
        """Add levels[argmax] of the logits that begin at column `first`; of equal logits the first counts."""
        index = self.node("ArgMax", [self.part(inputs, first, first + len(levels))], axis=1, keepdims=1)
        return self.node("Gather", [self.constant(levels, "levels"), index], axis=0)

    def part(self, value: str, first: int, last: int) -> str:
        """Add the slice of the columns `first` to `last` - 1."""
        ends = [self.constant([end], "column", np.int64) for end in (first, last, 1)]
        return self.node("Slice", [value, *ends])

    def best_choices(self, choices: Sequence[int], value: str) -> str:
        """Add the values of the choices, computed from those of their combinations; see `BestChoices`."""
        axes = range(1, len(choices) + 1)
        table = self.node("Reshape", [value, self.constant([-1, *choices], "choices", np.int64)])
        others = [[axis for axis in axes if axis != own] for own in axes]
        best = [self.node("ReduceMax", [table], axes=rest, keepdims=0) if rest else table for rest in others]
        return self.node("Concat", best, axis=1)

    def _layer(self, layer: Any, value: str) -> str:
        if type(layer) is BestChoices:
            return self.best_choices(layer.choices, value)
        if type(layer) is torch.nn.Linear:
            inputs = [value, self.constant(_array(layer.weight), "weight")]
            if layer.bias is not None:
                inputs.append(self.constant(_array(layer.bias), "bias"))
            return self.node("Gemm", inputs, transB=1)
        if type(layer) is torch.nn.LayerNorm and len(layer.normalized_shape) == 1:
            scale = np.ones(layer.normalized_shape) if layer.weight is None else _array(layer.weight)
            inputs = [value, self.constant(scale, "scale")]
            if layer.bias is not None:
                inputs.append(self.constant(_array(layer.bias), "bias"))
            return self.node("LayerNormalization", inputs, axis=-1, epsilon=float(layer.eps))
        if type(layer) is torch.nn.SiLU:
            return self.node("Mul", [value, self.node("Sigmoid", [value])])
        if type(layer) in _SIMPLE:
            kind, fields = _SIMPLE[type(layer)]
            pairs = [field if isinstance(field, tuple) else (field, field) for field in fields]
            attributes: dict[str, Any] = {name: float(getattr(layer, own)) for name, own in pairs}
            return self.node(kind, [value], **attributes)
        known = ", ".join(sorted(["Linear", "LayerNorm", "SiLU", *(kind.__name__ for kind in _SIMPLE)]))
        raise CheckpointError(
            f"{self._title}: the policy has a layer of the kind {type(layer).__name__}, which cannot be exported; "
            f"supported: {known}"
        )


def _array(tensor: Any) -> AnyArray:
    return np.asarray(tensor.detach().cpu().numpy())
