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
from safe_inspect.experiments.modules.tanh_net import TRAINING, PlainLayers, TanhNet, linear_layers, plain_layers
from safe_inspect.types import AnyArray

Outputs = tuple[torch.Tensor, ...]


class AutogradPass:
    """Pass through any net, with Torch's autograd; `TanhNet` is such a pass too, and takes less time.

    Args:
        net: The net as a function from observations to its outputs, each of shape (B, number of columns).
        parameters: The parameters of the net that learn.
    """

    def __init__(self, net: Callable[[torch.Tensor], Outputs], parameters: Sequence[torch.nn.Parameter]) -> None:
        self._net, self._parameters = net, parameters
        self._outputs: Outputs = ()

    def forward(self, batch: torch.Tensor) -> torch.Tensor:
        """Return the columns of all outputs for observations (B, O)."""
        self._outputs = self._net(batch)
        return torch.cat([output.detach() for output in self._outputs], dim=1)

    def backward(self, gradient: torch.Tensor) -> list[torch.Tensor]:
        """Return the gradients of the parameters, given that with respect to the columns of the last `forward`."""
        widths = [output.shape[1] for output in self._outputs]
        pushes = [part.contiguous() for part in torch.split(gradient, widths, dim=1)]  # type: ignore[no-untyped-call]
        found = torch.autograd.grad(self._outputs, self._parameters, pushes, allow_unused=True)
        return [
            torch.zeros_like(parameter) if gradient is None else gradient
            for parameter, gradient in zip(self._parameters, found, strict=True)
        ]


@dataclass(frozen=True)
class Net:
    """A part of a module that shares no parameters with other parts, and so can learn separately.

    Its outputs are the inputs of the action distribution (I columns) if it acts, and then the value (one column) if it
    values.

    Attributes:
        make_pass: Function from the number of rows of a minibatch to a pass through the net.
        parameters: Its parameters that learn.
        acts: Whether it computes the inputs of the action distribution.
        values: Whether it computes the value.
        why_autograd: Why Torch's autograd computes its gradients; empty if `TanhNet` does, which takes less time.
    """

    make_pass: Callable[[int], AutogradPass | TanhNet]
    parameters: Sequence[torch.nn.Parameter]
    acts: bool = True
    values: bool = True
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
    policy, value = (plain_layers(module, TRAINING, values=values) for values in (False, True))
    if policy is None or value is None:
        return [replace(whole, why_autograd="its module is not RLlib's own with an encoder for each net")]
    parts = [_part(policy, False), _part(value, True)]
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
        return outputs[Columns.ACTION_DIST_INPUTS], values.unsqueeze(-1)

    return Net(lambda rows: AutogradPass(forward, parameters), parameters)


def _part(found: PlainLayers, values: bool) -> Net:
    parameters = [*_learning(found.body), *_learning(found.head)]
    layers = linear_layers(found.body, found.head.net.mlp) if found.whole else None
    if layers is not None and len(parameters) == 2 * len(layers):
        return Net(lambda rows: TanhNet(layers, rows, found.limit), parameters, not values, values)
    why = "its layers are not linear with tanh between"
    return Net(lambda rows: AutogradPass(lambda seen: (found(seen),), parameters), parameters, not values, values, why)


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
