"""Forward and backward passes of a minibatch through a net that learns."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol

import torch

from safe_inspect.experiments.modules.tanh_net import TanhNet

#: Inputs of the action distribution, and values; None if a net does not compute them.
Outputs = tuple[torch.Tensor | None, torch.Tensor | None]


class Pass(Protocol):
    """Forward and backward pass through a net."""

    def forward(self, observations: torch.Tensor) -> Outputs:
        """Return the outputs for observations (B, O): inputs of the action distribution (B, I) and values (B,)."""

    def backward(self, gradients: Outputs) -> list[torch.Tensor]:
        """Return the gradients of the parameters, given those with respect to the outputs of the last `forward`."""


class AutogradPass:
    """Pass through any net, with Torch's autograd.

    Args:
        net: The net as a function of observations.
        parameters: The parameters of the net that learn.
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
    """Pass through a net of tanh layers that computes one of the two outputs.

    Args:
        net: The net.
        values: Whether it computes the values; otherwise it computes the inputs of the action distribution.
    """

    def __init__(self, net: TanhNet, values: bool) -> None:
        self._net, self._values = net, values

    def forward(self, observations: torch.Tensor) -> Outputs:
        """See `Pass`."""
        with torch.no_grad():
            found = self._net.forward(observations)
        return (None, found.squeeze(-1)) if self._values else (found, None)

    def backward(self, gradients: Outputs) -> list[torch.Tensor]:
        """See `Pass`; the gradients are changed in place."""
        inputs, values = gradients
        push = inputs if values is None else values.unsqueeze(-1)
        assert push is not None, "the gradient of the one output that the net computes"
        with torch.no_grad():
            return self._net.backward(push)
