"""One step of N environments, compiled: dynamics, fuel, clock and sun."""

from __future__ import annotations

import math

from safe_inspect.compiled import njit
from safe_inspect.dynamics.cwh_row import cwh_row
from safe_inspect.types import FloatArray, IntArray


@njit(cache=True)  # type: ignore[untyped-decorator]
def point_sun(angle: FloatArray, direction: FloatArray) -> None:
    """Write the unit vector [cos, -sin, 0] of each sun angle [rad], shape (N, 3)."""
    for n in range(angle.shape[0]):
        direction[n, 0] = math.cos(angle[n])
        direction[n, 1] = -math.sin(angle[n])
        direction[n, 2] = 0.0


@njit(cache=True)  # type: ignore[untyped-decorator]
def advance(
    control: FloatArray,
    masses: FloatArray,
    phi: FloatArray,
    gamma: FloatArray,
    step_size: float,
    sun_rate: float,
    position: FloatArray,
    velocity: FloatArray,
    delta_v: FloatArray,
    time: FloatArray,
    step: IntArray,
    sun_angle: FloatArray,
    sun_direction: FloatArray,
) -> None:
    """Hold the thrusts over one step; the state's arrays are written in place. Bodies without thrust coast.

    Args:
        control: Thrust of each deputy [N], Hill frame, shape (N, D, 3).
        masses: Mass of each deputy [kg], shape (D,).
        phi: Transition matrix of the step, shape (6, 6).
        gamma: Input matrix of a body of 1 kg, shape (6, 3).
        step_size: Length of the step [s].
        sun_rate: Rate of the sun's angle [rad/s].
        position: Positions of the bodies, the deputies first [m], shape (N, B, 3).
        velocity: Velocities [m/s], shape (N, B, 3).
        delta_v: Velocity change spent, sum of abs(u_i) dt / m [m/s], shape (N, D).
        time: Time [s], shape (N,).
        step: Number of steps, shape (N,).
        sun_angle: Angle of the sun [rad], shape (N,).
        sun_direction: Unit vector to the sun, shape (N, 3).
    """
    deputies = masses.shape[0]
    for n in range(position.shape[0]):
        for b in range(position.shape[1]):
            x, y, z = 0.0, 0.0, 0.0
            if b < deputies:
                x, y, z = control[n, b, 0] / masses[b], control[n, b, 1] / masses[b], control[n, b, 2] / masses[b]
                delta_v[n, b] += (abs(x) + abs(y) + abs(z)) * step_size
            p, v = position[n, b], velocity[n, b]
            move = cwh_row(phi, gamma, (p[0], p[1], p[2], v[0], v[1], v[2]), x, y, z)
            for j in range(3):
                position[n, b, j] = move[j]
                velocity[n, b, j] = move[3 + j]
        time[n] += step_size
        step[n] += 1
        sun_angle[n] += sun_rate * step_size
    point_sun(sun_angle, sun_direction)
