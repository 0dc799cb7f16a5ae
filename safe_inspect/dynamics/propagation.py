"""The linear map of one step over rows of spacecraft, compiled."""

from __future__ import annotations

import numpy as np

from safe_inspect.compiled import njit
from safe_inspect.types import FloatArray


@njit(cache=True)  # type: ignore[untyped-decorator]
def propagate(
    position: FloatArray,
    velocity: FloatArray,
    control: FloatArray,
    phi: FloatArray,
    gamma: FloatArray,
    position_out: FloatArray,
    velocity_out: FloatArray,
) -> None:
    """Write ``phi [position, velocity] + gamma control`` of each row.

    The sums run in one fixed order, row by row, so a row's result is the same to the bit in a batch of any size;
    a BLAS product is not. The outputs may be the inputs themselves (the step is then done in place).

    Args:
        position: Positions [m], Hill frame, shape (R, 3).
        velocity: Velocities [m/s], Hill frame, shape (R, 3).
        control: Thrusts held over the step [N], shape (R, 3).
        phi: Transition matrix, shape (6, 6); see `safe_inspect.dynamics.cwh.transition`.
        gamma: Input matrix, shape (6, 3).
        position_out: Receives the positions after the step [m], shape (R, 3).
        velocity_out: Receives the velocities after the step [m/s], shape (R, 3).
    """
    after = np.empty(6)
    for row in range(position.shape[0]):
        for i in range(6):
            total = 0.0
            for j in range(3):
                total += phi[i, j] * position[row, j]
            for j in range(3):
                total += phi[i, 3 + j] * velocity[row, j]
            for j in range(3):
                total += gamma[i, j] * control[row, j]
            after[i] = total
        for j in range(3):
            position_out[row, j] = after[j]
            velocity_out[row, j] = after[3 + j]
