"""The nets of a policy's module: passes of a minibatch through them, and the optimisers of their parameters."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from ray.rllib.core.columns import Columns

from safe_inspect.compiling import njit
from safe_inspect.experiments.modules.tanh_net import (
    TRAINING,
    PlainLayers,
    TanhNet,
    linear_layers,
    policy_layers,
    value_layers,
)
from safe_inspect.types import AnyArray

#: Inputs of the action distribution, and values; None if a net does not compute them.
Outputs = tuple[torch.Tensor | None, torch.Tensor | None]


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
        """Return the outputs for observations (B, O): inputs of the action distribution (B, I) and values (B,)."""
        self._outputs = self._net(observations)
        inputs, values = self._outputs
        return (None if inputs is None else inputs.detach(), None if values is None else values.detach())

    def backward(self, gradients: Outputs) -> list[torch.Tensor]:
        """Return the gradients of the parameters, given those with respect to the outputs of the last `forward`."""
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
        """See `AutogradPass.forward`."""
        with torch.no_grad():
            found = self._net.forward(observations)
        return (None, found.squeeze(-1)) if self._values else (found, None)

    def backward(self, gradients: Outputs) -> list[torch.Tensor]:
        """See `AutogradPass.backward`; the gradients are changed in place."""
        inputs, values = gradients
        push = inputs if values is None else values.unsqueeze(-1)
        assert push is not None, "the gradient of the one output that the net computes"
        with torch.no_grad():
            return self._net.backward(push)


@dataclass(frozen=True)
class Net:
    """A part of a module that shares no parameters with other parts, and so can learn separately.

    Attributes:
        make_pass: Function from the number of rows of a minibatch to a pass through the net.
        parameters: Its parameters that learn.
        why_autograd: Why Torch's autograd computes its gradients; empty if `TanhNet` does, which takes less time.
    """

    make_pass: Callable[[int], AutogradPass | TanhPass]
    parameters: Sequence[torch.nn.Parameter]
    why_autograd: str = ""


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
    parameters = [*_learning(found.body), *_learning(found.head)]
    layers = linear_layers(found.body, found.head.net.mlp) if found.whole else None
    if layers is not None and len(parameters) == 2 * len(layers):
        return Net(lambda rows: TanhPass(TanhNet(layers, rows, found.limit), values), parameters)

    def forward(observations: torch.Tensor) -> Outputs:
        outputs = found(observations)
        return (None, outputs.squeeze(-1)) if values else (outputs, None)

    return Net(
        lambda rows: AutogradPass(forward, parameters), parameters, "its layers are not linear with tanh between"
    )


def _learning(module: Any) -> list[torch.nn.Parameter]:
    return [parameter for parameter in module.parameters() if parameter.requires_grad]


class TorchAdam:
    """Torch's Adam with the settings and the state of another optimiser, for some of its parameters."""

    def __init__(self, optimiser: Any, parameters: Sequence[torch.nn.Parameter]) -> None:
        (group,) = optimiser.param_groups
        self._parameters = parameters
        self._adam = torch.optim.Adam(parameters, lr=group["lr"], betas=group["betas"], eps=group["eps"], fused=True)
        for parameter in parameters:
            state = optimiser.state[parameter]
            # A fused Adam needs its step counts on the device of the parameters.
            state["step"] = state["step"].to(parameter.device)
            self._adam.state[parameter] = state

    def step(self, gradients: Sequence[torch.Tensor]) -> None:
        """Take a step."""
        for parameter, gradient in zip(self._parameters, gradients, strict=True):
            parameter.grad = gradient
        self._adam.step()


def part_of(optimiser: Any, parameters: Sequence[torch.nn.Parameter]) -> FastAdam | TorchAdam:
    """Return an optimiser for some of the parameters of RLlib's Adam, whose settings and state it shares.

    RLlib has one optimiser for all parameters of a module, and checkpoints contain the state of that optimiser.
    """
    for parameter in parameters:
        state = optimiser.state[parameter]
        if not state:
            state["step"] = torch.zeros((), dtype=torch.float32, device=parameter.device)
            state["exp_avg"] = torch.zeros_like(parameter)
            state["exp_avg_sq"] = torch.zeros_like(parameter)
    on_cpu = all(p.dtype == torch.float32 and p.device.type == "cpu" for p in parameters)
    return FastAdam(optimiser, parameters) if on_cpu else TorchAdam(optimiser, parameters)


@njit(nogil=True, fastmath={"contract", "nsz"}, error_model="numpy")
def _adam_step(
    parameter: AnyArray,
    gradient: AnyArray,
    mean: AnyArray,
    square: AnyArray,
    forget: tuple[float, float],
    rate: float,
    scale: float,
    epsilon: float,
) -> None:
    """Take a step of Adam in place; all arrays are float32, shape (n,).

    Source: Kingma and Ba, Adam: A Method for Stochastic Optimization, 2015, algorithm 1.

    Args:
        parameter: theta, changed in place.
        gradient: g.
        mean: m, changed in place.
        square: v, changed in place.
        forget: 1 - beta_1 and 1 - beta_2.
        rate: Learning rate alpha / (1 - beta_1^t).
        scale: 1 / sqrt(1 - beta_2^t).
        epsilon: epsilon.
    """
    first, second = np.float32(forget[0]), np.float32(forget[1])
    alpha, spread, least = np.float32(rate), np.float32(scale), np.float32(epsilon)
    for i in range(parameter.shape[0]):
        g = gradient[i]
        m = mean[i] + first * (g - mean[i])
        v = square[i] + second * (g * g - square[i])
        mean[i] = m
        square[i] = v
        parameter[i] -= alpha * m / (np.sqrt(v) * spread + least)


class FastAdam:
    """Adam that shares the settings and the state of one of Torch's optimisers.

    Args:
        optimiser: RLlib's Adam, with one group.
        parameters: Some of its parameters, float32, on the CPU.
    """

    def __init__(self, optimiser: torch.optim.Adam, parameters: Sequence[torch.nn.Parameter]) -> None:
        (self._group,) = optimiser.param_groups
        states = [optimiser.state[parameter] for parameter in parameters]
        self._steps: list[torch.Tensor] = [state["step"] for state in states]
        self._arrays = [
            [part.detach().view(-1).numpy() for part in (parameter, state["exp_avg"], state["exp_avg_sq"])]
            for parameter, state in zip(parameters, states, strict=True)
        ]

    def step(self, gradients: Sequence[torch.Tensor]) -> None:
        """Take a step.

        Args:
            gradients: Gradients of the parameters, in their order.
        """
        one, two = (float(beta) for beta in self._group["betas"])
        rate, epsilon = float(self._group["lr"]), float(self._group["eps"])
        for step, (parameter, mean, square), gradient in zip(self._steps, self._arrays, gradients, strict=True):
            step += 1.0
            count = float(step)
            _adam_step(
                parameter,
                gradient.view(-1).numpy(),
                mean,
                square,
                (1.0 - one, 1.0 - two),
                rate / (1.0 - one**count),
                1.0 / math.sqrt(1.0 - two**count),
                epsilon,
            )
