"""Safety glue of inspection by one deputy, and safety filter of a team."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cached_property
from typing import Literal

import numpy as np
from pydantic import model_validator

from safe_inspect.dynamics.base import DisturbanceBounds
from safe_inspect.errors import PluginValueError
from safe_inspect.rta.backup.safety_filter import MEMORY, BackupFilter, Intervention
from safe_inspect.rta.base import SafetyGlue, TeamFiltered, TeamSafety, seen_motion
from safe_inspect.rta.constraints import Constraint, RelativeState, constraint_set
from safe_inspect.rta.constraints.parameters import TaskParameters
from safe_inspect.rta.constraints.sets import NAMES, ConstraintEntry
from safe_inspect.rta.continuous import ContinuousFilter
from safe_inspect.rta.filters import SAFE_DRAWS, SafetyFilter, safe_states
from safe_inspect.rta.team.safety_filter import TeamFilter, TeamState
from safe_inspect.simulators.state import ArraySpec
from safe_inspect.simulators.team import TeamView
from safe_inspect.simulators.view import SAFETY_FILTER, FilterResult, View
from safe_inspect.simulators.world import World
from safe_inspect.types import BoolArray, FloatArray
from safe_inspect.units import PositiveLength


class RTAGlueCWHInspection1v1(TaskParameters, SafetyGlue):
    """Run-time assurance for one deputy that inspects a chief at the origin of Hill's frame.

    If there are several deputies, each filters its own thrust, regardless of the others; `RTACWHInspectionTeam` also
    keeps them apart.

    Attributes:
        state_observation_names: Observations that the filter of safe-autonomy-sims reads; this filter reads the state
            itself.
        constraints: Names of constraints, or mappings ``{functor: NAME, config: {...}}``.
        method: ``backup`` enforces every constraint over the whole hold; ``continuous`` is the condition of
            safe-autonomy-sims on the derivative at the start of the hold, which does not.
        infeasible: What the method ``continuous`` applies if no thrust satisfies all conditions: ``least_violating``,
            or ``pass`` for the desired thrust, as safe-autonomy-sims does.
        intervention: What the method ``backup`` applies if the desired thrust is rejected: ``nearest``, a safe thrust
            near to it, or ``backup``, the backup plan, which leads to a closed motion within the constraints.
        recoverable: Whether `refusals` also rejects states without a backup plan.
        disturbance: Bounds of the disturbances under which the method ``backup`` enforces the constraints, for a single
            deputy; see `BackupFilter`. None: the motion is exactly that of the model.
    """

    state_observation_names: tuple[str, ...] = ()
    constraints: tuple[ConstraintEntry, ...] = NAMES
    method: Literal["backup", "continuous"] = "backup"
    infeasible: Literal["least_violating", "pass"] = "least_violating"
    intervention: Intervention = "nearest"
    recoverable: bool = False
    disturbance: DisturbanceBounds | None = None

    @model_validator(mode="after")
    def _check_constraints(self) -> RTAGlueCWHInspection1v1:
        for name, constraint in self._constraints.items():  # Reports wrong parameters now, not at the first step.
            if constraint.pair:
                raise ValueError(f"{name!r} is about two deputies; remove it, and use the team's RTACWHInspectionTeam")
        if self.enabled and not self.constraints:
            raise ValueError("`constraints` is empty, so the filter enforces nothing; name some, or disable it")
        if self.disturbance is not None and self.method != "backup":
            raise ValueError(f"the method {self.method!r} does not support `disturbance`; remove one of them")
        if self.intervention != "nearest" and self.method != "backup":
            raise ValueError(
                f"the method {self.method!r} does not support `intervention` {self.intervention!r}; remove one of them"
            )
        if (self.enabled and self.method != "continuous") or self.recoverable:
            assert self.backup_filter is not None
        if self.enabled and self.method == "continuous":
            assert self._continuous is not None
        return self

    @cached_property
    def _constraints(self) -> dict[str, Constraint]:
        return constraint_set(self.agreeing, self.constraints)

    @property
    def kept(self) -> dict[str, Constraint]:
        """The constraints that the filter guarantees, by name; none with the method ``continuous``."""
        return {} if self.method == "continuous" else self._constraints

    @cached_property
    def backup_filter(self) -> BackupFilter:
        """Filter of the method `backup`, with these parameters and constraints."""
        return BackupFilter(self.agreeing, self.constraints, self.intervention, disturbance=self.disturbance)

    @cached_property
    def _continuous(self) -> ContinuousFilter:
        return ContinuousFilter(self.agreeing, self.constraints, self.infeasible)

    def recoverable_share(self) -> tuple[int, float] | None:
        """Return the number of sampled safe states, and the share from which the filter guarantees the constraints.

        Return None if the thrusters can brake against the tide everywhere within `r_max`, or nothing is guaranteed.
        """
        return None if self.method == "continuous" else _share(self.backup_filter, self.backup_filter.recoverable)

    def refusals(self, states: Mapping[str, FloatArray]) -> dict[str, BoolArray]:
        """Return, for each constraint, the mask of rejected rows: not (h >= 0 and phi >= 0), NaN included, (R,)."""
        state = self._state(states["position"], states["velocity"], states.get("sun_angle"))
        refused = SafetyFilter.refusals((name, constraint, state) for name, constraint in self._constraints.items())
        if self.recoverable:
            refused["recoverable"] = state.unless(self.backup_filter.recoverable)
        return refused

    def safety(self, states: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
        """Return, for each constraint, phi, >= 0 where the state is safe, shape (R,)."""
        state = self._state(states["position"], states["velocity"], states.get("sun_angle"))
        return {name: constraint.phi(state) for name, constraint in self._constraints.items()}

    def _state(self, position: FloatArray, velocity: FloatArray, sun_angle: FloatArray | None) -> RelativeState:
        """Return a relative state; in a task without a sun, its angle is 0, which no constraint then uses.

        Raises:
            PluginValueError: The constraint `sun` is given in a task without a sun.
        """
        if sun_angle is None:
            if "sun" in self._constraints:
                raise PluginValueError(f"{self.registered_name} enforces `sun`, but the task has no sun; remove it")
            sun_angle = np.zeros(len(position))
        return RelativeState(position, velocity, sun_angle)

    @property
    def units(self) -> dict[str, str]:
        """Unit of each constraint's phi."""
        return {name: constraint.unit for name, constraint in self._constraints.items()}

    def filter(self, desired: FloatArray, view: View) -> FilterResult:
        """Return the thrust to hold during the next step."""
        offered = view.world.offers.view
        state = self._state(*seen_motion(view, offered), view.sun_angle if "sun_angle" in offered else None)
        if self.method == "continuous":
            return self._continuous(state, desired)
        plan = None if self.disturbance is None else view.memory(SAFETY_FILTER, "plan")
        return self.backup_filter.track(state, desired, plan)[0]

    def memory(self, world: World) -> Mapping[str, ArraySpec]:
        """Declare the plan that is tracked under a disturbance."""
        return {} if self.disturbance is None else {"plan": ArraySpec((MEMORY,))}

    def for_starts(self) -> RTAGlueCWHInspection1v1:
        """Return the glue that also rejects initial states from which the filter could not guarantee safety."""
        return self if self.method == "continuous" else self.model_copy(update={"recoverable": True})


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
        return TeamFilter(self.agreeing, self.constraints, self.deputy_radius, self.disturbance)

    @property
    def kept(self) -> dict[str, Constraint]:
        """The constraints that the filter guarantees, by name."""
        return {**self._filter.alone.constraints, **self._filter.pair_constraints}

    def __call__(self, desired: FloatArray, team: TeamView) -> TeamFiltered:
        """Return the thrusts to hold during the next step; finished deputies complete their plan and coast.

        A deputy counts as changed if the filter changed its thrust by more than 0.01 N, but never if it is finished.
        """
        finished = np.asarray(team.finished != 0)
        state = TeamState(*seen_motion(team, team.world.offers.team), team.sun_angle, finished)
        tracks = None if self.disturbance is None else team.memory("tracks")
        return self._filter(state, desired, team.memory("plan"), tracks)

    def recoverable_share(self) -> tuple[int, float] | None:
        """Return the number of sampled safe states of a deputy, and the share of them that have a backup plan.

        Return None if the thrusters can brake against the tide everywhere within `r_max`.
        """

        def recoverable(safe: RelativeState) -> BoolArray:
            return self._filter.recoverable(TeamState(safe.position[:, None], safe.velocity[:, None], safe.sun_angle))

        return _share(self._filter.alone, recoverable)

    def refusals(self, states: Mapping[str, FloatArray]) -> dict[str, BoolArray]:
        """Return, for each constraint, the mask of the rejected environments, shape (R,).

        An environment is rejected if not (h >= 0 and phi >= 0), NaN included. ``recoverable`` rejects those for which
        no joint backup plan is found.
        """
        state = TeamState(states["position"], states["velocity"], states["sun_angle"])
        refused = {name: np.zeros(len(state), np.bool_) for name in self._filter.names}
        refused |= SafetyFilter.refusals(self._filter.looks(state))
        return refused | {"recoverable": state.unless(self._filter.recoverable)}

    def safety(self, states: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
        """Return, for each constraint, the least phi of the team, (R,); for those of pairs only if there is a pair."""
        return self._filter.phi(TeamState(states["position"], states["velocity"], states["sun_angle"]))

    def memory(self, world: World) -> Mapping[str, ArraySpec]:
        """Declare the joint plan of the next state: for each deputy the number of its plan, from 1, or 0 for none.

        Under a disturbance, also declare the plans that are tracked.
        """
        tracks = {} if self.disturbance is None else {"tracks": ArraySpec((world.num_deputies, MEMORY))}
        return {"plan": ArraySpec((world.num_deputies,), np.int8), **tracks}


def _share(alone: BackupFilter, recoverable: Callable[[RelativeState], BoolArray]) -> tuple[int, float] | None:
    """Return the number of sampled safe states, and the share of them that are recoverable.

    Return None if the thrusters can brake against the tide everywhere within `r_max`.
    """
    if alone.parameters.net_acceleration > 0.0:
        return None
    safe = safe_states(alone.constraints, alone.parameters, SAFE_DRAWS)
    return len(safe), float(recoverable(safe).mean()) if len(safe) else 0.0
