"""Constraint that keeps a deputy safe if its thrusters fail."""

from __future__ import annotations

import math
from typing import ClassVar, Self

from safe_inspect.compiling import njit
from safe_inspect.dynamics.coasting import coast, extreme_time, grid
from safe_inspect.rta.constraints.base import Constraint, ConstraintValues, RelativeState
from safe_inspect.rta.constraints.parameters import DEFAULTS, ConstraintParameters
from safe_inspect.rta.constraints.range_limit import LENGTH_FLOOR
from safe_inspect.types import FloatArray
from safe_inspect.units import PositiveAngularRate, PositiveDuration, PositiveLength


@njit
def _across(vx: float, vy: float, vz: float) -> tuple[float, float, float]:
    """Return a unit vector perpendicular to the velocity; +x where the velocity has no part in the orbital plane."""
    in_plane, whole = math.sqrt(vx * vx + vy * vy), math.sqrt(vx * vx + vy * vy + vz * vz)
    if not in_plane > 1e-9 * whole:
        return 1.0, 0.0, 0.0
    return -vy / in_plane, vx / in_plane, 0.0


@njit
def _values(
    position: FloatArray, velocity: FloatArray, table: FloatArray, n: float, radius: float,
    phi: FloatArray, h: FloatArray, gradient: FloatArray,
) -> None:  # fmt: skip
    """Write the least coasting range minus the radius, and its gradient by the envelope theorem."""
    for i in range(position.shape[0]):
        p, v = position[i], velocity[i]
        t = extreme_time(p, v, table, n, 1.0)
        s, c = math.sin(n * t), math.cos(n * t)
        x, y, z, vx, vy, vz, square, _, _ = coast(p, v, t, s, c, n)
        distance = math.sqrt(square)
        if distance < LENGTH_FLOOR:
            ex, ey, ez = _across(vx, vy, vz)
        else:
            ex, ey, ez = x / distance, y / distance, z / distance
        phi[i] = distance - radius
        h[i] = distance - radius
        gradient[i, 0] = (4.0 - 3.0 * c) * ex + 6.0 * (s - n * t) * ey
        gradient[i, 1] = ey
        gradient[i, 2] = c * ez
        gradient[i, 3] = (s * ex - 2.0 * (1.0 - c) * ey) / n
        gradient[i, 4] = (2.0 * (1.0 - c) * ex + 4.0 * s * ey) / n - 3.0 * t * ey
        gradient[i, 5] = s * ez / n


class PassivelySafeManoeuvre(Constraint, name="PSM"):
    """Coasting past the chief: h = phi = (least range over the horizon without thrust) - r_c [m].

    The least range is taken over all times 0 <= t <= horizon of the closed-form Clohessy-Wiltshire motion. The closest
    approaches are bracketed on a grid of at most 0.1 rad of the orbit and refined by Newton's method, so the horizon
    may be several orbits. By the envelope theorem, the gradient is that of the range at the time of closest approach,

        dh/dx0 = Phi(t*)^T (p(t*) / |p(t*)|, 0).

    Where two approaches are equally close, h has a kink and the gradient is that of the earlier one. Where coasting
    passes within 1e-6 m of the chief's centre, the direction is taken perpendicular to the path there, which is the
    direction to miss it. If the closest approach is at t = 0, the deputy is leaving, and thrust cannot change the
    gradient.

    Attributes:
        collision_radius: Smallest allowed range r_c [m].
        mean_motion: Mean motion n [rad/s].
        horizon: Duration of coasting [s].
    """

    unit: ClassVar[str] = "m"
    uncertified: ClassVar[frozenset[str]] = Constraint.uncertified | {"mean_motion"}

    collision_radius: PositiveLength = DEFAULTS.collision_radius
    mean_motion: PositiveAngularRate = DEFAULTS.n
    horizon: PositiveDuration = DEFAULTS.psm_horizon

    @classmethod
    def from_parameters(cls, parameters: ConstraintParameters) -> Self:
        """Build the constraint from a task's parameters."""
        return cls(
            collision_radius=parameters.collision_radius, mean_motion=parameters.n, horizon=parameters.psm_horizon
        )

    def evaluate(self, state: RelativeState) -> ConstraintValues:
        """Return phi [m], h [m] and the derivatives of h."""
        out = ConstraintValues.zeros(len(state))
        _values(
            state.position, state.velocity, grid(self.mean_motion, self.horizon), self.mean_motion,
            self.collision_radius, out.phi, out.h, out.gradient,
        )  # fmt: skip
        return out
