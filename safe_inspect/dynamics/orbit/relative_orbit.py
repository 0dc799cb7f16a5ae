"""`RelativeOrbit`: a point mass near a chief on an elliptic orbit about the oblate Earth, with thrust and drag.

The equations and their sources: `safe_inspect.dynamics.orbit.relative_orbit_row`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from safe_inspect.compiling import Kernel
from safe_inspect.dynamics.base import DisturbanceBounds, Dynamics, MotionLimits
from safe_inspect.dynamics.orbit.earth import EARTH_GRAVITY, EARTH_J2, EARTH_RADIUS, semi_major_axis
from safe_inspect.dynamics.orbit.relative_orbit_row import OrbitSteps, orbit_row, relative_orbit_row
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
#: Reset parameters that are angles of up to a revolution.
_TURNS = ("argument_of_perigee", "true_anomaly", "right_ascension")
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
    parameters: ClassVar[Mapping[str, str]] = {"eccentricity": "", "inclination": "rad", **dict.fromkeys(_TURNS, "rad")}

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
        angles = dict.fromkeys(_TURNS, (-turn, turn))
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
