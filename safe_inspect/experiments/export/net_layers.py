"""The layers of a policy of RLlib or of any other learner. Importing this module loads Ray and Torch."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import torch
from ray.rllib.core.columns import Columns
from ray.rllib.core.models.torch.encoder import TorchLSTMEncoder

from safe_inspect.errors import CheckpointError
from safe_inspect.experiments.modules.saved_policy import BestChoices, DqnPolicy, SacPolicy
from safe_inspect.types import AnyArray, FloatArray

#: Logarithm of the standard deviation of a deterministic policy; samples equal the mean to all digits.
NO_SPREAD = -20.0


@dataclass(frozen=True, eq=False)
class Perceptron:
    """The net of a policy: layers from the observation to means or logits.

    Attributes:
        layers: Linear layers and activations, in order.
        log_std: Logarithms of the standard deviations, shape (A,); None for a categorical policy.
    """

    layers: torch.nn.Sequential
    log_std: torch.Tensor | None

    def forward_inference(self, batch: Mapping[str, Any]) -> dict[str, Any]:
        """Return the inputs of the action distributions, as RLlib's modules do."""
        value = self.layers(batch[Columns.OBS])
        if self.log_std is not None:
            value = torch.cat((value, self.log_std.detach().expand_as(value)), dim=1)
        return {Columns.ACTION_DIST_INPUTS: value}


def mode_of_sac(module: SacPolicy, title: str) -> Perceptron:
    """Return the mode of RLlib's policy for SAC, tanh(mean).

    The files cannot describe the squashed Gaussian from which this policy samples its actions.

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
    layers = torch.nn.Sequential(*list(encoder), *list(head)[:-1], mean, torch.nn.Tanh())
    return Perceptron(layers.eval(), torch.full((size,), NO_SPREAD))


def best_of_dqn(module: DqnPolicy, title: str) -> Perceptron:
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
    return Perceptron(torch.nn.Sequential(*layers).eval(), None)


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


#: Names of an ONNX file's inputs for the state of an LSTM: output and cell.
STATE = ("state_h", "state_c")

_GATES = (0, 3, 1, 2)  # input, forget, cell, output in Torch; input, output, forget, cell in ONNX


class EncoderLayers(NamedTuple):
    """The layers before the head of a policy.

    Attributes:
        dense: Dense layers and activations, in order.
        lstm: The LSTM after them; None for a policy without a state.
    """

    dense: torch.nn.Sequential
    lstm: torch.nn.LSTM | None


def encoder_layers(module: Any) -> EncoderLayers | None:
    """Return the layers before the head of an RLModule's policy; None if they are of an unsupported kind."""
    own = getattr(module, "encoder", None)
    encoder = getattr(own, "actor_encoder", None) or getattr(own, "encoder", None)
    lstm = None
    if type(encoder) is TorchLSTMEncoder:
        lstm, encoder = encoder.lstm, encoder.tokenizer
        if lstm.num_layers != 1:
            return None
    dense = getattr(getattr(encoder, "net", None), "mlp", None)
    return EncoderLayers(dense, lstm) if isinstance(dense, torch.nn.Sequential) else None


def state_sizes(module: Any) -> dict[str, int]:
    """Return the sizes of the inputs of `STATE`; empty for a module without a state."""
    layers = encoder_layers(module)
    return {} if layers is None or layers.lstm is None else dict.fromkeys(STATE, layers.lstm.hidden_size)


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
