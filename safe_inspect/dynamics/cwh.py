"""Relative motion about a circular orbit: the Clohessy-Wiltshire-Hill (CWH) equations.

Every propagation in the package uses `cwh_row`, the map of one step of one spacecraft.
"""

from __future__ import annotations

import math

import numpy as np

from safe_inspect.compiling import njit
from safe_inspect.types import FloatArray

# Below this angle [rad] the series of (x - sin x)/x^3 is more accurate than the difference.
_SERIES_ANGLE = 1.0
_SERIES_TERMS = 10


def transition(mean_motion: float, mass: float, step: float) -> tuple[FloatArray, FloatArray]:
    """Return Phi and Gamma of the exact map ``state(t + step) = Phi state(t) + Gamma control``.

    The motion is ``d(state)/dt = A state + B control``. In components, with n the chief's mean motion and u the thrust:
    ``x'' = 3 n^2 x + 2 n y' + u_x/m``, ``y'' = -2 n x' + u_y/m``, ``z'' = -n^2 z + u_z/m``.

    The control is held over the step (zero-order hold), so that Phi = exp(A step) and Gamma is the integral of exp(A
    tau) B over the step. Both are evaluated in closed form, written so that a short step does not subtract nearly equal
    numbers: each entry is then accurate to a few units in its last place, whereas a numerical matrix exponential is
    accurate only relative to the largest entry.

    Args:
        mean_motion: Mean motion of the chief's orbit [rad/s]; 0 means free space.
        mass: Mass of the deputy [kg].
        step: Length of the step [s]; a negative step goes back in time.

    Returns:
        Phi, shape (6, 6), and Gamma, shape (6, 3), for SI states in Hill's frame and forces in newtons.

    Source:
        Clohessy and Wiltshire, "Terminal guidance system for satellite rendezvous", 1960; Gamma by integration.
    """
    n, t = mean_motion, step
    angle = n * t
    sine, cosine = math.sin(angle), math.cos(angle)
    f1, f2, f3 = _ratios(angle)
    lift = f2 * angle * angle  # 1 - cos
    lag = f3 * angle * angle * angle  # angle - sin

    phi = np.zeros((6, 6))
    phi[0, 0] = 1.0 + 3.0 * lift
    phi[0, 3] = t * f1
    phi[0, 4] = 2.0 * t * angle * f2
    phi[1, 0] = -6.0 * lag
    phi[1, 1] = 1.0
    phi[1, 3] = -phi[0, 4]
    phi[1, 4] = t * (4.0 * f1 - 3.0)
    phi[2, 2] = cosine
    phi[2, 5] = t * f1
    phi[3, 0] = 3.0 * n * sine
    phi[3, 3] = cosine
    phi[3, 4] = 2.0 * sine
    phi[4, 0] = -6.0 * n * lift
    phi[4, 3] = -2.0 * sine
    phi[4, 4] = 1.0 - 4.0 * lift
    phi[5, 2] = -n * sine
    phi[5, 5] = cosine

    gamma = np.zeros((6, 3))
    gamma[0, 0] = gamma[2, 2] = t * t * f2
    gamma[0, 1] = 2.0 * t * t * angle * f3
    gamma[1, 0] = -gamma[0, 1]
    gamma[1, 1] = t * t * (4.0 * f2 - 1.5)
    gamma[3, 0] = gamma[5, 2] = t * f1
    gamma[3, 1] = 2.0 * t * angle * f2
    gamma[4, 0] = -gamma[3, 1]
    gamma[4, 1] = phi[1, 4]
    return phi, gamma / mass


def _ratios(angle: float) -> tuple[float, float, float]:
    """Return sin(x)/x, (1 - cos x)/x^2 and (x - sin x)/x^3; at x = 0 their limits 1, 1/2 and 1/6."""
    if angle == 0.0:
        return 1.0, 0.5, 1.0 / 6.0
    f1 = math.sin(angle) / angle
    half = 0.5 * angle
    f2 = 0.5 * (math.sin(half) / half) ** 2
    if abs(angle) >= _SERIES_ANGLE:
        return f1, f2, (angle - math.sin(angle)) / angle**3
    f3 = 0.0
    for k in reversed(range(_SERIES_TERMS)):  # small terms first, for accuracy
        f3 += (-1.0) ** k * angle ** (2 * k) / math.factorial(2 * k + 3)
    return f1, f2, f3


#: Position [m] and velocity [m/s], Hill frame.
RowState = tuple[float, float, float, float, float, float]


@njit(error_model="numpy")
def row_state(position: FloatArray, velocity: FloatArray) -> RowState:
    """Return a position and a velocity, shape (3,) each, as one tuple."""
    return position[0], position[1], position[2], velocity[0], velocity[1], velocity[2]


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
        u = control[row]
        after = cwh_row(phi, gamma, row_state(position[row], velocity[row]), u[0], u[1], u[2])
        for j in range(3):
            position_out[row, j] = after[j]
            velocity_out[row, j] = after[3 + j]
