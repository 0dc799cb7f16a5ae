"""Filter with a safety guarantee for a team: one decision about the thrusts of all deputies of an environment."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from safe_inspect.dynamics.base import DisturbanceBounds
from safe_inspect.rta.backup.deviations import starting_tube, tube_of
from safe_inspect.rta.backup.model import FURTHER, PAIR_BIT, FilterModel, build_model
from safe_inspect.rta.backup.safety_filter import MEMORY, BackupFilter
from safe_inspect.rta.constraints.base import Constraint, RelativeState
from safe_inspect.rta.constraints.parameters import ConstraintParameters
from safe_inspect.rta.constraints.ranges import DEPUTY_RADIUS
from safe_inspect.rta.constraints.sets import COLLISION, NAMES, PSM, constraint_set, name_of
from safe_inspect.rta.filters import check_used, compiled
from safe_inspect.simulators.arrays import for_kernel
from safe_inspect.types import AnyArray, BoolArray, FloatArray, IntArray

#: Constraints of a pair, each with the constraint of a single deputy that applies with the other deputy as the chief.
PAIR_CONSTRAINTS = {"deputy_collision": "chief_collision", "deputy_PSM": "PSM"}


@dataclass(frozen=True, eq=False)
class TeamState:
    """Motion of the D deputies of N environments relative to the chief, and the sun angle.

    Attributes:
        position: Relative position [m], Hill frame, shape (N, D, 3).
        velocity: Relative velocity [m/s], Hill frame, shape (N, D, 3).
        sun_angle: Sun angle [rad], shape (N,).
        coasting: Deputies that coast unconditionally, shape (N, D); by default, none.

    Raises:
        ValueError: The shapes do not match, or a number is not finite.
    """

    position: FloatArray
    velocity: FloatArray
    sun_angle: FloatArray
    coasting: BoolArray | None = None

    def __post_init__(self) -> None:
        """Make the arrays contiguous and writable, as the compiled rows require, and check them."""
        for field in ("position", "velocity", "sun_angle"):
            object.__setattr__(self, field, for_kernel(getattr(self, field), np.float64))
        shape = self.position.shape[:2]
        coasting = np.zeros(shape, np.bool_) if self.coasting is None else self.coasting
        object.__setattr__(self, "coasting", for_kernel(coasting, np.bool_))
        if (
            self.position.ndim != 3 or self.position.shape[2] != 3 or shape[1] < 1
            or self.velocity.shape != self.position.shape or self.sun_angle.shape != shape[:1]
            or self.fixed.shape != shape
        ):  # fmt: skip
            raise ValueError(
                f"expected a team state with position and velocity (N, D, 3), sun_angle (N,) and coasting (N, D), "
                f"got {self.position.shape}, {self.velocity.shape}, {self.sun_angle.shape} and {self.fixed.shape}"
            )

    def __len__(self) -> int:
        return len(self.position)

    def __getitem__(self, rows: Any) -> TeamState:
        """Return the selected environments (a mask, a slice or an array of indices)."""
        return TeamState(self.position[rows], self.velocity[rows], self.sun_angle[rows], self.fixed[rows])

    @property
    def fixed(self) -> BoolArray:
        """Deputies that coast unconditionally, shape (N, D)."""
        assert self.coasting is not None
        return self.coasting

    @property
    def finite(self) -> BoolArray:
        """Environments in which every number is finite, shape (N,)."""
        finite = np.isfinite(self.position).all(axis=(1, 2)) & np.isfinite(self.velocity).all(axis=(1, 2))
        return np.asarray(finite & np.isfinite(self.sun_angle))

    def alone(self, deputy: int) -> RelativeState:
        """Return the motion of one deputy relative to the chief."""
        return RelativeState(self.position[:, deputy], self.velocity[:, deputy], self.sun_angle)

    def relative(self, deputy: int, other: int) -> RelativeState:
        """Return the motion of one deputy relative to another."""
        return RelativeState(
            self.position[:, deputy] - self.position[:, other], self.velocity[:, deputy] - self.velocity[:, other],
            self.sun_angle,
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class TeamResult:
    """Effect of the filter on the joint controls of N environments.

    Attributes:
        control: Thrusts to hold [N], Hill frame, shape (N, D, 3).
        infeasible: Environments without a joint backup plan, for which nothing is guaranteed, shape (N,).
        backup: Environments in which the backup determined the thrusts, shape (N,).
        active: Bits of the constraints that rejected a deputy's desired thrust, bit j for the j-th name, shape (N, D).
        plan: Joint plan of the next state, for the next call; zeros where there is none, shape (N, D).
        tracks: Plans that are tracked, for the next call, shape (N, D, 10); None without a disturbance.
    """

    control: FloatArray
    infeasible: BoolArray
    backup: BoolArray
    active: IntArray
    plan: IntArray
    tracks: FloatArray | None = None


class TeamFilter:
    """Filter that applies the nearest joint control that is safe over the whole hold and leaves a joint backup plan.

    A *joint plan* consists of a backup plan for each of the D deputies (see `BackupFilter`: one hold of thrust that
    leads to a closed natural motion that is safe permanently) such that every two deputies stay 2 r_d apart during the
    holds and over one orbit of the motions (r_d: `deputy_radius`). All closed motions have the period of the orbit, and
    so have the relative motions: checking one orbit is enough.

    The desired thrusts are applied if they pass the exact test: the hold is safe at every moment for each deputy and
    each pair, and the state after it has a joint plan. Otherwise, cutting planes search for the nearest thrusts that
    pass: each round linearises all constraints of deputies and pairs that the last proposal violates, and solves one
    quadratic programme over all 3 D thrusts. If no proposal passes, the search continues between the last proposal and
    the thrusts of the stored joint plan. The latter pass, because the last step was accepted with this plan.

    Plans are chosen for one deputy after another, at most D + 2 times, so the filter may miss an existing plan. It then
    intervenes more than necessary, but violates nothing, because the stored plan passes. If the memory is all zeros,
    there is no stored plan and the filter searches for one.

    A deputy that coasts (`TeamState.coasting`) is an obstacle: its own constraints are not enforced. In the first hold
    it applies its part of the stored joint plan, which leads to a closed motion, as the others assume; after that, or
    if there is no plan, its thrust is zero. The plans of the others avoid it during the hold and until it has drifted
    past, or for 4 orbits.

    Under a disturbance, the joint plan is stored and tracked, and everything is certified with the width of the tube
    about it, for pairs with the widths of both, as `BackupFilter` does for one deputy. Deputies that coast then
    continue to track their plans.

    If there is no joint plan, the environment is infeasible. Each deputy then applies a plan that is safe by itself and
    far from the others, or, if there is none, the return control of the single filter.

    Deputies are sorted by range, so permuting them gives the same permutation of the result, bit-identical except for
    ties. The result of an environment does not depend on the others of the batch.

    Attributes:
        names: The names of the constraints.
        alone: The single filter, whose constraints apply to each deputy.
        deputy_radius: Two deputies collide when their centres are closer than twice this distance [m].
    """

    def __init__(
        self,
        parameters: Mapping[str, Any] | ConstraintParameters | None = None,
        names: Iterable[str | Constraint] = (*NAMES, "deputy_collision"),
        deputy_radius: float = DEPUTY_RADIUS,
        disturbance: DisturbanceBounds | None = None,
    ) -> None:
        """Build the filter.

        Args:
            parameters: Parameters by name, as in safe-autonomy-sims; see `ConstraintParameters`.
            names: Constraints of the single filter and those of `PAIR_CONSTRAINTS`, by name or built.
            deputy_radius: Radius about each deputy [m], the default of constraints between deputies.
            disturbance: Bounds of each deputy's disturbances, as with `BackupFilter`; None: an exact model.

        Raises:
            ValueError: An argument is wrong, or a constraint is one that the filter cannot enforce.
        """
        entries = tuple(names)
        self.names = tuple(map(name_of, entries))
        self.deputy_radius = float(deputy_radius)
        own = [entry for entry in entries if name_of(entry) not in PAIR_CONSTRAINTS]
        self.alone = BackupFilter(parameters, own, disturbance=disturbance)
        p = self.alone.parameters
        between = [entry for entry in entries if name_of(entry) in PAIR_CONSTRAINTS]
        check_used(between)
        self.pair_constraints = constraint_set(p, between, self.deputy_radius)
        far, about = self.alone.limit("r_max", "r_max"), {}
        pair: Any
        for name, pair in self.pair_constraints.items():
            if pair.deputy_radius >= far:
                raise ValueError(f"the deputy_radius {pair.deputy_radius} m of {name} must be less than r_max, {far} m")
            about[PAIR_CONSTRAINTS[name]] = pair.about_other
        one, two = build_model(p, self.alone.constraints), build_model(p, about)
        self._models = self._starts = one, two
        if self.alone.tracker is not None:
            tube = tube_of(two, self.alone.tracker, about)
            starting = starting_tube(two, self.alone.tracker, tube, about)
            self._models = one._replace(tube=self.alone.tube), two._replace(tube=tube)
            self._starts = one._replace(tube=self.alone.starting), two._replace(tube=starting)
        self._pairs = bool(about)
        codes = {name: NAMES.index(name) for name in self.names if name in NAMES}
        codes |= {name: FURTHER + k for k, name in enumerate(name for name in self.alone.names if name not in NAMES)}
        codes |= {name: PAIR_BIT + (PAIR_CONSTRAINTS[name] == NAMES[PSM]) for name in self.pair_constraints}
        self._codes = {codes[name]: j for j, name in enumerate(self.names)}
        for narrow, wide in ((COLLISION, PSM), (PAIR_BIT, PAIR_BIT + 1)):
            if narrow not in self._codes and wide in self._codes:
                # A plan that comes too near then violates passive safety.
                self._codes[narrow] = self._codes[wide]

    def __call__(
        self, state: TeamState, desired: FloatArray, plan: AnyArray | None = None, tracks: FloatArray | None = None
    ) -> TeamResult:
        """Return the thrusts to apply.

        Args:
            state: The states of N environments.
            desired: Desired thrusts [N], Hill frame, shape (N, D, 3). Those of coasting deputies are ignored.
            plan: `TeamResult.plan` of the last step, or zeros, shape (N, D).
            tracks: `TeamResult.tracks` of the last step, or zeros, shape (N, D, 10); ignored without a disturbance.

        Raises:
            ValueError: The shapes differ, or a number is not finite.
        """
        shape = state.position.shape
        desired = _checked(state, desired)
        memory = np.zeros(shape[:2], np.int64) if plan is None else np.array(plan, np.int64, order="C")
        if memory.shape != shape[:2]:
            raise ValueError(f"the plans of {shape[0]} environments must have shape {shape[:2]}, got {memory.shape}")
        control, refused, stage = np.empty(shape), np.empty(shape[:2], np.int64), np.empty(shape[0], np.int64)
        gain, tracked = np.zeros((3, 6)), np.empty((0, 0, 0))
        if self.alone.tracker is not None:
            gain, tracked = self.alone.tracker.gain, np.zeros((*shape[:2], MEMORY))
            if tracks is not None:
                tracked[...] = tracks
        rows = compiled("team.rows")
        rows.filter_team_rows(
            self._model, (state.position, state.velocity, state.sun_angle), desired, state.fixed, memory,
            gain, tracked, control, refused, stage,
        )  # fmt: skip
        active: IntArray = np.zeros(shape[:2], np.int64)
        for code, j in self._codes.items():
            active |= (refused >> code & 1) << j
        return TeamResult(
            control, stage == rows.RETURN, stage == rows.BACKUP, active, memory, tracked if len(tracked) else None
        )  # fmt: skip

    def plans(self, state: TeamState) -> tuple[BoolArray, FloatArray, IntArray]:
        """Return the environments with a joint plan (N,), its thrusts [N] (N, D, 3) and its plan numbers (N, D)."""
        return self._find_plans(state, self._models)

    def recoverable(self, state: TeamState) -> BoolArray:
        """Return the environments that have a joint plan, from which the filter guarantees safety, shape (N,)."""
        return self._find_plans(state, self._starts)[0]

    def looks(self, state: TeamState) -> Iterator[tuple[str, Constraint, RelativeState]]:
        """Yield each constraint's name, the constraint, and a state to test: for each deputy and each pair."""
        count = state.position.shape[1]
        for i in range(count):
            alone = state.alone(i)
            yield from ((name, constraint, alone) for name, constraint in self.alone.constraints.items())
            for j in range(i + 1, count):
                relative = state.relative(i, j)
                yield from ((name, pair, relative) for name, pair in self.pair_constraints.items())

    def phi(self, state: TeamState) -> dict[str, FloatArray]:
        """Return each constraint's least safety quantity phi over the team, >= 0 where safe, shape (N,); see `looks`.

        A single deputy has no constraints of pairs. Deputies that coast count too.
        """
        least: dict[str, FloatArray] = {}
        for name, constraint, seen in self.looks(state):
            phi = constraint.phi(seen)
            least[name] = np.minimum(least[name], phi) if name in least else phi
        return {name: least[name] for name in self.names if name in least}

    @property
    def _model(self) -> Any:
        return self._built(self._models)

    def _built(self, models: tuple[FilterModel, FilterModel]) -> Any:
        one, pair = models
        return compiled("team.workspace").TeamModel(self.alone.further.into(one), pair, self._pairs)

    def _find_plans(
        self, state: TeamState, models: tuple[FilterModel, FilterModel]
    ) -> tuple[BoolArray, FloatArray, IntArray]:
        shape = state.position.shape
        out, control, memory = np.empty(len(state), np.bool_), np.zeros(shape), np.zeros(shape[:2], np.int64)
        compiled("team.rows").plan_team_rows(
            self._built(models), (state.position, state.velocity, state.sun_angle), state.fixed, control, memory, out
        )
        return out, control, memory


def _checked(state: TeamState, desired: FloatArray) -> FloatArray:
    """Return the desired thrusts as an array that the compiled rows accept, zero for deputies that coast."""
    desired = np.array(desired, dtype=np.float64, order="C")
    if desired.shape != state.position.shape:
        raise ValueError(f"desired thrusts must have the shape {state.position.shape}, got {desired.shape}")
    desired[state.fixed] = 0.0
    finite = state.finite & np.isfinite(desired).all(axis=(1, 2))
    if not finite.all():
        row = int(np.argmin(finite))
        what = "state" if not state.finite[row] else "desired thrusts"
        raise ValueError(f"the {what} of environment {row} contain a number that is not finite; check what computed it")
    return desired
