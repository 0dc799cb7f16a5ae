"""`RelativeOrbit`: a point mass near a chief on an elliptic orbit about the oblate Earth, with thrust.

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
from collections.abc import Mapping
from typing import Any, ClassVar, NamedTuple

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from safe_inspect.compiling import Kernel, njit
from safe_inspect.dynamics.attitude.rigid_body import Vector, moved_vector
from safe_inspect.dynamics.base import DisturbanceBounds, Dynamics, MotionLimits
from safe_inspect.dynamics.orbit.earth import EARTH_GRAVITY, EARTH_J2, EARTH_RADIUS, semi_major_axis
from safe_inspect.errors import InitialStateError
from safe_inspect.types import ArraySpec, FloatArray
from safe_inspect.units import (
    Angle,
    NonNegativeAreaPerMass,
    NonNegativeDensity,
    PolarAngle,
    PositiveAngularRate,
    PositiveLength,
)

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


class Drag(BaseModel):
    """Drag of spheres in an exponential atmosphere that is at rest in inertial space.

    Attributes:
        density: Density at the height of the semi-major axis [kg/m^3]; the default is that of 850 km, the height of the
            default mean motion, at high solar activity.
        scale_height: Height over which the density falls by a factor e [m].
        deputy: Drag coefficient times area over mass of a deputy, C_D A / m [m^2/kg].
        chief: The same of the chief [m^2/kg].
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    density: NonNegativeDensity = 1e-13  # type: ignore[valid-type]
    scale_height: PositiveLength = 125e3
    deputy: NonNegativeAreaPerMass = 0.02  # type: ignore[valid-type]
    chief: NonNegativeAreaPerMass = 0.01  # type: ignore[valid-type]

    def difference(self, below: float, speed: float, nearer: float, faster: float) -> float:
        """Return a bound of the difference of a deputy's and the chief's accelerations [m/s^2].

        Args:
            below: Largest height of the chief below the semi-major axis [m].
            speed: Its largest speed in inertial space [m/s].
            nearer: Largest distance between deputy and chief [m].
            faster: Largest difference of their speeds in inertial space [m/s].
        """
        pressure = 0.5 * self.density * math.exp(below / self.scale_height) * speed**2
        more = math.exp(nearer / self.scale_height) * (1.0 + faster / speed) ** 2 - 1.0
        return float(pressure * (abs(self.deputy - self.chief) + self.deputy * more))


#: Array of the chief's orbit: r [m], r' [m/s], h [m^2/s], i, u and the node [rad], see `relative_orbit_row`.
ORBIT = "chief_orbit"
#: Largest angle by which the chief moves in an integration step at its perigee [rad].
_LARGEST_TURN = 0.02
#: Bound of the relative changes of r, h and the speed by the oblateness within an orbit, in units of J2 (R / r)^2. The
#: largest in 6,000 random orbits is 4.01, that of r; this is sampled, not proved.
_OSCILLATION = 4.5


