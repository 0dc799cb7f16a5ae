"""Motion of a point mass near a chief on an elliptic orbit about the oblate Earth: equations and integration.

The chief's orbit is its distance r from the Earth's centre, the radial velocity r', the angular momentum h per mass,
the inclination i, the argument of latitude u and the right ascension of the ascending node O. Hill's frame turns with
``w = (r a_z / h, 0, h / r^2)``, where a is the chief's acceleration by the oblateness. In this frame, a deputy obeys

    p'' = g(R + p) - g(R) - 2 w x p' - w x (w x p) - w' x p + F / m,    R = (r, 0, 0)

With drag, g of each body includes its deceleration ``-1/2 rho k |V| V`` by an atmosphere at rest, where V is the
velocity in inertial space, k = C_D A / m and ``rho = rho_0 exp(-(|R| - r_0) / H)``.

Sources: Gauss's variational equations and drag, in Vallado, "Fundamentals of Astrodynamics and Applications", 4th
edition, 2013, sections 9.3.2 and 8.6.2; Xu and Wang, "Nonlinear dynamic equations of satellite relative motion around
an oblate Earth", Journal of Guidance, Control, and Dynamics 31(5), 2008, for the rotation of the frame.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from safe_inspect.compiling import njit
from safe_inspect.dynamics.attitude.rigid_body import Vector, moved_vector
from safe_inspect.dynamics.orbit.earth import EARTH_GRAVITY
from safe_inspect.types import FloatArray

#: The chief's orbit ``(r, r', h), (i, u, O)``; position and velocity of a deputy in Hill's frame.
OrbitState = tuple[Vector, Vector, Vector, Vector]


class OrbitSteps(NamedTuple):
    """Constants of the integration.

    Attributes:
        oblateness: ``3/2 J2 mu R^2`` of the Earth [m^5/s^2]; 0 for a spherical Earth.
        step_size: Length of a step [s].
        substeps: Integration steps per step.
        density: Density of the atmosphere at the reference distance [kg/m^3]; 0 for no drag.
        reference: Reference distance from the Earth's centre [m].
        scale_height: Distance over which the density falls by a factor e [m].
        chief: Drag coefficient times area over mass of the chief [m^2/kg].
        deputy: The same of a deputy [m^2/kg].
    """

    oblateness: float
    step_size: float
    substeps: int
    density: float
    reference: float
    scale_height: float
    chief: float
    deputy: float


@njit
def _turned(a: float, x: float, y: float) -> tuple[float, float]:
    """Return a vector in axes that are turned by an angle [rad]."""
    cos, sin = math.cos(a), math.sin(a)
    return cos * x + sin * y, cos * y - sin * x


@njit
def in_hill_frame(orbit: FloatArray, vector: Vector) -> Vector:
    """Return a vector of inertial axes in Hill's frame.

    Args:
        orbit: The chief's orbit, shape (6,).
        vector: The vector; z is along the Earth's axis, and right ascensions are counted from x.
    """
    x, y, z = vector
    x, y = _turned(orbit[5], x, y)
    y, z = _turned(orbit[3], y, z)
    x, y = _turned(orbit[4], x, y)
    return x, y, z


@njit
def in_inertial_axes(orbits: FloatArray, vectors: FloatArray, inertial: FloatArray) -> None:
    """Write vectors of Hill's frame in inertial axes; the inverse of `in_hill_frame` for N rows."""
    for n in range(orbits.shape[0]):
        x, y, z = vectors[n, 0], vectors[n, 1], vectors[n, 2]
        x, y = _turned(-orbits[n, 4], x, y)
        y, z = _turned(-orbits[n, 3], y, z)
        x, y = _turned(-orbits[n, 5], x, y)
        inertial[n, 0], inertial[n, 1], inertial[n, 2] = x, y, z


@njit(error_model="numpy")
def gravity(oblateness: float, position: Vector, pole: Vector) -> Vector:
    """Return the acceleration by the Earth's gravity [m/s^2].

    Args:
        oblateness: See `OrbitSteps`.
        position: Position relative to the Earth's centre [m].
        pole: Unit vector to the north pole, in the same axes.
    """
    x, y, z = position
    square = x * x + y * y + z * z
    cube = square * math.sqrt(square)
    north = x * pole[0] + y * pole[1] + z * pole[2]
    bulge = oblateness / (cube * square)
    along = -EARTH_GRAVITY / cube - bulge * (1.0 - 5.0 * north * north / square)
    across = -2.0 * bulge * north
    return along * x + across * pole[0], along * y + across * pole[1], along * z + across * pole[2]


@njit(error_model="numpy")
def _drag(steps: OrbitSteps, coefficient: float, distance: float, velocity: Vector, acceleration: Vector) -> Vector:
    """Return an acceleration with the one by drag, at a distance from the Earth's centre [m]."""
    x, y, z = velocity
    density = steps.density * math.exp((steps.reference - distance) / steps.scale_height)
    rate = 0.5 * density * coefficient * math.sqrt(x * x + y * y + z * z)
    return acceleration[0] - rate * x, acceleration[1] - rate * y, acceleration[2] - rate * z


