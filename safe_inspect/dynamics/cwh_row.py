"""The map of one step of one spacecraft in CWH dynamics, compiled; every propagation in the package uses this row."""

from __future__ import annotations

from safe_inspect.compiling import njit
from safe_inspect.types import FloatArray

#: Position [m] and velocity [m/s], Hill frame.
RowState = tuple[float, float, float, float, float, float]


@njit(error_model="numpy")
def cwh_row(phi: FloatArray, gamma: FloatArray, x: RowState, ax: float, ay: float, az: float) -> RowState:
    """Return ``phi x + gamma [ax, ay, az]``, without the elements of the two matrices that are always zero.

    The sums are evaluated in one fixed order, so that a row gives bit-identical results wherever it is computed.

    Args:
        phi: Transition matrix, shape (6, 6); see `safe_inspect.dynamics.cwh.transition`.
        gamma: Input matrix, shape (6, 3); for accelerations, that of a body of 1 kg.
        x: The state before the step.
        ax: Acceleration along x held over the step [m/s^2], or thrust [N] with the body's own input matrix.
        ay: The same along y.
        az: The same along z.
    """
    return (
        0.0 + phi[0, 0] * x[0] + phi[0, 3] * x[3] + phi[0, 4] * x[4] + gamma[0, 0] * ax + gamma[0, 1] * ay,
        0.0 + phi[1, 0] * x[0] + x[1] + phi[1, 3] * x[3] + phi[1, 4] * x[4] + gamma[1, 0] * ax + gamma[1, 1] * ay,
        0.0 + phi[2, 2] * x[2] + phi[2, 5] * x[5] + gamma[2, 2] * az,
        0.0 + phi[3, 0] * x[0] + phi[3, 3] * x[3] + phi[3, 4] * x[4] + gamma[3, 0] * ax + gamma[3, 1] * ay,
        0.0 + phi[4, 0] * x[0] + phi[4, 3] * x[3] + phi[4, 4] * x[4] + gamma[4, 0] * ax + gamma[4, 1] * ay,
        0.0 + phi[5, 2] * x[2] + phi[5, 5] * x[5] + gamma[5, 2] * az,
    )
