"""The kernel that turns actions into the control when every controller passes on a value of its own axis."""

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
    """Write the actions within their bounds, shape (R, A), and the control [N, N m], shape (R, C).

    Args:
        action: The actions, shape (N, G, A).
        low: Their smallest values, shape (A,).
        high: Their largest, shape (A,).
        least: Smallest value of each controller [N, N m], shape (A,).
        most: Largest value of each [N, N m], shape (A,).
        axes: Axis of each controller, all different, shape (A,).
        clipped: Takes the actions.
        control: Takes the control.

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
            control[row, axes[a]] = 0.0 + _within(value, least[a], most[a])  # never -0, as in a sum from 0
    return finite
