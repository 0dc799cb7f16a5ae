"""The layers of policies whose class declares them: RLlib's own PPO module with MLP encoders and heads.

A module of one of these classes gives what its layers give, so that sampler and learner call them without RLlib's
dictionaries, which cost as much as the layers. A class that overrides a step of the way is asked as a whole.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import torch
from ray.rllib.algorithms.ppo.torch.default_ppo_torch_rl_module import DefaultPPOTorchRLModule
from ray.rllib.core.models.torch.encoder import TorchActorCriticEncoder, TorchMLPEncoder
from ray.rllib.core.models.torch.heads import TorchFreeLogStdMLPHead, TorchMLPHead
from ray.rllib.core.models.torch.primitives import TorchMLP

#: Methods of the module on the way to a sampled action, and to the losses.
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
        """Whether the layers of the head give all its outputs; else it has logarithms of deviations beside them."""
        return type(self.head) is TorchMLPHead


def policy_layers(module: Any, methods: tuple[str, ...]) -> PlainLayers | None:
    """Return the layers of a module's policy; None where its class does not declare them.

    Args:
        module: RLlib's module.
        methods: The methods that the layers stand for, `SAMPLING` or `TRAINING`.
    """
    if not _is_plain(module, methods):
        return None
    encoder = module.encoder
    return _layers(encoder.encoder if encoder.config.shared else encoder.actor_encoder, module.pi)


def value_layers(module: Any) -> PlainLayers | None:
    """Return the layers of a module's value function; None where it has none of its own, or its class is another."""
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
