"""The kernel that computes the control from actions when every controller passes on the value of a different axis."""

from __future__ import annotations

import math

from safe_inspect.compiling import njit
from safe_inspect.types import FloatArray, IntArray


@njit
def _within(value: float, low: float, high: float) -> float:
    value = value if value >= low else low
    return value if value <= high else high


@njit
def command(
    action: FloatArray,
    low: FloatArray,
    high: FloatArray,
    least: FloatArray,
    most: FloatArray,
    axes: IntArray,
    clipped: FloatArray,
    control: FloatArray,
) -> bool:
    """Write the clipped actions, shape (R, A), and the control [N, N m], shape (R, C).

    Args:
        action: The actions, shape (N, G, A).
        low: Lower bounds of the actions, shape (A,).
        high: Upper bounds of the actions, shape (A,).
        least: Lower limit of each controller [N, N m], shape (A,).
        most: Upper limit of each controller [N, N m], shape (A,).
        axes: Axis of each controller, all different, shape (A,).
        clipped: Output: the clipped actions.
        control: Output: the control.

    Returns:
        Whether all actions are finite.
    """
    finite, size = True, action.shape[1]
    for row in range(clipped.shape[0]):
        for k in range(control.shape[1]):
            control[row, k] = 0.0
        for a in range(len(axes)):
            value = action[row // size, row % size, a]
            finite &= math.isfinite(value)
            value = _within(value, low[a], high[a])
            clipped[row, a] = value
            control[row, axes[a]] = 0.0 + _within(value, least[a], most[a])  # adding 0 avoids -0
    return finite
