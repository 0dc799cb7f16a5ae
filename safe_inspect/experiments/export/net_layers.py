"""`Perceptron`: the net of a policy of any learner, as layers. Importing this module loads Ray and Torch."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch
from ray.rllib.core.columns import Columns

from safe_inspect.errors import CheckpointError
from safe_inspect.experiments.modules.dqn_policy import BestChoices, DqnPolicy
from safe_inspect.experiments.modules.sac_policy import SacPolicy
from safe_inspect.types import FloatArray

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
