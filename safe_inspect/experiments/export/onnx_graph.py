"""Conversion of a policy to an ONNX graph: the layers of a policy of RLlib or of any other learner, and their nodes.

The graph is written node by node, because the nets are small. So it contains only plain layers that every runtime
supports, and the file does not depend on an exporter. Importing this module loads Ray and Torch, but not `onnx`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from ray.rllib.algorithms.ppo.torch.default_ppo_torch_rl_module import DefaultPPOTorchRLModule
from ray.rllib.core.models.torch.encoder import TorchLSTMEncoder
from ray.rllib.core.models.torch.heads import TorchFreeLogStdMLPHead, TorchMLPHead

from safe_inspect.errors import CheckpointError, SafeInspectError
from safe_inspect.evaluation.policy_file import NEXT_STATE, CommandedElement, PolicyInfo, element_columns
from safe_inspect.experiments.modules.saved_policy import BestChoices, DqnPolicy, SacPolicy
from safe_inspect.types import AnyArray, FloatArray
from safe_inspect.version import __version__

#: Logarithm of the standard deviation of a deterministic policy; samples equal the mean to all digits.
NO_SPREAD = -20.0


#: Names of an ONNX file's inputs for the state of an LSTM: output and cell.
STATE = ("state_h", "state_c")

_GATES = (0, 3, 1, 2)  # input, forget, cell, output in Torch; input, output, forget, cell in ONNX

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


class Spread(torch.nn.Module):
    """Layer that appends the logarithms of fixed standard deviations to means.

    Args:
        log_std: The logarithms, shape (A,).
    """

    def __init__(self, log_std: torch.Tensor) -> None:
        super().__init__()
        self.log_std = log_std.detach()

    def forward(self, mean: torch.Tensor) -> torch.Tensor:
        """Return means and logarithms, shape (R, 2 A)."""
        return torch.cat((mean, self.log_std.expand_as(mean)), dim=1)


def lstm_state(net: torch.nn.Sequential) -> dict[str, int]:
    """Return the sizes of the inputs of `STATE`; empty for a policy without a state."""
    sizes = [layer.hidden_size for layer in net if isinstance(layer, torch.nn.LSTM)]
    return dict.fromkeys(STATE, sizes[0]) if sizes else {}


def layers_of(module: Any, title: str) -> torch.nn.Sequential:
    """Return the layers of a policy of RLlib, from the observation to the inputs of its action distribution.

    Of SAC the layers give the mode, tanh(mean), because the files cannot describe the squashed Gaussian from which SAC
    samples its actions; of DQN the values of the choices.

    Raises:
        CheckpointError: It is not one of RLlib's own modules, or not a multilayer perceptron (and an LSTM).
    """
    if isinstance(module, SacPolicy):
        return _mode_of_sac(module, title)
    if isinstance(module, DqnPolicy):
        return _best_of_dqn(module, title)
    own = DefaultPPOTorchRLModule
    names = ("_forward", "_forward_inference", "forward_inference")
    if not isinstance(module, own) or any(getattr(type(module), name) is not getattr(own, name) for name in names):
        raise CheckpointError(
            f"{title}: the policy is a custom module ({type(module).__name__}); only RLlib's own modules for PPO can "
            "be exported"
        )
    encoder: Any = getattr(module.encoder, "actor_encoder", None) or getattr(module.encoder, "encoder", None)
    lstm = encoder.lstm if type(encoder) is TorchLSTMEncoder else None
    dense = getattr(getattr(encoder if lstm is None else encoder.tokenizer, "net", None), "mlp", None)
    known = type(module.pi) in (TorchMLPHead, TorchFreeLogStdMLPHead) and (lstm is None or lstm.num_layers == 1)
    if not known or not isinstance(dense, torch.nn.Sequential):
        raise CheckpointError(
            f"{title}: the policy has layers other than those of a multilayer perceptron or of RLlib's LSTM; only "
            "these can be exported"
        )
    return torch.nn.Sequential(*dense, *([] if lstm is None else [lstm]), module.pi)


def _mode_of_sac(module: SacPolicy, title: str) -> torch.nn.Sequential:
    """Return the mode of RLlib's policy for SAC, tanh(mean).

    Raises:
        CheckpointError: The policy is recurrent, or not a multilayer perceptron.
    """
    encoder, head = _layers(module.pi_encoder, title), _layers(module.pi, title)
    last: Any = head[-1]
    size = last.out_features // 2
    mean = torch.nn.Linear(last.in_features, size)
    with torch.no_grad():
        mean.weight.copy_(last.weight[:size])
        mean.bias.copy_(last.bias[:size])
    spread = Spread(torch.full((size,), NO_SPREAD))
    return torch.nn.Sequential(*encoder, *list(head)[:-1], mean, torch.nn.Tanh(), spread).eval()


def _best_of_dqn(module: DqnPolicy, title: str) -> torch.nn.Sequential:
    """Return the values of the choices of RLlib's policy for DQN, up to a constant that is common to all choices.

    With separate nets for value and advantage this constant is the value of the state minus the mean advantage.

    Raises:
        CheckpointError: The policy is recurrent, not a multilayer perceptron, or has learned a distribution of returns.
    """
    if module.num_atoms > 1:
        raise CheckpointError(
            f"{title}: the policy has learned a distribution of returns (`num_atoms`); train without it"
        )
    layers = (*_layers(module.encoder, title), *_layers(module.af, title), BestChoices(module.choices))
    return torch.nn.Sequential(*layers).eval()


def _layers(part: Any, title: str) -> torch.nn.Sequential:
    layers = getattr(getattr(part, "net", None), "mlp", None)
    if not isinstance(layers, torch.nn.Sequential):
        raise CheckpointError(f"{title}: the policy is not a multilayer perceptron; only those can be exported")
    return layers


def scaled_to(low: FloatArray, high: FloatArray) -> torch.nn.Linear:
    """Return the linear layer that maps -1 to `low` and 1 to `high`, element by element; both have shape (A,)."""
    least, largest = (torch.as_tensor(side, dtype=torch.float32) for side in (low, high))
    layer = torch.nn.Linear(len(least), len(least))
    with torch.no_grad():
        layer.weight.copy_(torch.diag((largest - least) / 2.0))
        layer.bias.copy_((largest + least) / 2.0)
    return layer


def lstm_weights(lstm: torch.nn.LSTM) -> dict[str, AnyArray]:
    """Return the weights of an LSTM for ONNX's operator LSTM, by name.

    Returns:
        ``kernel``, ONNX's W, shape (1, 4 H, I); ``recurrence``, R, shape (1, 4 H, H); ``bias``, B, shape (1, 8 H).
    """
    parts: Any = lstm.all_weights[0]
    kernel, recurrence, *biases = [
        np.concatenate([np.split(part.detach().cpu().numpy(), 4)[gate] for gate in _GATES]) for part in parts
    ]
    return {"kernel": kernel[None], "recurrence": recurrence[None], "bias": np.concatenate(biases)[None]}


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


def build_file(net: torch.nn.Sequential, info: PolicyInfo, title: str) -> bytes:
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
    inputs = graph.net(net, value)
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

    def head(self, layer: Any, value: str) -> str:
        """Add one of RLlib's heads, which may limit the logarithms of standard deviations."""
        value, limit = self.net(layer.net.mlp, value), float(layer.log_std_clip_param_const)
        if type(layer) is TorchFreeLogStdMLPHead:
            log_std = layer.log_std.detach()
            return self.spread(log_std.clamp(-limit, limit) if layer.clip_log_std else log_std, value)
        if not layer.clip_log_std:
            return value
        width = int(layer.net.mlp[-1].out_features) // 2
        bounds = [self.constant(-limit, "log_std_low"), self.constant(limit, "log_std_high")]
        spread = self.node("Clip", [self.part(value, width, 2 * width), *bounds])
        return self.node("Concat", [self.part(value, 0, width), spread], axis=1)

    def spread(self, log_std: torch.Tensor, value: str) -> str:
        """Add the logarithms of fixed standard deviations after the means."""
        row = self.constant(_array(log_std)[None, :], "log_std")
        return self.node("Concat", [value, self.node("Expand", [row, self.node("Shape", [value])])], axis=1)

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
        if type(layer) is Spread:
            return self.spread(layer.log_std, value)
        if type(layer) is torch.nn.LSTM:
            return self.lstm(layer, value)
        if type(layer) in (TorchMLPHead, TorchFreeLogStdMLPHead):
            return self.head(layer, value)
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
