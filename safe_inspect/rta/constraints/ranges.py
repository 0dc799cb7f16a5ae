"""Constraints on the range: of a deputy from the chief, now and if its thrusters fail, and of two deputies.

The difference of two motions about the chief follows the same Clohessy-Wiltshire equations, with the difference of the
accelerations as its input. The constraints of two deputies are therefore those about the chief, with the other deputy
in its place: their `RelativeState` is the state of the deputy minus the state of the other. Both deputies can brake, so
the deceleration is twice that of one.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping, Set
from functools import cached_property
from typing import Any, ClassVar, NamedTuple

from safe_inspect.compiling import njit
from safe_inspect.dynamics.coasting import coast, extreme_time, grid
from safe_inspect.rta.constraints.base import Constraint, ConstraintValues, RelativeState
from safe_inspect.rta.constraints.parameters import DEFAULTS
from safe_inspect.rta.constraints.rows import (
    INLINED,
    LENGTH_FLOOR,
    Margins,
    Node,
    RowKernels,
    StateArrays,
    braking_speed,
    direction,
    lowest,
)
from safe_inspect.types import FloatArray
from safe_inspect.units import PositiveAcceleration, PositiveAngularRate, PositiveDuration, PositiveLength

#: Closed motions stay at least this far from the apex of the sun cone [m], where no cell could certify them.
APEX = 1.0


@njit
def _range_values(
    state: StateArrays, limit: float, acceleration: float, side: float,
    phi: FloatArray, h: FloatArray, gradient: FloatArray, rate: FloatArray,
) -> None:  # fmt: skip
    """Write phi, h and the gradient of h of a bound on the range: a lower bound for side = 1, an upper one for -1."""
    position, velocity, _ = state
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
        root, slope = braking_speed(gap, acceleration)
        phi[i] = gap
        h[i] = root + side * speed
        gradient[i, 0] = side * slope * ex + turning * (vx - speed * ex)
        gradient[i, 1] = side * slope * ey + turning * (vy - speed * ey)
        gradient[i, 2] = side * slope * ez + turning * (vz - speed * ez)
        gradient[i, 3] = side * ex
        gradient[i, 4] = side * ey
        gradient[i, 5] = side * ez


class _CollisionNumbers(NamedTuple):
    """Least ranges [m], minus infinity where there is no limit: at every moment, and of closed motions."""

    near: float
    closed_near: float


@njit(**INLINED)
def _too_near(p: _CollisionNumbers, at: Any, margins: Margins) -> bool:
    return bool(at.range < p.near + margins.length)


@njit(**INLINED)
def _near_uncertain(p: _CollisionNumbers, cell: Any, margins: Margins) -> bool:
    return bool(cell.size <= 0.0 or lowest(cell.near_a, cell.near_b, cell.dip) < p.near + margins.length)


@njit(**INLINED)
def _closed_broken(p: _CollisionNumbers, at: Any, margins: Margins) -> bool:
    return bool(at.range < p.closed_near + margins.coasting)


@njit(**INLINED)
def _closed_uncertain(p: _CollisionNumbers, cell: Any, margins: Margins) -> bool:
    return bool(cell.size <= 0.0 or lowest(cell.near_a, cell.near_b, cell.dip) < p.closed_near + margins.coasting)


@njit(**INLINED)
def _near_slack(p: _CollisionNumbers, at: Node) -> float:
    return at.range - p.closed_near


@njit(**INLINED)
def _near_gap(p: _CollisionNumbers, at: Node) -> float:
    return at.range - p.near


@njit(**INLINED)
def _near_support(p: _CollisionNumbers, at: Node, margins: Margins, d: FloatArray) -> float:
    d[0], d[1], d[2] = direction(at.state)
    return p.near + margins.length


class ChiefCollision(Constraint, name="chief_collision"):
    """Constraint that the deputy keeps its distance to the chief: phi = r - r_c, h = sqrt(2 a (r - r_c)) + p.v / r.

    phi >= 0 at every moment is what the filters ``backup`` and of a team guarantee; `Constraint` has the premises. h,
    for the filter ``continuous`` and for drawing initial states, says that the deputy can brake before r_c.

    h [m/s] compares the speed from which the deputy can brake within the gap to the closing speed. Inside the collision
    radius, the root is -sqrt(2 a |r - r_c|), so that h has the same meaning there.

    Within 1e-6 m of the chief's centre, the direction p / r is taken as +x. Within 1e-6 m of the collision radius, the
    slope of the root, which is infinite on the radius, is the slope at 1e-6 m.

    Attributes:
        collision_radius: Smallest allowed range r_c [m]; 10 by default.
        max_acceleration: Deceleration a that the thrusters can give [m/s^2], 0.0787 by default, see
            `ConstraintParameters.net_acceleration`; only h depends on it.
    """

    unit: ClassVar[str] = "m"
    from_task: ClassVar[Mapping[str, str]] = {
        "collision_radius": "collision_radius", "max_acceleration": "max_acceleration",
    }  # fmt: skip
    kernels: ClassVar[RowKernels | None] = RowKernels(
        broken=_too_near, uncertain=_near_uncertain, slack=_near_slack, support=_near_support, gap=_near_gap,
        closed_broken=_closed_broken, closed_uncertain=_closed_uncertain, cost=1,
    )  # fmt: skip

    collision_radius: PositiveLength = DEFAULTS.collision_radius
    max_acceleration: PositiveAcceleration = DEFAULTS.max_acceleration

    @classmethod
    def counts(cls, chosen: Set[str]) -> bool:
        """Return whether a least range applies: passive safety and the sun cone imply one too; see `row_numbers`."""
        return not chosen.isdisjoint(("chief_collision", "PSM", "sun"))

    @classmethod
    def row_numbers(cls, n: float, chosen: Mapping[str, Any]) -> _CollisionNumbers:
        """Return the least ranges; that of closed motions also covers passive safety and the apex of the sun cone."""
        near, passing = (
            float(chosen[name].collision_radius) if name in chosen else -math.inf for name in ("chief_collision", "PSM")
        )
        return _CollisionNumbers(near, max(near, passing, APEX if "sun" in chosen else -math.inf))

    def evaluate(self, state: RelativeState) -> ConstraintValues:
        """Return phi [m], h [m/s] and the derivatives of h."""
        return ConstraintValues.computed(_range_values, state, self.collision_radius, self.max_acceleration, 1.0)


#: At ranges above this fraction of v / (2 n), v the largest along-track speed, closed motions are too fast to fly:
#: backup plans return to a smaller range.
_CLOSABLE = 0.9


class _MaximumRangeNumbers(NamedTuple):
    """Largest range [m], infinity where there is no limit, and the range to which backup plans return [m]."""

    far: float
    inside: float


@njit(**INLINED)
def _too_far(p: _MaximumRangeNumbers, at: Any, margins: Margins) -> bool:
    return bool(at.range > p.far - margins.length)


@njit(**INLINED)
def _far_uncertain(p: _MaximumRangeNumbers, cell: Any, margins: Margins) -> bool:
    if not cell.farthest > p.far - margins.length:
        return False
    return bool(lowest(-cell.a.range, -cell.b.range, cell.bend) < margins.length - p.far)


@njit(**INLINED)
def _far_slack(p: _MaximumRangeNumbers, at: Node) -> float:
    return p.far - at.range


@njit(**INLINED)
def _far_gap(p: _MaximumRangeNumbers, at: Node) -> float:
    return p.inside - at.range


@njit(**INLINED)
def _far_support(p: _MaximumRangeNumbers, at: Node, margins: Margins, d: FloatArray) -> float:
    ex, ey, ez = direction(at.state)
    d[0], d[1], d[2] = -ex, -ey, -ez
    return margins.length - p.far


class MaximumRange(Constraint, name="r_max"):
    """Constraint that the deputy stays within a range: phi = r_max - r, h = sqrt(2 a (r_max - r)) - p.v / r.

    phi and h have the same roles as in `ChiefCollision`.

    Beyond the largest range, the root is -sqrt(2 a |r_max - r|). Singular points are treated as in `ChiefCollision`.
    The deceleration a does not include the centrifugal acceleration |v_across|^2 / r.

    Attributes:
        r_max: Largest allowed range [m]; 800 by default.
        max_acceleration: Deceleration a that the thrusters can give [m/s^2]; only h depends on it.
    """

    unit: ClassVar[str] = "m"
    from_task: ClassVar[Mapping[str, str]] = {"r_max": "r_max", "max_acceleration": "max_acceleration"}
    kernels: ClassVar[RowKernels | None] = RowKernels(
        broken=_too_far, uncertain=_far_uncertain, slack=_far_slack, support=_far_support, gap=_far_gap,
        closed_broken=_too_far, closed_uncertain=_far_uncertain, convex=True,
    )  # fmt: skip

    r_max: PositiveLength = DEFAULTS.r_max
    max_acceleration: PositiveAcceleration = DEFAULTS.max_acceleration
    bias: float = -1e-3

    @classmethod
    def row_numbers(cls, n: float, chosen: Mapping[str, Any]) -> _MaximumRangeNumbers:
        """Return the largest range, and the largest range of closed motions that the along-track speed limit allows."""
        far = float(chosen["r_max"].r_max) if "r_max" in chosen else math.inf
        fastest = float(chosen["y_vel"].vel_limit) if "y_vel" in chosen else math.inf
        return _MaximumRangeNumbers(far, min(far, _CLOSABLE * fastest / (2.0 * n)))

    def evaluate(self, state: RelativeState) -> ConstraintValues:
        """Return phi [m], h [m/s] and the derivatives of h."""
        return ConstraintValues.computed(_range_values, state, self.r_max, self.max_acceleration, -1.0)


@njit
def _across(vx: float, vy: float, vz: float) -> tuple[float, float, float]:
    """Return a unit vector perpendicular to the velocity; +x where the velocity has no part in the orbital plane."""
    in_plane, whole = math.sqrt(vx * vx + vy * vy), math.sqrt(vx * vx + vy * vy + vz * vz)
    if not in_plane > 1e-9 * whole:
        return 1.0, 0.0, 0.0
    return -vy / in_plane, vx / in_plane, 0.0


@njit
def _coasting_values(
    state: StateArrays, table: FloatArray, n: float, radius: float,
    phi: FloatArray, h: FloatArray, gradient: FloatArray, rate: FloatArray,
) -> None:  # fmt: skip
    """Write the least coasting range minus the radius, and its gradient by the envelope theorem."""
    position, velocity, _ = state
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

    The certifying filters guarantee it over each hold and its backup manoeuvre (`rta/backup/holds.py`), not by kernels
    of this class.

    The least range is taken over all times 0 <= t <= horizon of the closed-form Clohessy-Wiltshire motion. The closest
    approaches are bracketed on a grid of at most 0.1 rad of the orbit and refined by Newton's method, so the horizon
    may be several orbits. By the envelope theorem, the gradient is that of the range at the time of closest approach,

        dh/dx0 = Phi(t*)^T (p(t*) / |p(t*)|, 0).

    Where two approaches are equally close, h has a kink and the gradient is that of the earlier one. Where coasting
    passes within 1e-6 m of the chief's centre, the direction is taken perpendicular to the path there, which is the
    direction to miss it. If the closest approach is at t = 0, the deputy is leaving, and thrust cannot change the
    gradient.

    Attributes:
        collision_radius: Smallest allowed range r_c [m]; 10 by default.
        mean_motion: Mean motion n [rad/s].
        horizon: Duration of coasting [s]; 100 by default.
    """

    unit: ClassVar[str] = "m"
    from_task: ClassVar[Mapping[str, str]] = {
        "collision_radius": "collision_radius", "mean_motion": "n", "horizon": "psm_horizon",
    }  # fmt: skip
    uncertified: ClassVar[frozenset[str]] = Constraint.uncertified | {"mean_motion"}

    collision_radius: PositiveLength = DEFAULTS.collision_radius
    mean_motion: PositiveAngularRate = DEFAULTS.n
    horizon: PositiveDuration = DEFAULTS.psm_horizon

    def evaluate(self, state: RelativeState) -> ConstraintValues:
        """Return phi [m], h [m] and the derivatives of h."""
        table = grid(self.mean_motion, self.horizon)
        return ConstraintValues.computed(_coasting_values, state, table, self.mean_motion, self.collision_radius)


