"""Filter with a safety guarantee: every control that it applies leaves a plan to remain safe permanently."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, Literal

import numpy as np

from safe_inspect.dynamics.base import DisturbanceBounds
from safe_inspect.rta.backup.deviations import PlanTracker, leaves_nothing, starting_tube, tube_of
from safe_inspect.rta.backup.model import FURTHER, NO_TUBE, PAIR_BIT, FilterModel, build_model, leading_holds
from safe_inspect.rta.constraints.base import Constraint, RelativeState
from safe_inspect.rta.constraints.parameters import ConstraintParameters
from safe_inspect.rta.constraints.ranges import ChiefCollision
from safe_inspect.rta.constraints.sets import COLLISION, NAMES, PSM, SUN
from safe_inspect.rta.filters import SafetyFilter, check_used, checked, compiled, differs
from safe_inspect.simulators.view import FilterResult
from safe_inspect.types import BoolArray, FloatArray, IntArray


class KernelTable:
    """Addresses of kernels and of their parameters, created when they are first needed in a process.

    Attributes:
        constraints: Constraints that define `Constraint.half_space`.
    """

    def __init__(self, constraints: Iterable[Constraint] = ()) -> None:
        """Store the constraints; nothing is compiled yet."""
        self.constraints = tuple(constraints)
        self._table: IntArray | None = None
        self._parameters: list[FloatArray] = []

    def __getstate__(self) -> dict[str, Any]:
        """Exclude the addresses from pickles, because they are valid in one process only."""
        return {**self.__dict__, "_table": None, "_parameters": []}

    def into(self, model: FilterModel) -> FilterModel:
        """Return a model with the constraints of this table, which must exist as long as the model.

        Raises:
            PluginValueError: A kernel does not compile.
        """
        if not self.constraints:
            return model
        if self._table is None:
            kernel = compiled("backup.half_spaces").kernel
            self._parameters = [np.array([*c.half_space_parameters(), 0.0]) for c in self.constraints]
            addresses = [kernel(type(constraint).half_space).address for constraint in self.constraints]
            self._table = np.array(
                [*zip(addresses, (numbers.ctypes.data for numbers in self._parameters), strict=True)], dtype=np.int64
            )
        return model._replace(further=len(self.constraints), kernels=self._table.ctypes.data)


#: Number of stored elements of a deputy: the state of the plan (6), its thrust (3), and 1 if there is a plan.
MEMORY = 10
#: A hold must not exceed this angle of the orbit [rad]; the bounds between grid points require it to be small.
_LARGEST_TURN = 0.5
#: What is applied if a desired control is rejected: a safe control near to it, or the backup plan.
Intervention = Literal["nearest", "backup"]
_MOST_FURTHER = PAIR_BIT - FURTHER


class BackupFilter(SafetyFilter):
    """Filter that applies the nearest control that is safe over the whole hold and leaves a backup plan after it.

    A *hold* is one step of constant thrust. A *backup plan* of a state is one hold of admissible thrust, safe at every
    moment, that leads to a closed natural motion (no drift, v_y = -2 n x) on which every constraint is satisfied for
    one orbit and therefore permanently, because the direction of the sun has the same period. A state with a plan of
    the family in `plans` is *recoverable*. The desired control is applied if the hold is safe at every moment and the
    state after it is recoverable. Otherwise, its projection onto the half-spaces of the convex constraints (speeds, the
    largest range) is applied, if it passes the same exact test: a safe control can be nearer only where the tangent
    half-space of `rel_vel` excludes it, by a few mN. If the projection does not pass, a pattern search leads from the
    thrust of the backup plan, which passes by induction, towards the desired control through controls that pass; see
    `search`. With the intervention `backup`, there is no such search, and the backup plan is applied for the step.

    In addition to the eight constraints of the inspection task, the filter enforces every constraint that defines
    `Constraint.half_space`.

    Under a disturbance, with states that are known with a bounded error and disturbed motions and thrusts, a desired
    control is applied if its hold, and a plan after it, satisfy every constraint for every disturbance within the
    bounds; the plan is then stored. In the next step it is the backup: the deputy tracks it with its thrust plus
    K (estimate - plan), instead of planning again, so no plan has to be found again. The real motion stays in a tube
    about the plan, whose width is known in advance; see `deviations`. Every constraint is certified for the motion of
    the model with that width as a margin, which grows with the thrusts whose errors it covers. Therefore, from an
    accepted initial state, every step ends in a state with a plan, permanently.

    "At every moment" is certified, not sampled: see `holds` and `closed_motion`, and for what the constraints
    contribute, `RowKernels`. Without a disturbance, the filter needs no memory: it finds the plan again from the state.
    Its guarantee is then for an exact model; the margins that every control must leave (1 mm, 0.01 mm/s, halved for a
    backup) absorb rounding, not disturbances.

    From a state without a plan, inside or outside the safe set, the filter applies a return control, ignores the
    desired control, and marks the row as infeasible. The return control is the smallest of the admissible controls that
    minimise the largest violation, in newtons, of these conditions on the state after the hold: speeds are within their
    limits, and each distance below 5 m (from the chief, the largest range, the sun cone) grows at half the allowed
    speed. See `return_control`.

    Attributes:
        codes: For each code of compiled rows, the index of the constraint in `names`.
        tracker: Controller that tracks the plans under a disturbance; None for an exact model.
        tube: Margins of the tube; see `FilterModel.tube`.
        starting: Margins for real initial states; see `starting_tube`.
    """

    def __init__(
        self,
        parameters: Mapping[str, Any] | ConstraintParameters | None = None,
        names: Iterable[str | Constraint] = NAMES,
        intervention: Intervention = "nearest",
        several_holds: bool = True,
        disturbance: DisturbanceBounds | None = None,
    ) -> None:
        """Build the filter; see `SafetyFilter` for the first arguments.

        Args:
            parameters: The task's parameters.
            names: The constraints.
            intervention: What is applied if the desired control is rejected: ``nearest``, a safe control near to it,
                or ``backup``, the backup plan, which leads to a closed motion.
            several_holds: Whether plans of weak thrusters may have several holds; their thrust is then the first one.
                Under a disturbance, they have one, because the tube is about a single hold.
            disturbance: Bounds of the disturbances; None: an exact model.

        Raises:
            ValueError: An argument is wrong, a constraint is neither one of the eight of the inspection task nor
                defines a half-space, or sets a field of `Constraint.uncertified`, the hold is too large a part of
                the orbit, or the bounds leave no state from which the constraints can be guaranteed.
        """
        entries = tuple(names)
        super().__init__(parameters, entries)
        check_used(entries)
        self.intervention = intervention
        codes: dict[int, int] = {}
        further: list[Constraint] = []
        for j, (name, constraint) in enumerate(self.constraints.items()):
            if constraint.registered_name in NAMES:
                codes[NAMES.index(constraint.registered_name)] = j
            elif type(constraint).half_space is not None:
                codes[FURTHER + len(further)] = j
                further.append(constraint)
            else:
                raise ValueError(
                    f"the backup filter cannot enforce {name!r} of `constraints`, which does not define `half_space`; "
                    "define it (docs/safety.md#a-constraint-of-your-own) or use `method: continuous`, which needs "
                    "`evaluate`"
                )
        if len(further) > _MOST_FURTHER:
            raise ValueError(
                f"the backup filter supports at most {_MOST_FURTHER} constraints in addition to {', '.join(NAMES)}; "
                "remove some"
            )
        if self.parameters.n * self.parameters.step_size > _LARGEST_TURN:
            raise ValueError(
                f"a hold of {self.parameters.step_size} s is too long a part of the orbit: "
                f"n step_size must be at most {_LARGEST_TURN} rad"
            )
        kept = dict(self.constraints)
        # A plan that comes too near violates these constraints, so the collision radius is enforced with them.
        for other in (PSM, SUN):
            if COLLISION not in codes and other in codes:
                codes[COLLISION] = codes[other]
                kept[NAMES[COLLISION]] = ChiefCollision.from_parameters(self.parameters)
        self.codes = codes
        self.further = KernelTable(further)
        self._tables = build_model(self.parameters, kept)
        self.tracker: PlanTracker | None = None
        self.tube = self.starting = NO_TUBE
        if disturbance is not None:
            self._track_within(disturbance)
        elif several_holds:
            self._tables = self._tables._replace(leads=leading_holds(self.parameters))

    def _track_within(self, bounds: DisturbanceBounds) -> None:
        """Compute the tracker and the tubes for bounds of the disturbances.

        Raises:
            ValueError: They leave nothing.
        """
        tracker = self.tracker = PlanTracker(self.parameters, bounds)
        lost = None if tracker.settles else "to enforce: a plan cannot be tracked with such errors of the thrust"
        if lost is None:
            self.tube = tube_of(self._tables, tracker, self.constraints)
            lost = leaves_nothing(self.tube, self.parameters, self.constraints)
        if lost is not None:
            raise ValueError(f"the bounds of `disturbance` leave nothing {lost}; lower them")
        self.starting = starting_tube(self._tables, tracker, self.tube, self.constraints)
        self._tables = self._tables._replace(tube=self.tube)

    @property
    def _model(self) -> FilterModel:
        """Numbers and tables of the task, with the further constraints."""
        return self.further.into(self._tables)

    def __call__(self, state: RelativeState, desired: FloatArray) -> FilterResult:
        """Return the controls to apply; see `SafetyFilter`. Under a disturbance, in the first step of episodes."""
        return self.track(state, desired)[0]

    @staticmethod
    def memory(rows: int) -> FloatArray:
        """Return the memory at the start of R episodes, which contains no plan, shape (R, 10)."""
        return np.zeros((rows, MEMORY))

    def track(
        self, state: RelativeState, desired: FloatArray, memory: FloatArray | None = None
    ) -> tuple[FilterResult, FloatArray]:
        """Return the controls to apply, and the memory after the step; `memory` itself is not changed.

        Args:
            state: Estimates of the states of R deputies.
            desired: Desired controls [N], Hill frame, shape (R, 3).
            memory: Memory after the last step, shape (R, 10); by default, that at the start of episodes. It is not used
                without a disturbance.

        Raises:
            ValueError: The shapes differ, or a number is not finite; the message names the first such row.
        """
        desired = checked(state, desired)
        gain, plans = np.zeros((3, 6)), np.empty((0, 0))
        if self.tracker is not None:
            gain = self.tracker.gain
            plans = self.memory(len(state)) if memory is None else np.array(memory, dtype=np.float64, order="C")
        count = len(state)
        control, refused, stage = np.empty((count, 3)), np.empty(count, np.int64), np.empty(count, np.int64)
        rows = compiled("backup.rows")
        rows.filter_rows(
            self._model, state.position, state.velocity, state.sun_angle, desired,
            self.intervention == "nearest", gain, plans, control, refused, stage,
        )  # fmt: skip
        result = FilterResult(
            control=control,
            intervening=differs(control, desired),
            infeasible=stage == rows.RETURN,
            backup=stage == rows.BACKUP,
            active=self.active(refused, self.codes),
            phi=self.phi(state),
            names=self.names,
            memory={} if self.tracker is None else {"plan": plans},
        )
        return result, plans

    def recoverable(self, state: RelativeState) -> BoolArray:
        """Return the rows from which the filter guarantees safety, for every estimate within the bounds, shape (R,).

        Args:
            state: Real initial states.
        """
        return self.plans(state, tube=self.starting)[0]

    def plans(
        self, state: RelativeState, share: float = 1.0, tube: FloatArray | None = None
    ) -> tuple[BoolArray, FloatArray]:  # fmt: skip
        """Return the rows that have a backup plan, shape (R,), and its thrust [N], shape (R, 3); zero if there is none.

        Args:
            state: The states.
            share: Share of the margins that the plans must leave; half is enough if a plan was found one step before.
            tube: Margins of a tube, see `FilterModel.tube`; by default, those of the filter.
        """
        checked(state, np.zeros((len(state), 3)))
        found, control = np.empty(len(state), np.bool_), np.empty((len(state), 3))
        model = self._model if tube is None else self._model._replace(tube=tube)
        compiled("backup.rows").recoverable_rows(
            model, state.position, state.velocity, state.sun_angle, share, found, control
        )  # fmt: skip
        return found, control
