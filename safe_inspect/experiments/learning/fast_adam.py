"""`FastAdam`: Torch's Adam for the few small arrays of a net, without Torch's overhead, which takes longer."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import torch

from safe_inspect.compiling import njit
from safe_inspect.types import AnyArray


@njit(nogil=True, fastmath={"contract", "nsz"}, error_model="numpy")
def adam_step(
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
        optimiser: An Adam, see `is_plain`.
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
            adam_step(
                parameter,
                gradient.view(-1).numpy(),
                mean,
                square,
                (1.0 - one, 1.0 - two),
                rate / (1.0 - one**count),
                1.0 / math.sqrt(1.0 - two**count),
                epsilon,
            )


def is_plain(optimiser: Any) -> bool:
    """Return whether an optimiser is an Adam with one group of contiguous arrays and without optional features.

    The optional features are `weight_decay`, `amsgrad` and `maximize`.
    """
    if type(optimiser) is not torch.optim.Adam or len(optimiser.param_groups) != 1:
        return False
    (group,) = optimiser.param_groups
    return not (group["weight_decay"] or group["amsgrad"] or group["maximize"]) and all(
        parameter.is_contiguous() for parameter in group["params"]
    )
