"""Angular velocities from attitudes."""

from __future__ import annotations

import numpy as np

from safe_inspect.dynamics.quaternion import conjugate, log, multiply
from safe_inspect.types import FloatArray


def angular_velocities(
    times: FloatArray, orientation: FloatArray, span: float = 1.0, window: float = 5.0
) -> tuple[FloatArray, FloatArray]:
    """Return mid times [s], shape (n,), and smoothed angular velocities in the body's frame [rad/s], shape (n, 3).

    ``w = Log(R_k^T R_k+m) / (t_k+m - t_k)`` holds at the mid time, where m is the smallest number of frames that covers
    `span`. The rates are then smoothed with a Hann window about each mid time.

    Args:
        times: Times of the frames [s], ascending, shape (F,).
        orientation: Attitudes from the body's frame to an inertial one, shape (F, 4).
        span: Minimum time between two attitudes that are compared [s].
        window: Length of the window [s]; 0 for no smoothing.
    """
    later = np.searchsorted(times, times + span - 1e-9)
    first = np.flatnonzero(later < len(times))
    if not len(first):
        return np.empty(0), np.empty((0, 3))
    second = later[first]
    elapsed = times[second] - times[first]
    rates = log(multiply(conjugate(orientation[first]), orientation[second])) / elapsed[:, None]
    middle = 0.5 * (times[first] + times[second])
    if window <= 0.0:
        return middle, rates
    offset = np.abs(middle[:, None] - middle) / (0.5 * window)
    weight = np.where(offset < 1.0, 0.5 + 0.5 * np.cos(np.pi * offset), 0.0)
    # Fit a line to the rates in the window and evaluate it at the mid time: the mean is biased at the ends.
    centred = middle - middle[:, None]
    total, first_moment = weight.sum(axis=1), (weight * centred).sum(axis=1)
    second_moment = (weight * centred**2).sum(axis=1)
    determinant = total * second_moment - first_moment**2
    safe = np.where(determinant > 1e-9 * total**2, determinant, 1.0)
    slope = np.where(determinant > 1e-9 * total**2, 1.0, 0.0)
    mean = (weight @ rates) / total[:, None]
    line = (second_moment[:, None] * (weight @ rates) - first_moment[:, None] * ((weight * centred) @ rates)) / safe[
        :, None
    ]
    return middle, np.where(slope[:, None] > 0.0, line, mean)
