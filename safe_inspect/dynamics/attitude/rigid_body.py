"""Rotation of rigid bodies under torque, compiled, as a row kernel.

    q' = q [w, 0] / 2,        J w' = torque - w x J w

where q = q_WB, and w, torque and the diagonal J are in the principal axes B. Source: Markley and Crassidis,
"Fundamentals of Spacecraft Attitude Determination and Control", Springer 2014, chapter 3.
"""

from __future__ import annotations

import math

from safe_inspect.compiling import njit
from safe_inspect.types import FloatArray

#: Attitude q_WB [x, y, z, w] and angular velocity in B [rad/s].
RotationState = tuple[float, float, float, float, float, float, float]
#: Three components along the principal axes.
Vector = tuple[float, float, float]


@njit(error_model="numpy")
def rotation_rates(inertia: Vector, x: RotationState, torque: Vector) -> RotationState:
    """Return the time derivatives of attitude [1/s] and angular velocity [rad/s^2].

    Args:
        inertia: Principal moments of inertia [kg m^2].
        x: Attitude and angular velocity.
        torque: Torque in B [N m].
    """
    qx, qy, qz, qw, wx, wy, wz = x
    return (
        0.5 * (qw * wx + qy * wz - qz * wy),
        0.5 * (qw * wy - qx * wz + qz * wx),
        0.5 * (qw * wz + qx * wy - qy * wx),
        -0.5 * (qx * wx + qy * wy + qz * wz),
        (torque[0] - (inertia[2] - inertia[1]) * wy * wz) / inertia[0],
        (torque[1] - (inertia[0] - inertia[2]) * wz * wx) / inertia[1],
        (torque[2] - (inertia[1] - inertia[0]) * wx * wy) / inertia[2],
    )


@njit(error_model="numpy")
def moved_rotation(x: RotationState, rates: RotationState, dt: float) -> RotationState:
    """Return ``x + dt rates``."""
    return (
        x[0] + dt * rates[0],
        x[1] + dt * rates[1],
        x[2] + dt * rates[2],
        x[3] + dt * rates[3],
        x[4] + dt * rates[4],
        x[5] + dt * rates[5],
        x[6] + dt * rates[6],
    )


@njit(error_model="numpy")
def moved_vector(x: Vector, rates: Vector, dt: float) -> Vector:
    """Return ``x + dt rates``."""
    return x[0] + dt * rates[0], x[1] + dt * rates[1], x[2] + dt * rates[2]


@njit(error_model="numpy")
def rotation_row(inertia: Vector, x: RotationState, torque: Vector, dt: float) -> RotationState:
    """Return attitude and angular velocity after one step of the classical Runge-Kutta method; q is normalised.

    Args:
        inertia: Principal moments of inertia [kg m^2].
        x: Attitude and angular velocity before the step.
        torque: Torque in B, held over the step [N m].
        dt: Length of the step [s].
    """
    k1 = rotation_rates(inertia, x, torque)
    k2 = rotation_rates(inertia, moved_rotation(x, k1, 0.5 * dt), torque)
    k3 = rotation_rates(inertia, moved_rotation(x, k2, 0.5 * dt), torque)
    k4 = rotation_rates(inertia, moved_rotation(x, k3, dt), torque)
    y = moved_rotation(
        moved_rotation(moved_rotation(moved_rotation(x, k1, dt / 6.0), k2, dt / 3.0), k3, dt / 3.0), k4, dt / 6.0
    )
    scale = 1.0 / math.sqrt(y[0] * y[0] + y[1] * y[1] + y[2] * y[2] + y[3] * y[3])
    return scale * y[0], scale * y[1], scale * y[2], scale * y[3], y[4], y[5], y[6]


@njit(error_model="numpy")
def rotate_freely(inertia: Vector, q: FloatArray, w: FloatArray, dt: float, steps: int) -> None:
    """Advance an attitude, shape (4,), and an angular velocity in body axes, shape (3,), without torque.

    Args:
        inertia: Principal moments of inertia [kg m^2], or their ratios.
        q: Attitude, overwritten.
        w: Angular velocity [rad/s], overwritten.
        dt: Length of a step of the integration [s].
        steps: Number of these steps.
    """
    x = (q[0], q[1], q[2], q[3], w[0], w[1], w[2])
    for _ in range(steps):
        x = rotation_row(inertia, x, (0.0, 0.0, 0.0), dt)
    for k in range(4):
        q[k] = x[k]
    for k in range(3):
        w[k] = x[4 + k]
