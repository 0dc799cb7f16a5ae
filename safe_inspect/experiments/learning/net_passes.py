"""Passes of a minibatch through a net that learns: forwards to its outputs, backwards to its parameters' gradients."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol

import torch

from safe_inspect.experiments.modules.tanh_net import TanhNet

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


class TanhPass:
    """The way through a net of tanh layers that gives one of the two outputs.

    Args:
        net: The net.
        values: Whether it gives the values; else the inputs of the action distribution.
    """

    def __init__(self, net: TanhNet, values: bool) -> None:
        self._net, self._values = net, values

    def forward(self, observations: torch.Tensor) -> Outputs:
        """See `Pass`."""
        with torch.no_grad():
            found = self._net.forward(observations)
        return (None, found.squeeze(-1)) if self._values else (found, None)

    def backward(self, gradients: Outputs) -> list[torch.Tensor]:
        """See `Pass`; the gradients are changed."""
        inputs, values = gradients
        push = inputs if values is None else values.unsqueeze(-1)
        assert push is not None, "the gradient of the one output that it gives"
        with torch.no_grad():
            return self._net.backward(push)
