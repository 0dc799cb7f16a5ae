"""The linear map of one step for rows of spacecraft, compiled."""

from __future__ import annotations

from safe_inspect.compiling import njit
from safe_inspect.dynamics.cwh_row import cwh_row
from safe_inspect.types import FloatArray


@njit
def propagate(
    position: FloatArray,
    velocity: FloatArray,
    control: FloatArray,
    phi: FloatArray,
    gamma: FloatArray,
    position_out: FloatArray,
    velocity_out: FloatArray,
) -> None:
    """Write ``phi [position, velocity] + gamma control`` for each row.

    The sums are evaluated in one fixed order, row by row, so the result of a row is bit-identical in a batch of any
    size; this is not the case for a BLAS product. The outputs may be the inputs themselves (the step is then done in
    place).

    Args:
        position: Positions [m], Hill frame, shape (R, 3).
        velocity: Velocities [m/s], Hill frame, shape (R, 3).
        control: Thrusts held over the step [N], shape (R, 3).
        phi: Transition matrix, shape (6, 6); see `safe_inspect.dynamics.cwh.transition`.
        gamma: Input matrix, shape (6, 3).
        position_out: Output: the positions after the step [m], shape (R, 3).
        velocity_out: Output: the velocities after the step [m/s], shape (R, 3).
    """
    for row in range(position.shape[0]):
        p, v, u = position[row], velocity[row], control[row]
        after = cwh_row(phi, gamma, (p[0], p[1], p[2], v[0], v[1], v[2]), u[0], u[1], u[2])
        for j in range(3):
            position_out[row, j] = after[j]
            velocity_out[row, j] = after[3 + j]
