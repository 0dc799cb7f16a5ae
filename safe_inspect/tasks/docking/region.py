"""Detection of a deputy that reaches the docking region within a step, and its speed then, for one row."""

from __future__ import annotations

import math

from safe_inspect.compiling import njit
from safe_inspect.geometry.distance import distance
from safe_inspect.tasks.docking.speed_limit import speed_excess
from safe_inspect.types import FloatArray

#: A deputy within this distance of the region counts as inside [m].
TOLERANCE = 1e-4
#: Results of `docking_outcome`.
OUTSIDE, DOCKED, TOO_FAST = 0, 1, 2


@njit
def entry_speed(
    radius: float,
    dt: float,
    position_before: FloatArray,
    velocity_before: FloatArray,
    position: FloatArray,
    velocity: FloatArray,
    reference: FloatArray,
    reference_velocity: FloatArray,
) -> float:
    """Return the relative speed at which a deputy first enters a ball during a step [m/s], or -1 if it does not.

    The path relative to the ball, whose velocity is constant, is the cubic with the positions and velocities of the two
    states; over 1 s of Clohessy-Wiltshire dynamics it differs from the true path by less than 1e-8 m. It is followed in
    steps that cannot pass the ball: the gap divided by the largest speed of the cubic.

    Args:
        radius: Radius of the ball [m].
        dt: Length of the step [s]; 0: only the end of the step is checked.
        position_before: Position at the start of the step [m], shape (3,).
        velocity_before: Velocity at the start of the step [m/s], shape (3,).
        position: Position at the end of the step [m], shape (3,).
        velocity: Velocity at the end of the step [m/s], shape (3,).
        reference: Centre of the ball at the end of the step [m], shape (3,).
        reference_velocity: Velocity of the ball [m/s], shape (3,).
    """
    end, end_speed = distance(position, reference), distance(velocity, reference_velocity)
    if dt > 0.0:
        # The control points of the cubic's derivative bound the speed: the two velocities, and the one between them.
        middle = 0.0
        for k in range(3):
            moved = position[k] - position_before[k] - reference_velocity[k] * dt
            u = 3.0 * moved / dt - velocity_before[k] - velocity[k] + 2.0 * reference_velocity[k]
            middle += u * u
        fastest = max(distance(velocity_before, reference_velocity), end_speed, math.sqrt(middle))
        elapsed = 0.0
        while True:
            b = elapsed / dt
            a = 1.0 - b
            square, speed = 0.0, 0.0
            for k in range(3):
                u0, u1 = velocity_before[k] - reference_velocity[k], velocity[k] - reference_velocity[k]
                p0 = position_before[k] - (reference[k] - reference_velocity[k] * dt)
                p3 = position[k] - reference[k]
                p1, p2 = p0 + u0 * dt / 3.0, p3 - u1 * dt / 3.0
                p = a * a * (a * p0 + 3.0 * b * p1) + b * b * (3.0 * a * p2 + b * p3)
                u = a * a * u0 + 2.0 * a * b * (3.0 * (p2 - p1) / dt) + b * b * u1
                square += p * p
                speed += u * u
            gap = math.sqrt(square) - radius
            if gap <= TOLERANCE:
                return math.sqrt(speed)
            if not gap <= fastest * (dt - elapsed):  # Also true for values that are not finite.
                break
            elapsed += gap / fastest
    return end_speed if end <= radius else -1.0


@njit
def docking_outcome(rule: FloatArray, *motion: FloatArray) -> int:
    """Return `DOCKED` or `TOO_FAST` if a deputy reaches the docking region in a step, otherwise `OUTSIDE`.

    Args:
        rule: See `DockingRegion.rule`, shape (6,).
        *motion: The positions and velocities that `entry_speed` takes.
    """
    radius = rule[4]
    speed = entry_speed(radius, rule[5], *motion)
    if speed < 0.0:
        return OUTSIDE
    return TOO_FAST if speed_excess(rule[:4], radius, speed) > 0.0 else DOCKED


@njit
def is_too_fast(rule: FloatArray, *motion: FloatArray) -> bool:
    """Return whether a deputy reaches the docking region above the speed limit; see `docking_outcome`."""
    return bool(docking_outcome(rule, *motion) == TOO_FAST)
