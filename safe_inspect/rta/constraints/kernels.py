"""Compiled rows of the constraints, one state at a time, so that a row's bits do not depend on the batch.

Every function writes phi, h and the gradient of h of each row; the classes that call them document the formulas.
"""

from __future__ import annotations

import math

from safe_inspect.compiling import njit
from safe_inspect.types import FloatArray

#: Below this distance [m] a direction is not taken from the position: it would be rounding noise.
LENGTH_FLOOR = 1e-6
#: The slope of the signed square root is that at this distance [m] where the distance is smaller; it is infinite at 0.
ROOT_FLOOR = 1e-6


@njit
def _root(distance: float, acceleration: float) -> tuple[float, float]:
    """Return sign(d) sqrt(2 a |d|), the speed that can be braked within d, and its slope."""
    size = abs(distance)
    value = math.sqrt(2.0 * acceleration * size)
    slope = acceleration / math.sqrt(2.0 * acceleration * max(size, ROOT_FLOOR))
    return (value if distance >= 0.0 else -value), slope


@njit
def range_limit(
    position: FloatArray, velocity: FloatArray, limit: float, acceleration: float, side: float,
    phi: FloatArray, h: FloatArray, gradient: FloatArray,
) -> None:  # fmt: skip
    """Bound the range: from below with side = 1, from above with side = -1."""
    for i in range(position.shape[0]):
        x, y, z = position[i]
        vx, vy, vz = velocity[i]
        distance = math.sqrt(x * x + y * y + z * z)
        turning = side / distance if distance >= LENGTH_FLOOR else 0.0
        ex, ey, ez = 1.0, 0.0, 0.0
        if not distance < LENGTH_FLOOR:
            ex, ey, ez = x / distance, y / distance, z / distance
        speed = ex * vx + ey * vy + ez * vz
        gap = side * (distance - limit)
        root, slope = _root(gap, acceleration)
        phi[i] = gap
        h[i] = root + side * speed
        gradient[i, 0] = side * slope * ex + turning * (vx - speed * ex)
        gradient[i, 1] = side * slope * ey + turning * (vy - speed * ey)
        gradient[i, 2] = side * slope * ez + turning * (vz - speed * ez)
        gradient[i, 3] = side * ex
        gradient[i, 4] = side * ey
        gradient[i, 5] = side * ez


@njit
def relative_speed(
    position: FloatArray, velocity: FloatArray, v0: float, v0_distance: float, v1: float, smoothing: float,
    phi: FloatArray, h: FloatArray, gradient: FloatArray,
) -> None:  # fmt: skip
    """Bound the speed by a line over the range."""
    for i in range(position.shape[0]):
        x, y, z = position[i]
        vx, vy, vz = velocity[i]
        r2 = x * x + y * y + z * z
        s2 = vx * vx + vy * vy + vz * vz
        distance, speed = math.sqrt(r2 + smoothing), math.sqrt(s2 + smoothing)
        phi[i] = v0 + v1 * (math.sqrt(r2) - v0_distance) - math.sqrt(s2)
        h[i] = v0 + v1 * (distance - v0_distance) - speed
        gradient[i, 0] = v1 * x / distance
        gradient[i, 1] = v1 * y / distance
        gradient[i, 2] = v1 * z / distance
        gradient[i, 3] = -vx / speed
        gradient[i, 4] = -vy / speed
        gradient[i, 5] = -vz / speed


@njit
def axis_speed(
    velocity: FloatArray, axis: int, limit: float, phi: FloatArray, h: FloatArray, gradient: FloatArray
) -> None:  # fmt: skip
    """Bound the speed along one axis; the other entries of the gradient stay as they are."""
    for i in range(velocity.shape[0]):
        speed = velocity[i, axis]
        phi[i] = limit - abs(speed)
        h[i] = limit * limit - speed * speed
        gradient[i, 3 + axis] = -2.0 * speed


@njit
def sun_cone(
    position: FloatArray, velocity: FloatArray, sun_angle: FloatArray,
    half_angle: float, acceleration: float, n: float,
    phi: FloatArray, h: FloatArray, gradient: FloatArray, rate: FloatArray,
) -> None:  # fmt: skip
    """Keep the position out of the cone about the direction away from the sun.

    All is written in the right-handed axes (c, k, z): c points away from the sun, k lies in the orbital plane.
    There the frame's angular velocity is (0, 0, -n), and w x (a, b, .) = (n b, -n a, 0).
    """
    cos_b, sin_b = math.cos(half_angle), math.sin(half_angle)
    for i in range(position.shape[0]):
        cos_s, sin_s = math.cos(sun_angle[i]), math.sin(sun_angle[i])
        x, y, z = position[i]
        vx, vy, vz = velocity[i]
        pc, pk = sin_s * y - cos_s * x, -sin_s * x - cos_s * y
        vc, vk = sin_s * vy - cos_s * vx, -sin_s * vx - cos_s * vy
        off_axis = math.sqrt(pk * pk + z * z)
        ek, ez, turning = 0.0, 1.0, 0.0
        if not off_axis < LENGTH_FLOOR:
            ek, ez, turning = pk / off_axis, z / off_axis, cos_b / off_axis
        # the outward normal of the cone beside the position, and the distance along it
        nc, nk, nz = -sin_b, cos_b * ek, cos_b * ez
        gap = cos_b * off_axis - sin_b * pc
        # the velocity relative to the turning cone
        uc, uk = vc - n * pk, vk + n * pc
        around = turning * (ek * vz - ez * uk)
        root, slope = _root(gap, acceleration)
        phi[i] = math.atan2(off_axis, pc) - half_angle
        h[i] = root + nc * uc + nk * uk + nz * vz
        gc = slope * nc + n * nk
        gk = slope * nk - around * ez - n * nc
        gradient[i, 0] = -cos_s * gc - sin_s * gk
        gradient[i, 1] = sin_s * gc - cos_s * gk
        gradient[i, 2] = slope * nz + around * ek
        gradient[i, 3] = -cos_s * nc - sin_s * nk
        gradient[i, 4] = sin_s * nc - cos_s * nk
        gradient[i, 5] = nz
        # turning the position, the velocity and the sun together changes nothing
        rate[i] = -n * (gc * pk - gk * pc + nc * vk - nk * vc)