class RelativeOrbit(Dynamics):
    """Motion relative to a chief on an elliptic orbit about the Earth, not linearised, under held thrust.

    The origin of Hill's frame is the chief, x is radially outwards, z along the orbit's angular momentum; the frame
    turns at the rate of the orbit, which is not constant. Thrust is along Hill's axes. The equations are integrated by
    the classical Runge-Kutta method, see `relative_orbit_row`.

    The orbit at the reset has the semi-major axis of the mean motion. Its other elements are reset parameters, or else
    those of the fields; a drawn eccentricity must not exceed the field, which bounds the departure from the
    Clohessy-Wiltshire motion for safety filters. The array ``chief_orbit``, shape (N, 6), contains the orbit.

    Attributes:
        mean_motion: Mean motion n of the orbit at the reset [rad/s].
        eccentricity: Eccentricity, and the largest one that a reset may draw [-].
        inclination: Inclination to the equator [rad].
        argument_of_perigee: Angle from the ascending node to the perigee [rad].
        true_anomaly: Angle from the perigee to the chief at the reset [rad].
        right_ascension: Right ascension of the ascending node at the reset [rad], for a sun with a date.
        oblate: Whether the Earth is oblate (J2); else it is a sphere.
        drag: Drag of deputies and chief; None: there is none.

    Raises:
        ValueError: The perigee is inside of the Earth.
    """

    row: ClassVar[Kernel[..., float]] = relative_orbit_row
    shared: ClassVar[Mapping[str, ArraySpec]] = {ORBIT: ArraySpec((6,))}
    shared_row: ClassVar[Kernel[..., None] | None] = orbit_row
    parameters: ClassVar[Mapping[str, str]] = {
        "eccentricity": "",
        "inclination": "rad",
        "argument_of_perigee": "rad",
        "true_anomaly": "rad",
        "right_ascension": "rad",
    }

    mean_motion: PositiveAngularRate = 0.001027
    eccentricity: float = Field(default=0.0, ge=0.0, lt=0.8)
    inclination: PolarAngle = 0.9
    argument_of_perigee: Angle = 0.0
    true_anomaly: Angle = 0.0
    right_ascension: Angle = 0.0
    oblate: bool = True
    drag: Drag | None = None

    @model_validator(mode="after")
    def _outside(self) -> RelativeOrbit:
        perigee = semi_major_axis(self.mean_motion) * (1.0 - self.eccentricity)
        if perigee <= EARTH_RADIUS:
            most = 1.0 - EARTH_RADIUS / semi_major_axis(self.mean_motion)
            at = f"with the `mean_motion` {self.mean_motion:g} rad/s"
            fix = f"`eccentricity` must be less than {most:.4f}" if most > 0.0 else "lower the `mean_motion`"
            raise ValueError(f"the perigee is inside of the Earth, at {perigee / 1e3:.0f} km; {at}, {fix}")
        return self

    @property
    def uniform(self) -> bool:
        """Whether Hill's frame turns at a constant rate: on a circular orbit about a spherical Earth, without drag."""
        return self.eccentricity == 0.0 and not self.oblate and self.drag is None

    @property
    def _oblateness(self) -> float:
        return 1.5 * EARTH_J2 * EARTH_GRAVITY * EARTH_RADIUS**2 if self.oblate else 0.0

    def __call__(self, step_size: float) -> tuple[Any, ...]:
        """Return the constants of the integration.

        Args:
            step_size: Length of a physics step [s].
        """
        at_perigee = self.mean_motion * math.sqrt(1.0 + self.eccentricity) / (1.0 - self.eccentricity) ** 1.5
        substeps = max(math.ceil(step_size * at_perigee / _LARGEST_TURN), 1)
        air = self.drag or Drag(density=0.0)
        reference = semi_major_axis(self.mean_motion)
        return (
            OrbitSteps(
                self._oblateness, step_size, substeps, air.density, reference, air.scale_height, air.chief, air.deputy
            ),
        )

    @property
    def allowed(self) -> Mapping[str, tuple[float, float]]:
        """An eccentricity up to the field, and angles of at most a revolution."""
        turn = 2.0 * math.pi
        angles = dict.fromkeys(("argument_of_perigee", "true_anomaly", "right_ascension"), (-turn, turn))
        return {"eccentricity": (0.0, self.eccentricity), "inclination": (0.0, math.pi), **angles}

    def reset_shared(self, values: Mapping[str, Any], rows: int) -> Mapping[str, FloatArray]:
        """Return the orbits at the start of R episodes, shape (R, 6).

        Raises:
            InitialStateError: An eccentricity is negative, or exceeds the field.
        """
        e, i, perigee, anomaly, node = (
            np.broadcast_to(np.asarray(values.get(name, getattr(self, name)), dtype=np.float64), (rows,))
            for name in self.parameters
        )
        if not np.all((e >= 0.0) & (e <= self.eccentricity)):
            raise InitialStateError(
                f"the reset parameter `eccentricity` is {e[~((e >= 0.0) & (e <= self.eccentricity))][0]:g}, but the "
                f"field of RelativeOrbit allows 0 to {self.eccentricity:g}; raise the field, or lower the parameter"
            )
        semi_latus = semi_major_axis(self.mean_motion) * (1.0 - e * e)
        momentum = np.sqrt(EARTH_GRAVITY * semi_latus)
        distance = semi_latus / (1.0 + e * np.cos(anomaly))
        radial = EARTH_GRAVITY / momentum * e * np.sin(anomaly)
        orbit = (distance, radial, momentum, i, perigee + anomaly, node)
        return {ORBIT: np.stack(orbit, axis=-1)}

    def initial_figures(self, shared: Mapping[str, FloatArray]) -> Mapping[str, FloatArray]:
        """Return the elements of the orbits, by the names of the reset parameters, each of shape (N,)."""
        r, radial, h, i, u, node = shared[ORBIT].T
        along, across = h * h / (EARTH_GRAVITY * r) - 1.0, radial * h / EARTH_GRAVITY
        anomaly = np.arctan2(across, along)
        turn = 2.0 * math.pi
        figures = (np.hypot(along, across), i, (u - anomaly) % turn, anomaly % turn, node % turn)
        return dict(zip(self.parameters, figures, strict=True))

    def disturbance_bounds(self, limits: MotionLimits) -> DisturbanceBounds:
        """Return a bound of the velocity by which a step departs from the Clohessy-Wiltshire motion.

        It is the product of the step size and bounds of the differences of gravity, of the rotation of Hill's frame and
        of the second order in the distance, and of drag, over all orbits up to the eccentricity. It does not include
        the decay of the orbit by drag during an episode.

        Raises:
            ValueError: The distance or the speed has no limit, or the deputy may reach the Earth's surface.
        """
        n, d, s, e, k = self.mean_motion, limits.distance, limits.speed, self.eccentricity, self._oblateness
        a = semi_major_axis(n)
        wobble = _OSCILLATION * EARTH_J2 * (EARTH_RADIUS / (a * (1.0 - e))) ** 2 if self.oblate else 0.0
        near, far = a * (1.0 - e) * (1.0 - wobble), a * (1.0 + e) * (1.0 + wobble)
        if not (math.isfinite(s) and d < near - EARTH_RADIUS):
            raise ValueError(
                "the departure from the Clohessy-Wiltshire motion has no bound without limits of the motion"
            )
        h = math.sqrt(EARTH_GRAVITY * a)
        # Ranges over the orbits of the angular momentum, of the radial velocity and of the rate h / r^2 of the frame.
        least, most = h * math.sqrt(1.0 - e * e) * (1.0 - wobble), h * (1.0 + wobble)
        radial = EARTH_GRAVITY / least * (e + 2.0 * wobble)
        slow, fast = least / far**2, most / near**2
        # Gradient of gravity less that of the mean motion; rate of the frame about x, and the oblateness times r.
        tide = max(EARTH_GRAVITY / near**3 - n * n, n * n - EARTH_GRAVITY / far**3)
        tilt, bulge = 2.0 * k / (near**3 * least), 2.0 * k / near**3
        # Differences from the mean motion of the frame's rate about z, then derivatives of the rates about z and x.
        turn = max(fast - n, n - slow)
        swing = 2.0 * most * radial / near**3 + bulge / near**2
        nod = tilt * (2.0 * fast + 3.0 * radial / near + bulge / (least * near))
        acceleration = (
            d * (2.0 * tide + max(fast**2 - n * n, n * n - slow**2) + swing + nod + tilt * (tilt + 2.0 * fast))
            + d * 8.0 * k / (near - d) ** 5
            + 3.0 * EARTH_GRAVITY * d * d / (near - d) ** 4
            + 2.0 * s * (turn + tilt)
        )
        if self.drag is not None:
            speed = math.hypot(radial, most / near)
            acceleration += self.drag.difference(a - near, speed, d, s + (fast + tilt) * d)
        growth = math.exp(4.0 * fast * limits.step_size)
        return DisturbanceBounds(velocity=acceleration * limits.step_size * growth)

    def offers(self) -> Mapping[str, Any]:
        """Return the mean motion [rad/s], and the name of the array of the orbit."""
        return {"mean_motion": self.mean_motion, "orbit": ORBIT}
