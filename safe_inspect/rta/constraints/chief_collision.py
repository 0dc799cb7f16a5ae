"""Constraint that keeps a deputy away from the chief."""

from __future__ import annotations

import math
from collections.abc import Mapping, Set
from typing import Any, ClassVar, NamedTuple, Self

from safe_inspect.compiling import njit
from safe_inspect.rta.constraints.base import Constraint, ConstraintValues, RelativeState
from safe_inspect.rta.constraints.parameters import DEFAULTS, ConstraintParameters
from safe_inspect.rta.constraints.range_limit import range_limit
from safe_inspect.rta.constraints.rows import INLINED, Margins, Node, RowKernels, direction, lowest
from safe_inspect.rta.fields import PositiveAcceleration
from safe_inspect.types import FloatArray
from safe_inspect.units import PositiveLength

#: Closed motions stay at least this far from the apex of the sun cone [m], where no cell could certify them.
APEX = 1.0


class CollisionNumbers(NamedTuple):
    """Least ranges [m], minus infinity where there is no limit: at every moment, and of closed motions."""

    near: float
    closed_near: float


@njit(**INLINED)
def _broken(p: CollisionNumbers, at: Any, margins: Margins) -> bool:
    return bool(at.range < p.near + margins.length)


@njit(**INLINED)
def _uncertain(p: CollisionNumbers, cell: Any, margins: Margins) -> bool:
    return bool(cell.size <= 0.0 or lowest(cell.near_a, cell.near_b, cell.dip) < p.near + margins.length)


@njit(**INLINED)
def _closed_broken(p: CollisionNumbers, at: Any, margins: Margins) -> bool:
    return bool(at.range < p.closed_near + margins.coasting)


@njit(**INLINED)
def _closed_uncertain(p: CollisionNumbers, cell: Any, margins: Margins) -> bool:
    return bool(cell.size <= 0.0 or lowest(cell.near_a, cell.near_b, cell.dip) < p.closed_near + margins.coasting)


@njit(**INLINED)
def _slack(p: CollisionNumbers, at: Node) -> float:
    return at.range - p.closed_near


@njit(**INLINED)
def _gap(p: CollisionNumbers, at: Node) -> float:
    return at.range - p.near


@njit(**INLINED)
def _support(p: CollisionNumbers, at: Node, margins: Margins, d: FloatArray) -> float:
    d[0], d[1], d[2] = direction(at.state[0], at.state[1], at.state[2])
    return p.near + margins.length


class ChiefCollision(Constraint, name="chief_collision"):
    """Constraint that the deputy can brake before the chief: h = sqrt(2 a (r - r_c)) + p.v / r, phi = r - r_c.

    h [m/s] compares the speed from which the deputy can brake within the gap to the closing speed. Inside the collision
    radius, the root is -sqrt(2 a |r - r_c|), so that h has the same meaning there.

    Within 1e-6 m of the chief's centre, the direction p / r is taken as +x. Within 1e-6 m of the collision radius, the
    slope of the root, which is infinite on the radius, is the slope at 1e-6 m.

    Attributes:
        collision_radius: Smallest allowed range r_c [m].
        max_acceleration: Deceleration a that the thrusters guarantee [m/s^2].
    """

    unit: ClassVar[str] = "m"
    kernels: ClassVar[RowKernels | None] = RowKernels(
        broken=_broken, uncertain=_uncertain, slack=_slack, support=_support, gap=_gap,
        closed_broken=_closed_broken, closed_uncertain=_closed_uncertain, cost=1,
    )  # fmt: skip

    collision_radius: PositiveLength = DEFAULTS.collision_radius
    max_acceleration: PositiveAcceleration = DEFAULTS.max_acceleration

    @classmethod
    def from_parameters(cls, parameters: ConstraintParameters) -> Self:
        """Build the constraint from a task's parameters."""
        return cls(collision_radius=parameters.collision_radius, max_acceleration=parameters.max_acceleration)

    @classmethod
    def counts(cls, chosen: Set[str]) -> bool:
        """Return whether a least range applies: passive safety and the sun cone imply one too; see `row_numbers`."""
        return not chosen.isdisjoint(("chief_collision", "PSM", "sun"))

    @classmethod
    def row_numbers(cls, n: float, chosen: Mapping[str, Any]) -> CollisionNumbers:
        """Return the least ranges; that of closed motions also covers passive safety and the apex of the sun cone."""
        near, passing = (
            float(chosen[name].collision_radius) if name in chosen else -math.inf for name in ("chief_collision", "PSM")
        )
        return CollisionNumbers(near, max(near, passing, APEX if "sun" in chosen else -math.inf))

    def evaluate(self, state: RelativeState) -> ConstraintValues:
        """Return phi [m], h [m/s] and the derivatives of h."""
        out = ConstraintValues.zeros(len(state))
        range_limit(
            (state.position, state.velocity), self.collision_radius, self.max_acceleration, 1.0,
            out.phi, out.h, out.gradient,
        )  # fmt: skip
        return out
