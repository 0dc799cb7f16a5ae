"""Safety glue of inspection by one deputy, which can also avoid other deputies."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cached_property
from typing import Literal

import numpy as np
from pydantic import model_validator

from safe_inspect.dynamics.base import DisturbanceBounds
from safe_inspect.errors import PluginValueError
from safe_inspect.rta.base import Filtered, SafetyGlue, seen_motion
from safe_inspect.rta.constraints import Constraint, RelativeState, constraint_set
from safe_inspect.rta.constraints.certified import NAMES
from safe_inspect.rta.constraints.parameters import ConstraintParameters, TaskParameters
from safe_inspect.rta.constraints.sets import ConstraintEntry, name_of
from safe_inspect.rta.filters import (
    BackupFilter,
    ContinuousFilter,
    DecentralisedFilter,
    SimplexFilter,
    SimplexMemory,
    TubeFilter,
)
from safe_inspect.rta.filters.backup.safety_filter import Intervention
from safe_inspect.rta.filters.probes import SAFE_DRAWS, safe_states
from safe_inspect.rta.filters.team.safety_filter import PAIR_CONSTRAINTS
from safe_inspect.rta.filters.tube.safety_filter import MEMORY
from safe_inspect.simulators.state import ArraySpec
from safe_inspect.simulators.view import SAFETY_FILTER, View
from safe_inspect.simulators.world import World
from safe_inspect.types import BoolArray, FloatArray
from safe_inspect.units import (
    PositiveLength,
    PositiveSpeed,
)


class RTAGlueCWHInspection1v1(TaskParameters, SafetyGlue):
    """Run-time assurance for one deputy that inspects a chief at the origin of Hill's frame.

    If there are several deputies, each filters its own thrust: it avoids the others if `constraints` says so, assuming
    that they coast. This does not separate two deputies that both apply thrust; `RTACWHInspectionTeam` does.

    Attributes:
        state_observation_names: Observations that the filter of safe-autonomy-sims reads; this filter reads the state
            itself.
        constraints: Names of constraints, or mappings ``{functor: NAME, config: {...}}``. ``deputy_collision`` enforces
            the distance from every other deputy, and ``deputy_PSM`` the distance during `psm_horizon` of coasting; both
            require the method ``backup``.
        deputy_radius: Two deputies collide when their centres are closer than twice this distance [m].
        method: ``backup`` enforces every constraint over the whole hold; ``continuous`` is the condition of
            safe-autonomy-sims on the derivative at the start of the hold, which does not; ``simplex`` switches to a
            backup controller.
        infeasible: What the method ``continuous`` applies if no thrust satisfies all conditions: ``least_violating``,
            or ``pass`` for the desired thrust, as safe-autonomy-sims does.
        intervention: What the method ``backup`` applies if the desired thrust is rejected: ``nearest``, a safe thrust
            near to it, or ``backup``, the backup plan, which leads to a closed motion within the constraints.
        delta_v_limit: Delta-v limit of an episode with the method ``simplex`` [m/s], guaranteed if the plan of its
            initial state satisfies it: when the rest is only enough for a plan, the plan is applied, and then the
            deputy coasts. None: no limit.
        recoverable: Whether `refusals` also rejects states without a backup plan.
        disturbance: Bounds of the disturbances under which the method ``backup`` enforces the constraints, for a single
            deputy; see `TubeFilter`. None: the motion is exactly that of the model.
    """

    state_observation_names: tuple[str, ...] = ()
    constraints: tuple[ConstraintEntry, ...] = NAMES
    deputy_radius: PositiveLength = 5.0
    method: Literal["backup", "continuous", "simplex"] = "backup"
    infeasible: Literal["least_violating", "pass"] = "least_violating"
    intervention: Intervention = "nearest"
    delta_v_limit: PositiveSpeed | None = None
    recoverable: bool = False
    disturbance: DisturbanceBounds | None = None

    @model_validator(mode="after")
    def _check_constraints(self) -> RTAGlueCWHInspection1v1:
        assert self._constraints is not None  # Reports wrong parameters now, not at the first step.
        pairs = tuple(map(name_of, self._pairs))
        if self.enabled and not self.constraints:
            raise ValueError("`constraints` is empty, so the filter enforces nothing; name some, or disable it")
        if len(pairs) != len(set(pairs)):
            raise ValueError(f"the constraints {list(map(name_of, self.constraints))} contain a duplicate; remove it")
        if pairs and self.method != "backup":
            raise ValueError(
                f"the method {self.method!r} does not enforce {pairs[0]!r}; use the method 'backup', or remove it"
            )
        what = f"the constraint {pairs[0]!r}" if pairs else f"the method {self.method!r}"
        if self.disturbance is not None and (pairs or self.method != "backup"):
            raise ValueError(f"{what} does not support `disturbance`; remove one of them")
        if self.intervention != "nearest" and (pairs or self.method != "backup"):
            raise ValueError(f"{what} does not support `intervention` {self.intervention!r}; remove one of them")
        if self._pairs and self.enabled:
            assert self._decentralised is not None
        if (self.enabled and self.method != "continuous") or self.recoverable:
            assert self.backup_filter is not None
        if self.enabled and self.method == "continuous":
            assert self._continuous is not None
        return self

    @cached_property
    def _given(self) -> ConstraintParameters:
        return ConstraintParameters.of({name: getattr(self, name) for name in TaskParameters.model_fields})

    @cached_property
    def _constraints(self) -> dict[str, Constraint]:
        return constraint_set(self._given, self._names)

    @property
    def kept(self) -> dict[str, Constraint]:
        """The constraints that the filter guarantees, by name; none with the method ``continuous``."""
        if self.method == "continuous":
            return {}
        return {**self._constraints, **constraint_set(self._given, self._pairs, self.deputy_radius)}

    @property
    def _names(self) -> tuple[str | Constraint, ...]:
        return tuple(entry for entry in self.constraints if name_of(entry) not in PAIR_CONSTRAINTS)

    @property
    def _pairs(self) -> tuple[str | Constraint, ...]:
        return tuple(entry for entry in self.constraints if name_of(entry) in PAIR_CONSTRAINTS)

    @cached_property
    def backup_filter(self) -> BackupFilter:
        """Filter of the method `backup`, with these parameters and constraints."""
        if self.disturbance is not None:
            return TubeFilter(self._given, self._names, self.disturbance, self.intervention)
        several = self.method != "simplex"  # The delta-v reserve of that method assumes plans of one hold.
        return BackupFilter(self._given, self._names, self.intervention, several)

    @cached_property
    def _decentralised(self) -> DecentralisedFilter:
        return DecentralisedFilter(self._given, self._names, self._pairs, self.deputy_radius)

    @cached_property
    def _continuous(self) -> ContinuousFilter:
        return ContinuousFilter(self._given, self._names, self.infeasible)

    @cached_property
    def _simplex(self) -> SimplexFilter:
        limit = math.inf if self.delta_v_limit is None else self.delta_v_limit
        return SimplexFilter(self._given, self._names, limit)

    def recoverable_share(self) -> tuple[int, float] | None:
        """Return the number of sampled safe states, and the share from which the filter guarantees the constraints.

        Return None if the thrusters can brake against the tide everywhere within `r_max`, or nothing is guaranteed.
        """
        if self.method == "continuous" or self._given.net_acceleration > 0.0:
            return None
        safe = safe_states(self._constraints, self._given, SAFE_DRAWS)
        return len(safe), float(self.backup_filter.recoverable(safe).mean()) if len(safe) else 0.0

    def refusals(self, states: Mapping[str, FloatArray]) -> dict[str, BoolArray]:
        """Return, for each constraint, the mask of rejected rows: not (h >= 0 and phi >= 0), NaN included, (R,)."""
        state = self._state(states["position"], states["velocity"], states.get("sun_angle"))
        evaluations = {name: constraint.evaluate(state) for name, constraint in self._constraints.items()}
        refused = {name: ~((value.h >= 0.0) & (value.phi >= 0.0)) for name, value in evaluations.items()}
        if self.recoverable:
            finite = np.isfinite(state.position).all(axis=1) & np.isfinite(state.velocity).all(axis=1)
            finite &= np.isfinite(state.sun_angle)
            refused["recoverable"] = ~finite
            refused["recoverable"][finite] = ~self.backup_filter.recoverable(state[finite])
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

    def filter(self, desired: FloatArray, view: View) -> Filtered:
        """Return the thrust to hold during the next step."""
        state = self._seen(view)
        if self.method == "continuous":
            return Filtered(self._continuous(state, desired))
        if self.method == "backup":
            if self._pairs and view.world.num_deputies > 1:
                return Filtered(self._decentralised(state, desired, view.others_position, view.others_velocity))
            if isinstance(self.backup_filter, TubeFilter):
                result, plan = self.backup_filter.track(state, desired, view.memory(SAFETY_FILTER, "plan"))
                return Filtered(result, {"plan": plan})
            return Filtered(self.backup_filter(state, desired))
        before = SimplexMemory(view.delta_v, view.memory(SAFETY_FILTER, "latched"))
        switched, after = self._simplex(state, desired, before)
        return Filtered(switched, {"latched": after.latched})

    def _seen(self, view: View) -> RelativeState:
        """Return the relative states of the deputies, estimated if there are estimates."""
        return self._state(*seen_motion(view), view.sun_angle if "sun_angle" in view.world.offers.view else None)

    def backup(self, view: View) -> FloatArray:
        """Return the thrust of the backup plan [N], Hill frame, shape (R, 3); zero if there is none."""
        if self.method == "continuous":
            return super().backup(view)
        run, state = self.backup_filter, self._seen(view)
        if isinstance(run, TubeFilter):
            return run.tracking(state, view.memory(SAFETY_FILTER, "plan"))
        return run.backups(state)[1]

    def memory(self, world: World) -> Mapping[str, ArraySpec]:
        """Declare whether the switching filter has latched its backup controller, or the plan that is tracked."""
        if self.disturbance is not None:
            return {"plan": ArraySpec((MEMORY,))}
        return {"latched": ArraySpec((), np.bool_)} if self.method == "simplex" else {}

    def for_starts(self) -> RTAGlueCWHInspection1v1:
        """Return the glue that also rejects initial states from which the filter could not guarantee safety."""
        return self if self.method == "continuous" else self.model_copy(update={"recoverable": True})
