"""Tanh for the training of small nets: Torch's takes longer than half a layer's matrix product."""

from __future__ import annotations

import numpy as np

from safe_inspect.compiling import njit
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
def tanh_in_place(x: AnyArray) -> None:
    """Turn x, float32, shape (n,), into tanh(x) to within 4e-7.

    One array: of two that may overlap the compiler would not compute many numbers at once.
    """
    for i in range(x.shape[0]):
        v = min(max(x[i], -_LIMIT), _LIMIT)
        s = v * v
        p = (((_P4 * s + _P3) * s + _P2) * s + _P1) * s + _P0
        q = (((_Q4 * s + _Q3) * s + _Q2) * s + _Q1) * s + _Q0
        x[i] = v * p / q


@_vectorised  # type: ignore[untyped-decorator]
def tanh_gradient(y: AnyArray, gradient: AnyArray, sums: AnyArray) -> None:
    """Turn the gradient behind a tanh that gave y into the one before it, in place, and sum it over the rows.

    Args:
        y: float32, shape (B, H).
        gradient: float32, shape (B, H).
        sums: Receives the sums, the gradient of a bias, shape (H,).
    """
    sums[:] = np.float32(0.0)
    for i in range(y.shape[0]):
        for j in range(y.shape[1]):
            found = gradient[i, j] * (np.float32(1.0) - y[i, j] * y[i, j])
            gradient[i, j] = found
            sums[j] += found
