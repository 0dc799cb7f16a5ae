"""Safety filter of inspection by a team: one decision about the thrusts of all deputies."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Any

import numpy as np
from pydantic import model_validator

from safe_inspect.dynamics.base import DisturbanceBounds
from safe_inspect.rta.constraints import Constraint, RelativeState
from safe_inspect.rta.constraints.certified import NAMES
from safe_inspect.rta.constraints.parameters import TaskParameters
from safe_inspect.rta.constraints.sets import ConstraintEntry
from safe_inspect.rta.filters import TeamFilter, TeamState
from safe_inspect.rta.filters.base import differs
from safe_inspect.rta.filters.probes import SAFE_DRAWS, safe_states
from safe_inspect.rta.filters.tube.safety_filter import MEMORY
from safe_inspect.rta.team import TeamFiltered, TeamSafety
from safe_inspect.simulators.state import ArraySpec
from safe_inspect.simulators.team import TeamView
from safe_inspect.simulators.world import World
from safe_inspect.types import AnyArray, BoolArray, FloatArray
from safe_inspect.units import (
    PositiveLength,
)


class RTACWHInspectionTeam(TaskParameters, TeamSafety):
    """Run-time assurance for a team that inspects a chief at the origin of Hill's frame; see `TeamFilter`.

    From initial states that `refusals` accepts, every constraint of every deputy and the distance between every two are
    enforced at every moment, whatever the desired thrusts, if the model is exact. A finished deputy applies the hold of
    its part of the joint plan and coasts from then on, on a closed motion, as the plans of the others assume.

    Attributes:
        deputy_radius: Two deputies collide when their centres are closer than twice this distance [m].
        constraints: Names of the constraints: those of the single filter, ``deputy_collision`` and ``deputy_PSM``.
        disturbance: Bounds of each deputy's disturbances under which all of this is enforced; None: an exact model.
    """

    deputy_radius: PositiveLength = 5.0
    constraints: tuple[ConstraintEntry, ...] = (*NAMES, "deputy_collision")
    disturbance: DisturbanceBounds | None = None

    @model_validator(mode="after")
    def _check(self) -> RTACWHInspectionTeam:
        if self.enabled:
            if not self.constraints:
                raise ValueError("`constraints` is empty, so the filter enforces nothing; name some, or disable it")
            assert self._filter is not None  # Reports wrong parameters now, not at the first step.
        return self

    @cached_property
    def _filter(self) -> TeamFilter:
        given = {name: getattr(self, name) for name in TaskParameters.model_fields}
        return TeamFilter(given, self.constraints, self.deputy_radius, self.disturbance)

    @property
    def kept(self) -> dict[str, Constraint]:
        """The constraints that the filter guarantees, by name."""
        return {**self._filter.alone.constraints, **self._filter.pair_constraints}

    def __call__(self, desired: FloatArray, team: TeamView) -> TeamFiltered:
        """Return the thrusts to hold during the next step; finished deputies complete their plan and coast.

        A deputy counts as changed if the filter changed its thrust by more than 0.01 N, but never if it is finished.
        """
        finished = np.asarray(team.finished != 0)
        estimated = "estimated_position" in team.world.offers.team
        position = team.estimated_position if estimated else team.position
        velocity = team.estimated_velocity if estimated else team.velocity
        state = TeamState(position, velocity, team.sun_angle, finished)
        tracks = None if self.disturbance is None else team.memory("tracks")
        result = self._filter(state, desired, team.memory("plan"), tracks)
        memory: dict[str, AnyArray] = {"plan": result.plan.astype(np.int8)}
        if result.tracks is not None:
            memory["tracks"] = result.tracks
        count, deputies = finished.shape
        changed = differs(result.control.reshape(-1, 3), np.asarray(desired, dtype=np.float64).reshape(-1, 3))
        return TeamFiltered(
            control=result.control,
            intervening=changed.reshape(count, deputies) & ~finished,
            infeasible=result.infeasible,
            backup=result.backup,
            memory=memory,
        )

    def recoverable_share(self) -> tuple[int, float] | None:
        """Return the number of sampled safe states of a deputy, and the share of them that have a backup plan.

        Return None if the thrusters can brake against the tide everywhere within `r_max`.
        """
        alone = self._filter.alone
        if alone.parameters.net_acceleration > 0.0:
            return None
        safe = safe_states(alone.constraints, alone.parameters, SAFE_DRAWS)
        state = TeamState(safe.position[:, None], safe.velocity[:, None], safe.sun_angle)
        return len(safe), float(self._filter.recoverable(state).mean()) if len(safe) else 0.0

    def refusals(self, states: Mapping[str, FloatArray]) -> dict[str, BoolArray]:
        """Return, for each constraint, the mask of the rejected environments, shape (R,).

        An environment is rejected if not (h >= 0 and phi >= 0), NaN included. ``recoverable`` rejects those for which
        no joint backup plan is found.
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
        """Return, for each constraint, the least phi of the team, (R,); for those of pairs only if there is a pair."""
        return self._filter.phi(TeamState(states["position"], states["velocity"], states["sun_angle"]))

    def memory(self, world: World) -> Mapping[str, ArraySpec]:
        """Declare the joint plan of the next state: for each deputy the number of its plan, from 1, or 0 for none.

        Under a disturbance, also declare the plans that are tracked.
        """
        tracks = {} if self.disturbance is None else {"tracks": ArraySpec((world.num_deputies, MEMORY))}
        return {"plan": ArraySpec((world.num_deputies,), np.int8), **tracks}

    def _looks(self, state: TeamState) -> list[tuple[str, Constraint, RelativeState]]:
        """Return each constraint's name, the constraint, and a state to test: for each deputy and each pair."""
        deputies = state.position.shape[1]
        alone: dict[str, Any] = self._filter.alone.constraints
        looks = [(name, constraint, state.alone(i)) for i in range(deputies) for name, constraint in alone.items()]
        return looks + [
            (name, pair, state.relative(i, j))
            for i in range(deputies)
            for j in range(i + 1, deputies)
            for name, pair in self._filter.pair_constraints.items()
        ]