@njit(error_model="numpy")
def _rates(steps: OrbitSteps, x: OrbitState, thrust: Vector) -> OrbitState:
    """Return the time derivatives of the state under a force per kilogram [m/s^2]."""
    oblateness, ((r, radial, h), (inclination, latitude, _), p, v) = steps.oblateness, x
    sin_i, cos_i, sin_u, cos_u = (
        math.sin(inclination), math.cos(inclination), math.sin(latitude), math.cos(latitude)
    )  # fmt: skip
    pole = (sin_i * sin_u, sin_i * cos_u, cos_i)
    own = gravity(oblateness, (r, 0.0, 0.0), pole)
    if steps.density > 0.0:
        own = _drag(steps, steps.chief, r, (radial, h / r, 0.0), own)
    tilt = -2.0 * oblateness * cos_i * sin_u / (r * r * r * h)  # r a_z / (h sin i), also defined for i = 0
    momentum = r * own[1]
    turn_i, turn_node = tilt * sin_i * cos_u, tilt * sin_u
    turn_u = h / (r * r) - turn_node * cos_i
    wx, wz = tilt * sin_i, h / (r * r)
    falling = momentum / h + 3.0 * radial / r
    cos_2i = cos_i * cos_i - sin_i * sin_i
    ax = -2.0 * oblateness * (cos_2i * turn_i * sin_u + sin_i * cos_i * cos_u * turn_u) / (r * r * r * h) - wx * falling
    az = momentum / (r * r) - 2.0 * wz * radial / r
    there = gravity(oblateness, (r + p[0], p[1], p[2]), pole)
    if steps.density > 0.0:
        moving = (v[0] - wz * p[1] + radial, v[1] + wz * p[0] - wx * p[2] + h / r, v[2] + wx * p[1])
        distance = math.sqrt((r + p[0]) ** 2 + p[1] * p[1] + p[2] * p[2])
        there = _drag(steps, steps.deputy, distance, moving, there)
    spin = wx * p[0] + wz * p[2]
    rate = wx * wx + wz * wz
    return (
        (radial, own[0] + h * h / (r * r * r), momentum),
        (turn_i, turn_u, turn_node),
        v,
        (
            there[0] - own[0] + 2.0 * wz * v[1] - wx * spin + rate * p[0] + az * p[1] + thrust[0],
            there[1] - own[1] - 2.0 * (wz * v[0] - wx * v[2]) + rate * p[1] - az * p[0] + ax * p[2] + thrust[1],
            there[2] - own[2] - 2.0 * wx * v[1] - wz * spin + rate * p[2] - ax * p[1] + thrust[2],
        ),
    )


@njit(error_model="numpy")
def _moved(x: OrbitState, rates: OrbitState, dt: float) -> OrbitState:
    return (
        moved_vector(x[0], rates[0], dt),
        moved_vector(x[1], rates[1], dt),
        moved_vector(x[2], rates[2], dt),
        moved_vector(x[3], rates[3], dt),
    )


@njit(error_model="numpy")
def _after(steps: OrbitSteps, orbit: FloatArray, position: Vector, velocity: Vector, thrust: Vector) -> OrbitState:
    """Return the state after a step, by the classical Runge-Kutta method."""
    x = ((orbit[0], orbit[1], orbit[2]), (orbit[3], orbit[4], orbit[5]), position, velocity)
    dt = steps.step_size / steps.substeps
    for _ in range(steps.substeps):
        k1 = _rates(steps, x, thrust)
        k2 = _rates(steps, _moved(x, k1, 0.5 * dt), thrust)
        k3 = _rates(steps, _moved(x, k2, 0.5 * dt), thrust)
        k4 = _rates(steps, _moved(x, k3, dt), thrust)
        x = _moved(_moved(_moved(_moved(x, k1, dt / 6.0), k2, dt / 3.0), k3, dt / 3.0), k4, dt / 6.0)
    return x


@njit(error_model="numpy")
def relative_orbit_row(
    steps: OrbitSteps, orbit: FloatArray, position: FloatArray, velocity: FloatArray, control: FloatArray, mass: float
) -> float:
    """Advance one body; see `Dynamics`. The chief's orbit, shape (6,), is the one at the start of the step."""
    x, y, z = control[0] / mass, control[1] / mass, control[2] / mass
    at, moving = (position[0], position[1], position[2]), (velocity[0], velocity[1], velocity[2])
    after = _after(steps, orbit, at, moving, (x, y, z))
    for k in range(3):
        position[k], velocity[k] = after[2][k], after[3][k]
    rate: float = abs(x) + abs(y) + abs(z)
    return rate


@njit(error_model="numpy")
def orbit_row(steps: OrbitSteps, orbit: FloatArray) -> None:
    """Advance the chief's orbit, shape (6,), by a step."""
    still = (0.0, 0.0, 0.0)
    after = _after(steps, orbit, still, still, still)
    for k in range(3):
        orbit[k], orbit[3 + k] = after[0][k], after[1][k]
