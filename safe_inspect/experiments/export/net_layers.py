"""The layers of a policy of RLlib or of any other learner. Importing this module loads Ray and Torch."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from ray.rllib.algorithms.ppo.torch.default_ppo_torch_rl_module import DefaultPPOTorchRLModule
from ray.rllib.core.columns import Columns
from ray.rllib.core.models.torch.encoder import TorchLSTMEncoder
from ray.rllib.core.models.torch.heads import TorchFreeLogStdMLPHead, TorchMLPHead

from safe_inspect.errors import CheckpointError
from safe_inspect.experiments.modules.saved_policy import BestChoices, DqnPolicy, SacPolicy
from safe_inspect.types import AnyArray, FloatArray

#: Logarithm of the standard deviation of a deterministic policy; samples equal the mean to all digits.
NO_SPREAD = -20.0


#: Names of an ONNX file's inputs for the state of an LSTM: output and cell.
STATE = ("state_h", "state_c")

_GATES = (0, 3, 1, 2)  # input, forget, cell, output in Torch; input, output, forget, cell in ONNX


@dataclass(frozen=True, eq=False)
class NetLayers:
    """The layers of a policy from the observation to the inputs of the action distribution: means or logits first.

    Attributes:
        dense: Dense layers and activations, in order.
        lstm: The LSTM after them; None for a policy without a state.
        head: Further dense layers and activations.
        log_std: Logarithms of the standard deviations, shape (A,); None if there are none, or the layers give them.
        limit: Largest magnitude of the logarithms of standard deviations, the second half of the outputs of the layers;
            None for no limit.
    """

    dense: torch.nn.Sequential
    lstm: torch.nn.LSTM | None = None
    head: Sequence[torch.nn.Module] = ()
    log_std: torch.Tensor | None = None
    limit: float | None = None

    @property
    def state(self) -> dict[str, int]:
        """The sizes of the inputs of `STATE`; empty for a policy without a state."""
        return {} if self.lstm is None else dict.fromkeys(STATE, self.lstm.hidden_size)

    def forward_inference(self, batch: Mapping[str, Any]) -> dict[str, Any]:
        """Return the inputs of the action distributions, as RLlib's modules do, for dense layers without a limit."""
        value = self.dense(batch[Columns.OBS])
        if self.log_std is not None:
            value = torch.cat((value, self.log_std.detach().expand_as(value)), dim=1)
        return {Columns.ACTION_DIST_INPUTS: value}


def layers_of(module: Any, title: str) -> NetLayers:
    """Return the layers of a policy of RLlib; of SAC the mode, tanh(mean), and of DQN the values of the choices.

    The files cannot describe the squashed Gaussian from which SAC samples its actions.

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
    return with_head(dense, lstm, module.pi)


def with_head(dense: torch.nn.Sequential, lstm: torch.nn.LSTM | None, head: Any) -> NetLayers:
    """Return layers that end with one of RLlib's heads."""
    limit = float(head.log_std_clip_param_const) if head.clip_log_std else None
    if not isinstance(head, TorchFreeLogStdMLPHead):
        return NetLayers(dense, lstm, head.net.mlp, limit=limit)
    log_std = head.log_std.detach()
    return NetLayers(dense, lstm, head.net.mlp, log_std if limit is None else log_std.clamp(-limit, limit))


def _mode_of_sac(module: SacPolicy, title: str) -> NetLayers:
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
    layers = torch.nn.Sequential(*list(encoder), *list(head)[:-1], mean, torch.nn.Tanh())
    return NetLayers(layers.eval(), log_std=torch.full((size,), NO_SPREAD))


def _best_of_dqn(module: DqnPolicy, title: str) -> NetLayers:
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
    return NetLayers(torch.nn.Sequential(*layers).eval())


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
