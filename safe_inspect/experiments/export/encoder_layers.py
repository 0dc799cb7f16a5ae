"""Layers of RLlib's encoders, and weights of an LSTM in ONNX's order. Importing this module loads Ray and Torch."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import torch
from ray.rllib.core.models.torch.encoder import TorchLSTMEncoder

from safe_inspect.types import AnyArray

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
