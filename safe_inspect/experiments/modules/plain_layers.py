"""The layers of policies whose outputs are those of plain layers: RLlib's own PPO module with MLP encoders and heads.

The outputs of such a module are those of its layers, so sampler and learner call the layers without RLlib's
dictionaries, which take as long as the layers. A module whose class overrides one of the methods is called as a whole.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import torch
from ray.rllib.algorithms.ppo.torch.default_ppo_torch_rl_module import DefaultPPOTorchRLModule
from ray.rllib.core.models.torch.encoder import TorchActorCriticEncoder, TorchMLPEncoder
from ray.rllib.core.models.torch.heads import TorchFreeLogStdMLPHead, TorchMLPHead
from ray.rllib.core.models.torch.primitives import TorchMLP

#: Methods of the module that are involved in sampling an action, and in computing the losses.
SAMPLING = ("_forward", "_forward_exploration", "_forward_inference", "forward_exploration", "forward_inference")
TRAINING = ("forward_train", "_forward_train", "compute_values")


class PlainLayers(NamedTuple):
    """A net whose outputs are ``head(body(observations))``.

    Attributes:
        body: The layers of the encoder.
        head: RLlib's head.
    """

    body: torch.nn.Sequential
    head: torch.nn.Module

    @property
    def whole(self) -> bool:
        """Whether the layers of the head give all outputs; otherwise it also has logarithms of standard deviations."""
        return type(self.head) is TorchMLPHead


def policy_layers(module: Any, methods: tuple[str, ...]) -> PlainLayers | None:
    """Return the layers of a module's policy; None if its outputs are not those of plain layers.

    Args:
        module: RLlib's module.
        methods: The methods that the layers replace, `SAMPLING` or `TRAINING`.
    """
    if not _is_plain(module, methods):
        return None
    encoder = module.encoder
    return _layers(encoder.encoder if encoder.config.shared else encoder.actor_encoder, module.pi)


def value_layers(module: Any) -> PlainLayers | None:
    """Return the layers of a module's value function; None if it has no separate layers or is of another class."""
    if not _is_plain(module, TRAINING) or module.encoder.config.shared:
        return None
    return _layers(module.encoder.critic_encoder, module.vf)


def _is_plain(module: Any, methods: tuple[str, ...]) -> bool:
    ours = DefaultPPOTorchRLModule
    return (
        isinstance(module, ours)
        and all(getattr(type(module), name) is getattr(ours, name) for name in methods)
        and type(module.encoder) is TorchActorCriticEncoder
    )


def _layers(encoder: Any, head: Any) -> PlainLayers | None:
    known = type(encoder) is TorchMLPEncoder and type(encoder.net) is TorchMLP
    if not known or type(head) not in (TorchMLPHead, TorchFreeLogStdMLPHead):
        return None
    return PlainLayers(encoder.net.mlp, head)
