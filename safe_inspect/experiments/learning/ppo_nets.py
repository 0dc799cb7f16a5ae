"""The nets of a policy's module: passes of a minibatch through them, and the optimisers of their parameters."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import torch
from ray.rllib.core.columns import Columns

from safe_inspect.experiments.learning.fast_adam import FastAdam, is_plain
from safe_inspect.experiments.modules.tanh_net import (
    TRAINING,
    PlainLayers,
    TanhNet,
    linear_layers,
    policy_layers,
    value_layers,
)


@dataclass(frozen=True)
class Net:
    """A part of a module that shares no parameters with other parts, and so can learn separately.

    Attributes:
        make_pass: Function from the number of rows of a minibatch to a pass through the net.
        parameters: Its parameters that learn.
        why_autograd: Why Torch's autograd computes its gradients; empty if `TanhNet` does, which takes less time.
    """

    make_pass: Callable[[int], Pass]
    parameters: Sequence[torch.nn.Parameter]
    why_autograd: str = ""


class Optimiser(Protocol):
    """Optimiser of the parameters of a net."""

    def step(self, gradients: Sequence[torch.Tensor]) -> None:
        """Take a step, given the gradients of the parameters."""


def nets_of(module: Any, together: bool = False) -> list[Net]:
    """Return a module's nets: policy and value function if they are separate, otherwise one net that computes both.

    Args:
        module: RLlib's module of the policy.
        together: Whether to return one net in any case.
    """
    whole = _whole(module)
    if together:
        return [replace(whole, why_autograd="the gradients of policy and value function are clipped together")]
    found = (policy_layers(module, TRAINING), value_layers(module))
    if found[0] is None or found[1] is None:
        return [replace(whole, why_autograd="its module is not RLlib's own with an encoder for each net")]
    parts = [_part(found[0], False), _part(found[1], True)]
    known = [id(parameter) for part in parts for parameter in part.parameters]
    if len(set(known)) < len(known) or set(known) != {id(parameter) for parameter in whole.parameters}:
        return [replace(whole, why_autograd="policy and value function share parameters")]
    return parts


def _whole(module: Any) -> Net:
    parameters = _learning(module)

    def forward(observations: torch.Tensor) -> Outputs:
        batch = {Columns.OBS: observations}
        outputs = module.forward_train(batch)
        values = module.compute_values(batch, embeddings=outputs.get(Columns.EMBEDDINGS))
        return outputs[Columns.ACTION_DIST_INPUTS], values

    return Net(lambda rows: AutogradPass(forward, parameters), parameters)


def _part(found: PlainLayers, values: bool) -> Net:
    body: Any = found.body
    head: Any = found.head
    parameters = [*_learning(body), *_learning(head)]
    layers = linear_layers(body, head.net.mlp) if found.whole else None
    if layers is not None and len(parameters) == 2 * len(layers):
        limit = float(head.log_std_clip_param) if head.clip_log_std else None
        return Net(lambda rows: TanhPass(TanhNet(layers, rows, limit), values), parameters)

    def forward(observations: torch.Tensor) -> Outputs:
        outputs = head(body(observations))
        return (None, outputs.squeeze(-1)) if values else (outputs, None)

    return Net(
        lambda rows: AutogradPass(forward, parameters), parameters, "its layers are not linear with tanh between"
    )


def _learning(module: Any) -> list[torch.nn.Parameter]:
    return [parameter for parameter in module.parameters() if parameter.requires_grad]


class _TorchAdam:
    """Torch's Adam with the settings and the state of another optimiser, for some of its parameters."""

    def __init__(self, optimiser: Any, parameters: Sequence[torch.nn.Parameter]) -> None:
        (group,) = optimiser.param_groups
        names = ("lr", "betas", "eps", "weight_decay", "amsgrad", "maximize")
        self._parameters = parameters
        self._adam = torch.optim.Adam(parameters, **{name: group[name] for name in names}, fused=True)
        for parameter in parameters:
            state = optimiser.state[parameter]
            state["step"] = state["step"].to(
                parameter.device
            )  # a fused Adam needs its step counts on the device of the parameters
            self._adam.state[parameter] = state

    def step(self, gradients: Sequence[torch.Tensor]) -> None:
        """Take a step."""
        for parameter, gradient in zip(self._parameters, gradients, strict=True):
            parameter.grad = gradient
        self._adam.step()


def part_of(optimiser: Any, parameters: Sequence[torch.nn.Parameter]) -> Optimiser:
    """Return an optimiser for some of the parameters of another one, whose settings and state it shares.

    RLlib has one optimiser for all parameters of a module, and checkpoints contain the state of that optimiser.
    """
    for parameter in parameters:
        state = optimiser.state[parameter]
        if not state:
            state["step"] = torch.zeros((), dtype=torch.float32, device=parameter.device)
            state["exp_avg"] = torch.zeros_like(parameter)
            state["exp_avg_sq"] = torch.zeros_like(parameter)
    plain = is_plain(optimiser) and all(p.dtype == torch.float32 and p.device.type == "cpu" for p in parameters)
    return FastAdam(optimiser, parameters) if plain else _TorchAdam(optimiser, parameters)


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
