"""Tanh for the training of small nets: Torch's takes longer than half a layer's matrix product."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import torch

from safe_inspect.compiled import njit
from safe_inspect.types import AnyArray

#: From here on tanh rounds to 1.
_LIMIT = np.float32(9.02)

# tanh(x) = x P(x^2) / Q(x^2) within the limit: fitted by least squares, reweighted until the largest relative error
# (2.1e-8 in exact arithmetic) no longer fell.
_P0, _P1, _P2, _P3, _P4 = map(
    np.float32,
    (0.9999999790710492, 0.13379718625014736, 0.0034940352998007167, 2.058349174824071e-05, 1.3319083850922023e-08),
)
_Q0, _Q1, _Q2, _Q3, _Q4 = map(
    np.float32,
    (1.0, 0.46713033880548854, 0.025871076175641643, 0.00032830939689300917, 7.762024863258839e-07),
)

# The compiler may fuse products into sums and use many numbers at once; a division by zero cannot happen.
_vectorised = njit(cache=True, nogil=True, fastmath={"contract", "nsz"}, error_model="numpy")


@_vectorised  # type: ignore[untyped-decorator]
def tanh_of(x: AnyArray, y: AnyArray) -> None:
    """Write tanh(x), float32, to within 4e-7; both have shape (n,)."""
    for i in range(x.shape[0]):
        v = min(max(x[i], -_LIMIT), _LIMIT)
        s = v * v
        p = (((_P4 * s + _P3) * s + _P2) * s + _P1) * s + _P0
        q = (((_Q4 * s + _Q3) * s + _Q2) * s + _Q1) * s + _Q0
        y[i] = v * p / q


@_vectorised  # type: ignore[untyped-decorator]
def tanh_gradient(y: AnyArray, gradient: AnyArray, found: AnyArray) -> None:
    """Write the gradient before a tanh that gave y, from the gradient behind it; all have shape (n,)."""
    for i in range(y.shape[0]):
        found[i] = gradient[i] * (np.float32(1.0) - y[i] * y[i])


class _Tanh(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, x: torch.Tensor) -> torch.Tensor:
        x = x.contiguous()
        y = torch.empty_like(x)
        tanh_of(x.numpy().reshape(-1), y.numpy().reshape(-1))
        ctx.save_for_backward(y)
        return y

    @staticmethod
    def backward(ctx: Any, *gradients: Any) -> torch.Tensor:
        (y,) = ctx.saved_tensors
        gradient = gradients[0].contiguous()
        found = torch.empty_like(gradient)
        tanh_gradient(y.numpy().reshape(-1), gradient.numpy().reshape(-1), found.numpy().reshape(-1))
        return found


def with_fast_tanh(layers: Sequence[torch.nn.Module]) -> Callable[[torch.Tensor], torch.Tensor]:
    """Return the function of some layers, which share their parameters with it; on the processor, float32."""
    steps: list[Callable[[torch.Tensor], torch.Tensor]] = [
        _Tanh.apply if type(layer) is torch.nn.Tanh else layer for layer in layers
    ]

    def forward(batch: torch.Tensor) -> torch.Tensor:
        for step in steps:
            batch = step(batch)
        return batch

    return forward
