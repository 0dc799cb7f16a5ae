"""The safety glue of inspection by one deputy."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from pydantic import Field, PrivateAttr, model_validator

from safe_inspect.glues.base import Bounds, Parts
from safe_inspect.rta.base import SafetyGlue
from safe_inspect.rta.constraints import Constraint, RelativeState, constraint_set
from safe_inspect.types import BoolArray, FloatArray
from safe_inspect.units import NonNegativeSpeed, PositiveAngularRate, PositiveDuration, PositiveLength

CONSTRAINTS = ("chief_collision", "rel_vel", "sun", "r_max", "PSM", "x_vel", "y_vel", "z_vel")


class RTAGlueCWHInspection1v1(SafetyGlue):
    """Run-time assurance of one deputy that inspects a chief at the origin of Hill's frame.

    Attributes:
        state_observation_names: Observations that the peer's filter reads; here the state itself is read.
        step_size: Length of a step [s].
        collision_radius: Smallest range to the chief [m].
        v0: Speed limit at the range `v0_distance` [m/s].
        v0_distance: Range at which the speed limit is `v0` [m].
        v1_coef: Slope of the speed limit over range, in units of `n` [-].
        n: Mean motion [rad/s].
        r_max: Largest range [m].
        constraints: Names of the constraints.
    """

    state_observation_names: tuple[str, ...] = ()
    step_size: PositiveDuration = 10.0
    collision_radius: PositiveLength = 10.0
    v0: NonNegativeSpeed = 0.2
    v0_distance: PositiveLength = 10.0
    v1_coef: float = Field(default=2.0, ge=0)
    n: PositiveAngularRate = 0.001027
    r_max: PositiveLength = 800.0
    constraints: tuple[str, ...] = CONSTRAINTS
    _constraints: dict[str, Constraint] = PrivateAttr()

    def model_post_init(self, context: Any) -> None:
        """Build the constraints."""
        names = ("step_size", "collision_radius", "v0", "v0_distance", "v1_coef", "n", "r_max")
        self._constraints = constraint_set({name: getattr(self, name) for name in names}, self.constraints)

    @model_validator(mode="after")
    def _no_filter_yet(self) -> RTAGlueCWHInspection1v1:
        if self.enabled:
            raise ValueError(
                "`enabled: True` asks for the safety filter, which this version does not have; set it to False"
            )
        return self

    def names(self, parts: Parts) -> tuple[str, ...]:
        """Return the names of the wrapped glues' elements."""
        return tuple(name for glue in self.wrapped for name in glue.names(parts))

    def bounds(self, parts: Parts) -> Bounds:
        """Return the bounds of the wrapped glues' elements."""
        bounds = [glue.bounds(parts) for glue in self.wrapped]
        low, high = (np.concatenate([np.empty(0), *(bound[side] for bound in bounds)]) for side in (0, 1))
        return low, high

    def __call__(self, action: FloatArray, parts: Parts) -> FloatArray:
        """Return the thrust that the wrapped glues ask for [N], Hill frame, shape (R, 3)."""
        thrust = np.zeros((len(action), 3))
        first = 0
        for glue in self.wrapped:
            size = len(glue.names(parts))
            thrust += glue(action[:, first : first + size], parts)
            first += size
        return thrust

    def refusals(self, states: Mapping[str, FloatArray]) -> dict[str, BoolArray]:
        """Return for each constraint the rows that it refuses: not (h >= 0 and phi >= 0), NaN included, shape (R,)."""
        state = RelativeState(states["position"], states["velocity"], states["sun_angle"])
        evaluations = {name: constraint.evaluate(state) for name, constraint in self._constraints.items()}
        return {name: ~((value.h >= 0.0) & (value.phi >= 0.0)) for name, value in evaluations.items()}
