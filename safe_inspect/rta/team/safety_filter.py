"""Filter with a safety guarantee for a team: one decision about the thrusts of all deputies of an environment."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from safe_inspect.dynamics.base import DisturbanceBounds
from safe_inspect.rta.backup.deviations import starting_tube, tube_of
from safe_inspect.rta.backup.model import PAIR_BIT, build_model
from safe_inspect.rta.backup.safety_filter import MEMORY, BackupFilter
from safe_inspect.rta.base import TeamFiltered
from safe_inspect.rta.constraints.base import Constraint, MotionBatch, RelativeState
from safe_inspect.rta.constraints.parameters import ConstraintParameters
from safe_inspect.rta.constraints.ranges import DEPUTY_RADIUS, PairConstraint
from safe_inspect.rta.constraints.sets import COLLISION, NAMES, PSM, constraint_set
from safe_inspect.rta.filters import check_used, checked, compiled, differs
from safe_inspect.rta.team.workspace import TeamModel
from safe_inspect.simulators.arrays import for_kernel
from safe_inspect.types import AnyArray, BoolArray, FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class TeamState(MotionBatch):
    """Motion of the D deputies of N environments relative to the chief, and the sun angle.

    Attributes:
        position: Relative position [m], Hill frame, shape (N, D, 3).
        velocity: Relative velocity [m/s], Hill frame, shape (N, D, 3).
        sun_angle: Sun angle [rad], shape (N,).
        coasting: Deputies that coast unconditionally, shape (N, D); by default, none.

    Raises:
        ValueError: The shapes do not match, or a number is not finite.
    """

    row: ClassVar[str] = "environment"

    coasting: BoolArray | None = None

    def __post_init__(self) -> None:
        """Make the arrays contiguous and writable, and check their shapes."""
        super().__post_init__()
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

    @property
    def fixed(self) -> BoolArray:
        """Deputies that coast unconditionally, shape (N, D)."""
        assert self.coasting is not None
        return self.coasting

    def alone(self, deputy: int) -> RelativeState:
        """Return the motion of one deputy relative to the chief."""
        return RelativeState(self.position[:, deputy], self.velocity[:, deputy], self.sun_angle)

    def relative(self, deputy: int, other: int) -> RelativeState:
        """Return the motion of one deputy relative to another."""
        return RelativeState(
            self.position[:, deputy] - self.position[:, other], self.velocity[:, deputy] - self.velocity[:, other],
            self.sun_angle,
        )  # fmt: skip


@dataclass(frozen=True, eq=False, kw_only=True)
class _TeamResult(TeamFiltered):
    """Effect of the filter on the joint controls of N environments; see `TeamFiltered`.

    Attributes:
        active: Bits of the constraints that rejected a deputy's desired thrust, bit j for the j-th name, shape (N, D).
    """

    active: IntArray

    @property
    def plan(self) -> AnyArray:
        """Joint plan of the next state, for the next call; zeros where there is none, shape (N, D)."""
        return self.memory["plan"]

    @property
    def tracks(self) -> FloatArray | None:
        """Plans that are tracked, for the next call, shape (N, D, 10); None without a disturbance."""
        return self.memory.get("tracks")


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
            names: Constraints of the single filter and `PairConstraint`s, by name or built.
            deputy_radius: Radius about each deputy [m], the default of constraints between deputies.
            disturbance: Bounds of each deputy's disturbances, as with `BackupFilter`; None: an exact model.

        Raises:
            ValueError: An argument is wrong, or a constraint is one that the filter cannot enforce.
        """
        entries, p = tuple(names), ConstraintParameters.of({} if parameters is None else parameters)
        self.deputy_radius = float(deputy_radius)
        built = constraint_set(p, entries, self.deputy_radius)
        check_used(entries)
        self.names = tuple(built)
        self.pair_constraints = {name: one for name, one in built.items() if isinstance(one, PairConstraint)}
        own = [entry for entry, name in zip(entries, built, strict=True) if name not in self.pair_constraints]
        self.alone = BackupFilter(p, own, disturbance=disturbance)
        far = self.alone.limit("r_max", "r_max")
        about: dict[str, Constraint] = {}
        between: dict[str, str] = {}
        for name, pair in self.pair_constraints.items():
            if pair.deputy_radius >= far:
                raise ValueError(f"the deputy_radius {pair.deputy_radius} m of {name} must be less than r_max, {far} m")
            other = pair.about_other.registered_name
            if other not in (NAMES[COLLISION], NAMES[PSM]) or other in about:
                raise ValueError(
                    f"the team's filter cannot enforce {name!r}, whose `about_other` is a constraint {other!r}: it "
                    f"takes one {NAMES[COLLISION]!r} and one {NAMES[PSM]!r}; remove it"
                )
            about[other], between[other] = pair.about_other, name
        one, two = build_model(p, self.alone.constraints), build_model(p, about)
        self._tables = self._starts = TeamModel(one, two, bool(about))
        if self.alone.tracker is not None:
            tube = tube_of(two, self.alone.tracker, about)
            starting = starting_tube(two, self.alone.tracker, tube, about)
            self._tables = TeamModel(one._replace(tube=self.alone.tube), two._replace(tube=tube), bool(about))
            self._starts = TeamModel(one._replace(tube=self.alone.starting), two._replace(tube=starting), bool(about))
        codes = {code: self.alone.names[j] for code, j in self.alone.codes.items()}
        # Without a constraint on the distance now, a plan that comes too near violates passive safety.
        for bit, code in ((PAIR_BIT, PSM), (PAIR_BIT + 1, PSM), (PAIR_BIT, COLLISION)):
            if NAMES[code] in between:
                codes[bit] = between[NAMES[code]]
        self._codes = {code: self.names.index(name) for code, name in codes.items()}

    def __call__(
        self, state: TeamState, desired: FloatArray, plan: AnyArray | None = None, tracks: FloatArray | None = None
    ) -> _TeamResult:
        """Return the thrusts to apply.

        Args:
            state: The states of N environments.
            desired: Desired thrusts [N], Hill frame, shape (N, D, 3). Those of coasting deputies are ignored.
            plan: `_TeamResult.plan` of the last step, or zeros, shape (N, D).
            tracks: `_TeamResult.tracks` of the last step, or zeros, shape (N, D, 10); ignored without a disturbance.

        Raises:
            ValueError: The shapes differ, or a number is not finite.
        """
        shape = state.position.shape
        desired = checked(state, desired, state.fixed)
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
        return _TeamResult(
            control=control,
            intervening=differs(control, desired) & ~state.fixed,
            infeasible=stage == rows.RETURN,
            backup=stage == rows.BACKUP,
            active=self.alone.active(refused, self._codes),
            memory={"plan": memory} | ({} if self.alone.tracker is None else {"tracks": tracked}),
        )

    def plans(
        self, state: TeamState, tables: TeamModel | None = None
    ) -> tuple[BoolArray, FloatArray, IntArray]:  # fmt: skip
        """Return the environments with a joint plan (N,), its thrusts [N] (N, D, 3) and its plan numbers (N, D).

        Args:
            state: The states.
            tables: Numbers and tables of the task; by default, those of the filter.
        """
        shape = state.position.shape
        out, control, memory = np.empty(len(state), np.bool_), np.zeros(shape), np.zeros(shape[:2], np.int64)
        compiled("team.rows").plan_team_rows(
            self._model if tables is None else self._with_further(tables),
            (state.position, state.velocity, state.sun_angle), state.fixed, control, memory, out,
        )  # fmt: skip
        return out, control, memory

    def recoverable(self, state: TeamState) -> BoolArray:
        """Return the environments that have a joint plan, from which the filter guarantees safety, shape (N,)."""
        return self.plans(state, self._starts)[0]

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
    def _model(self) -> TeamModel:
        """Numbers and tables of the task, with the further constraints."""
        return self._with_further(self._tables)

    def _with_further(self, model: TeamModel) -> TeamModel:
        return model._replace(one=self.alone.further.into(model.one))
