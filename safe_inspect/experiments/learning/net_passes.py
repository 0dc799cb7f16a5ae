"""Passes of a minibatch through a net that learns: forwards to its outputs, backwards to its parameters' gradients."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol

import torch

#: Inputs of the action distribution, and values; None where a net does not give them.
Outputs = tuple[torch.Tensor | None, torch.Tensor | None]


class Pass(Protocol):
    """The way through a net."""

    def forward(self, observations: torch.Tensor) -> Outputs:
        """Return the outputs for observations (B, O): inputs (B, I) and values (B,)."""

    def backward(self, gradients: Outputs) -> list[torch.Tensor]:
        """Return the gradients of the parameters, from those of the outputs of the last `forward`."""


class AutogradPass:
    """The way through any net.

    Args:
        net: The net as a function of observations.
        parameters: Its parameters that learn.
    """

    def __init__(self, net: Callable[[torch.Tensor], Outputs], parameters: Sequence[torch.nn.Parameter]) -> None:
        self._net, self._parameters = net, parameters
        self._outputs: Outputs = (None, None)

    def forward(self, observations: torch.Tensor) -> Outputs:
        """See `Pass`."""
        self._outputs = self._net(observations)
        inputs, values = self._outputs
        return (None if inputs is None else inputs.detach(), None if values is None else values.detach())

    def backward(self, gradients: Outputs) -> list[torch.Tensor]:
        """See `Pass`."""
        pairs = zip(self._outputs, gradients, strict=True)
        outputs, pushes = zip(*((out, push) for out, push in pairs if out is not None), strict=True)
        found = torch.autograd.grad(outputs, self._parameters, pushes, allow_unused=True)
        return [
            torch.zeros_like(parameter) if gradient is None else gradient
            for parameter, gradient in zip(self._parameters, found, strict=True)
        ]
