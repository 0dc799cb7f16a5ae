"""`TanhPass`: a minibatch through a `TanhNet`, forwards and backwards."""

from __future__ import annotations

import torch

from safe_inspect.experiments.learning.fast_nets.tanh_net import TanhNet
from safe_inspect.experiments.learning.net_passes import Outputs


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