#: Two deputies collide when their centres are closer than twice this distance [m].
DEPUTY_RADIUS = 5.0


class PairConstraint(Constraint):
    """Base class of constraints between two deputies: a constraint about the chief, with the other one in its place.

    The `RelativeState` is that of one deputy relative to the other. The filter of a team enforces a constraint whose
    `about_other` is a `ChiefCollision` or a `PassivelySafeManoeuvre`, one of each at most.

    Attributes:
        deputy_radius: Radius r_d about each deputy [m].
    """

    unit: ClassVar[str] = "m"
    pair: ClassVar[bool] = True

    deputy_radius: PositiveLength = DEPUTY_RADIUS

    @property
    @abstractmethod
    def about_other(self) -> Constraint:
        """Constraint on the relative motion, with the other deputy in place of the chief."""

    def evaluate(self, state: RelativeState) -> ConstraintValues:
        """Return phi, h and the derivatives of h, those of `about_other`."""
        return self.about_other.evaluate(state)


class DeputyCollision(PairConstraint, name="deputy_collision"):
    """Constraint that two deputies keep their distance: phi = d - 2 r_d, h = sqrt(4 a (d - 2 r_d)) + dp.dv / d.

    phi and h have the same roles as in `ChiefCollision`.

    Attributes:
        deputy_radius: Radius r_d about each deputy [m].
        max_acceleration: Deceleration a that each deputy can give [m/s^2].
    """

    from_task: ClassVar[Mapping[str, str]] = {"max_acceleration": "max_acceleration"}

    max_acceleration: PositiveAcceleration = DEFAULTS.max_acceleration

    @cached_property
    def about_other(self) -> ChiefCollision:
        """Constraint on the relative motion, with the other deputy in place of the chief."""
        return ChiefCollision(collision_radius=2.0 * self.deputy_radius, max_acceleration=2.0 * self.max_acceleration)


class DeputyPassiveSafety(PairConstraint, name="deputy_PSM"):
    """Coasting past the other deputy: h = phi = (least distance over the horizon without thrust) - 2 r_d [m].

    Attributes:
        deputy_radius: Radius r_d about each deputy [m].
        mean_motion: Mean motion n [rad/s].
        horizon: Duration of coasting [s].
    """

    from_task: ClassVar[Mapping[str, str]] = {"mean_motion": "n", "horizon": "psm_horizon"}
    uncertified: ClassVar[frozenset[str]] = Constraint.uncertified | {"mean_motion"}

    mean_motion: PositiveAngularRate = DEFAULTS.n
    horizon: PositiveDuration = DEFAULTS.psm_horizon

    @cached_property
    def about_other(self) -> PassivelySafeManoeuvre:
        """Constraint on the relative motion, with the other deputy in place of the chief."""
        radius = 2.0 * self.deputy_radius
        return PassivelySafeManoeuvre(collision_radius=radius, mean_motion=self.mean_motion, horizon=self.horizon)
