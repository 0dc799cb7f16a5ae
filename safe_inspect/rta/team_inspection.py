"""The safety filter of inspection by a team: one decision over the thrusts of all deputies."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cached_property
from typing import Any

import numpy as np
from pydantic import Field, model_validator

from safe_inspect.rta.constraints import Constraint, RelativeState
from safe_inspect.rta.constraints.sets import NAMES, ConstraintEntry
from safe_inspect.rta.filters import TeamFilter, TeamState
from safe_inspect.rta.filters.base import differs
from safe_inspect.rta.team import TeamFiltered, TeamSafety
from safe_inspect.simulators.state import ArraySpec
from safe_inspect.simulators.team import TeamView
from safe_inspect.simulators.world import World
from safe_inspect.types import BoolArray, FloatArray
from safe_inspect.units import (
    Angle,
    NonNegativeSpeed,
    PositiveAngularRate,
    PositiveDuration,
    PositiveForce,
    PositiveLength,
    PositiveMass,
    PositiveSpeed,
)

#: Fields that are the constraints' and the filter's parameters, by their names there.
_PARAMETERS = (
    "step_size", "collision_radius", "v0", "v0_distance", "v1_coef", "n", "r_max", "u_max", "m", "fov", "vel_limit",
    "psm_horizon",
)  # fmt: skip


class RTACWHInspectionTeam(TeamSafety):
    """Run-time assurance of a team that inspects a chief at the origin of Hill's frame; see `TeamFilter`.

    From initial states that `refusals` accepts, every constraint of every deputy and the distance of every two are kept
    at every moment, whatever is desired, for an exact model and as long as no deputy is finished. A finished deputy
    coasts and its own constraints are not kept. The others keep away from its coasting motion, where they still can: it
    leaves them no time to prepare, and may leave them infeasible.

    Attributes:
        step_size: Length of a step [s].
        collision_radius: Smallest range to the chief [m].
        v0: Speed limit at the range `v0_distance` [m/s].
        v0_distance: Range at which the speed limit is `v0` [m].
        v1_coef: Slope of the speed limit over range, in units of `n` [-].
        n: Mean motion [rad/s].
        r_max: Largest range [m].
        u_max: Largest thrust along each axis [N].
        m: Mass of each deputy [kg].
        fov: Full angle of the camera's cone, and so of the sun's keep-out cone [rad].
        vel_limit: Largest speed along each axis [m/s].
        psm_horizon: How long a coasting deputy must stay clear of the chief, and with ``deputy_PSM`` of the others [s].
        deputy_radius: Two deputies collide when their centres are closer than twice this [m].
        constraints: Names of the constraints, those of the single filter and ``deputy_collision``, ``deputy_PSM``.
    """

    step_size: PositiveDuration = 10.0
    collision_radius: PositiveLength = 10.0
    v0: NonNegativeSpeed = 0.2
    v0_distance: PositiveLength = 10.0
    v1_coef: float = Field(default=2.0, ge=0)
    n: PositiveAngularRate = 0.001027
    r_max: PositiveLength = 800.0
    u_max: PositiveForce = 1.0
    m: PositiveMass = 12.0
    fov: Angle = math.pi / 3
    vel_limit: PositiveSpeed = 1.0
    psm_horizon: PositiveDuration = 100.0
    deputy_radius: PositiveLength = 5.0
    constraints: tuple[ConstraintEntry, ...] = (*NAMES, "deputy_collision")

    @model_validator(mode="after")
    def _check(self) -> RTACWHInspectionTeam:
        assert self._filter is not None  # wrong parameters are found now, not at the first step
        return self

    @cached_property
    def _filter(self) -> TeamFilter:
        given = {name: getattr(self, name) for name in _PARAMETERS}
        return TeamFilter(given, self.constraints, self.deputy_radius)

    def __call__(self, desired: FloatArray, team: TeamView) -> TeamFiltered:
        """Return the thrusts to hold in the next step; those of finished deputies are zero.

        A deputy counts as changed where the filter moved its thrust by more than 0.01 N, never when it is finished.
        """
        finished = np.asarray(team.finished != 0)
        state = TeamState(team.position, team.velocity, team.sun_angle, finished)
        result = self._filter(state, desired, team.memory("plan"))
        count, deputies = finished.shape
        changed = differs(result.control.reshape(-1, 3), np.asarray(desired, dtype=np.float64).reshape(-1, 3))
        return TeamFiltered(
            control=result.control,
            intervening=changed.reshape(count, deputies) & ~finished,
            infeasible=result.infeasible,
            backup=result.backup,
            memory={"plan": result.plan.astype(np.int8)},
        )

    def refusals(self, states: Mapping[str, FloatArray]) -> dict[str, BoolArray]:
        """Return for each constraint the environments that it refuses: not (h >= 0 and phi >= 0), NaN included, (R,).

        ``recoverable`` refuses those from which no joint backup plan is found.
        """
        state = TeamState(states["position"], states["velocity"], states["sun_angle"])
        refused = {name: np.zeros(len(state), np.bool_) for name in self._filter.names}
        for name, constraint, relative in self._looks(state):
            value = constraint.evaluate(relative)
            refused[name] |= ~((value.h >= 0.0) & (value.phi >= 0.0))
        refused["recoverable"] = ~state.finite
        refused["recoverable"][state.finite] = ~self._filter.recoverable(state[state.finite])
        return refused

    def safety(self, states: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
        """Return each constraint's least phi over the team, (R,); those of pairs only where there is a pair."""
        return self._filter.phi(TeamState(states["position"], states["velocity"], states["sun_angle"]))

    def memory(self, world: World) -> Mapping[str, ArraySpec]:
        """Declare the joint plan of the state to come: each deputy's plan, counted from 1; 0 for none."""
        return {"plan": ArraySpec((world.num_deputies,), np.int8)}

    def _looks(self, state: TeamState) -> list[tuple[str, Constraint, RelativeState]]:
        """Return what each constraint looks at: each deputy about the chief, or about each other one."""
        deputies = state.position.shape[1]
        alone: dict[str, Any] = self._filter.alone.constraints
        looks = [(name, constraint, state.alone(i)) for i in range(deputies) for name, constraint in alone.items()]
        return looks + [
            (name, pair, state.relative(i, j))
            for i in range(deputies)
            for j in range(i + 1, deputies)
            for name, pair in self._filter.pair_constraints.items()
        ]
