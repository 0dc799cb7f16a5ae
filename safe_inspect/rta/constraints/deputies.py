"""Constraints that keep two deputies safe from each other, on the motion of one relative to the other.

The difference of two motions about the chief follows the same Clohessy-Wiltshire equations, with the difference of the
accelerations as its input. These constraints are therefore those about the chief, with the other deputy in its place:
their `RelativeState` is the state of the deputy minus the state of the other. Both deputies can brake, so the
deceleration is twice that of one.
"""

from __future__ import annotations

import math
from functools import cached_property
from typing import ClassVar, Self

from safe_inspect.rta.constraints.base import Constraint, ConstraintValues, RelativeState
from safe_inspect.rta.constraints.chief_collision import ChiefCollision
from safe_inspect.rta.constraints.parameters import DEFAULTS, ConstraintParameters
from safe_inspect.rta.constraints.passive_safety import PassivelySafeManoeuvre
from safe_inspect.rta.constraints.sun import SunKeepOut
from safe_inspect.rta.fields import ConeAngle, PositiveAcceleration
from safe_inspect.units import PositiveAngularRate, PositiveDuration, PositiveLength

#: Two deputies collide when their centres are closer than twice this distance [m].
DEPUTY_RADIUS = 5.0


class DeputyCollision(Constraint, name="deputy_collision"):
    """Constraint that both deputies can brake in time: h = sqrt(4 a (d - 2 r_d)) + dp.dv / d, phi = d - 2 r_d.

    Attributes:
        deputy_radius: Radius r_d about each deputy [m].
        max_acceleration: Deceleration a that each deputy guarantees [m/s^2].
    """

    unit: ClassVar[str] = "m"
    pair: ClassVar[bool] = True

    deputy_radius: PositiveLength = DEPUTY_RADIUS
    max_acceleration: PositiveAcceleration = DEFAULTS.max_acceleration

    @classmethod
    def from_parameters(cls, parameters: ConstraintParameters) -> Self:
        """Build the constraint from a task's parameters."""
        return cls(max_acceleration=parameters.max_acceleration)

    @cached_property
    def about_other(self) -> ChiefCollision:
        """Constraint on the relative motion, with the other deputy in place of the chief."""
        return ChiefCollision(collision_radius=2.0 * self.deputy_radius, max_acceleration=2.0 * self.max_acceleration)

    def evaluate(self, state: RelativeState) -> ConstraintValues:
        """Return phi [m], h [m/s] and the derivatives of h."""
        return self.about_other.evaluate(state)


class DeputyPassiveSafety(Constraint, name="deputy_PSM"):
    """Coasting past the other deputy: h = phi = (least distance over the horizon without thrust) - 2 r_d [m].

    Attributes:
        deputy_radius: Radius r_d about each deputy [m].
        mean_motion: Mean motion n [rad/s].
        horizon: Duration of coasting [s].
    """

    unit: ClassVar[str] = "m"
    pair: ClassVar[bool] = True
    uncertified: ClassVar[frozenset[str]] = Constraint.uncertified | {"mean_motion"}

    deputy_radius: PositiveLength = DEPUTY_RADIUS
    mean_motion: PositiveAngularRate = DEFAULTS.n
    horizon: PositiveDuration = DEFAULTS.psm_horizon

    @classmethod
    def from_parameters(cls, parameters: ConstraintParameters) -> Self:
        """Build the constraint from a task's parameters."""
        return cls(mean_motion=parameters.n, horizon=parameters.psm_horizon)

    @cached_property
    def about_other(self) -> PassivelySafeManoeuvre:
        """Constraint on the relative motion, with the other deputy in place of the chief."""
        radius = 2.0 * self.deputy_radius
        return PassivelySafeManoeuvre(collision_radius=radius, mean_motion=self.mean_motion, horizon=self.horizon)

    def evaluate(self, state: RelativeState) -> ConstraintValues:
        """Return phi [m], h [m] and the derivatives of h."""
        return self.about_other.evaluate(state)


class DeputySunKeepOut(Constraint, name="deputy_sun"):
    """Constraint that keeps the sun out of a camera pointed at the other deputy; see `SunKeepOut` for phi and h.

    Attributes:
        fov: Full opening angle of the cone [rad].
        max_acceleration: Deceleration a that each deputy guarantees [m/s^2].
        mean_motion: Rate n of the sun angle [rad/s].
    """

    unit: ClassVar[str] = "rad"
    pair: ClassVar[bool] = True
    uncertified: ClassVar[frozenset[str]] = Constraint.uncertified | {"mean_motion"}

    fov: ConeAngle = math.pi / 3.0
    max_acceleration: PositiveAcceleration = DEFAULTS.max_acceleration
    mean_motion: PositiveAngularRate = DEFAULTS.n
    alpha_linear: float = 0.001
    alpha_cubic: float = 0.0001
    bias: float = -1e-3

    @classmethod
    def from_parameters(cls, parameters: ConstraintParameters) -> Self:
        """Build the constraint from a task's parameters."""
        return cls(fov=parameters.fov, max_acceleration=parameters.max_acceleration, mean_motion=parameters.n)

    @cached_property
    def about_other(self) -> SunKeepOut:
        """Constraint on the relative motion, with the other deputy in place of the chief."""
        return SunKeepOut(
            fov=self.fov, max_acceleration=2.0 * self.max_acceleration, mean_motion=self.mean_motion
        )  # fmt: skip

    def evaluate(self, state: RelativeState) -> ConstraintValues:
        """Return phi [rad], h [m/s] and the derivatives of h."""
        return self.about_other.evaluate(state)
