"""Filter with a safety guarantee: every control that it applies leaves a plan to remain safe permanently."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, Literal

import numpy as np

from safe_inspect.rta.constraints.base import Constraint, RelativeState
from safe_inspect.rta.constraints.certified import COLLISION, NAMES, PSM, SUN
from safe_inspect.rta.constraints.chief_collision import ChiefCollision
from safe_inspect.rta.constraints.parameters import ConstraintParameters
from safe_inspect.rta.filters.backup.kernel_table import KernelTable
from safe_inspect.rta.filters.backup.model import FURTHER, PAIR_BIT, FilterModel, build_model, leading_holds
from safe_inspect.rta.filters.base import SafetyFilter, check_used, checked, compiled, differs
from safe_inspect.simulators.view import FilterResult
from safe_inspect.types import BoolArray, FloatArray, IntArray

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

    "At every moment" is certified, not sampled: see `arcs`, `holds` and `closed_motion`, and for what the constraints
    contribute, `RowKernels`. The filter needs no memory: it finds the plan again from the state. Its guarantee is for
    an exact model; the margins that every control must leave (1 mm, 0.01 mm/s, halved for a backup) absorb rounding,
    not disturbances.

    From a state without a plan, inside or outside the safe set, the filter applies a return control, ignores the
    desired control, and marks the row as infeasible. The return control is the smallest of the admissible controls that
    minimise the largest violation, in newtons, of these conditions on the state after the hold: speeds are within their
    limits, and each distance below 5 m (from the chief, the largest range, the sun cone) grows at half the allowed
    speed. See `returning`.
    """

    def __init__(
        self,
        parameters: Mapping[str, Any] | ConstraintParameters | None = None,
        names: Iterable[str | Constraint] = NAMES,
        intervention: Intervention = "nearest",
        several_holds: bool = True,
    ) -> None:
        """Build the filter; see `SafetyFilter` for the first arguments.

        Args:
            parameters: The task's parameters.
            names: The constraints.
            intervention: What is applied if the desired control is rejected: ``nearest``, a safe control near to it,
                or ``backup``, the backup plan, which leads to a closed motion.
            several_holds: Whether plans of weak thrusters may have several holds; their thrust is then the first one.

        Raises:
            ValueError: An argument is wrong, a constraint is neither one of the eight of the inspection task nor
                defines a half-space, or sets a field of `Constraint.uncertified`, or the hold is too large a part of
                the orbit.
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
        self._codes = codes
        self.further = KernelTable(further)
        self._tables = build_model(self.parameters, kept)
        if several_holds:
            self._tables = self._tables._replace(leads=leading_holds(self.parameters))

    @property
    def _model(self) -> FilterModel:
        """Numbers and tables of the task, with the further constraints."""
        return self.further.into(self._tables)

    def __call__(self, state: RelativeState, desired: FloatArray) -> FilterResult:
        """Return the controls to apply; see `SafetyFilter`."""
        desired = checked(state, desired)
        return self._filtered(state, desired, np.zeros((3, 6)), np.empty((0, 0)))

    def _filtered(
        self, state: RelativeState, desired: FloatArray, gain: FloatArray, memory: FloatArray
    ) -> FilterResult:  # fmt: skip
        """Return the controls to apply; for the last two arguments, see `filter_rows`."""
        count = len(state)
        control, refused, stage = np.empty((count, 3)), np.empty(count, np.int64), np.empty(count, np.int64)
        rows = compiled("backup.rows")
        rows.filter_rows(
            self._model, state.position, state.velocity, state.sun_angle, desired,
            self.intervention == "nearest", gain, memory, control, refused, stage,
        )  # fmt: skip
        active: IntArray = np.zeros(count, np.int64)
        for code, j in self._codes.items():
            active |= (refused >> code & 1) << j
        return FilterResult(
            control=control,
            intervening=differs(control, desired),
            infeasible=stage == rows.RETURN,
            backup=stage == rows.BACKUP,
            active=active,
            phi=self.phi(state),
            names=self.names,
        )

    def recoverable(self, state: RelativeState) -> BoolArray:
        """Return the rows that have a backup plan, from which the filter guarantees safety, shape (R,)."""
        return self.plans(state)[0]

    def plans(self, state: RelativeState, share: float = 1.0) -> tuple[BoolArray, FloatArray]:
        """Return the rows that have a backup plan, shape (R,), and its thrust [N], shape (R, 3); zero if there is none.

        Args:
            state: The states.
            share: Share of the margins that the plans must leave; half is enough if a plan was found one step before.
        """
        checked(state, np.zeros((len(state), 3)))
        found, control = np.empty(len(state), np.bool_), np.empty((len(state), 3))
        compiled("backup.rows").recoverable_rows(
            self._model, state.position, state.velocity, state.sun_angle, share, found, control
        )  # fmt: skip
        return found, control

    def backups(self, state: RelativeState) -> tuple[BoolArray, FloatArray]:
        """Return the plans to fall back on: as `plans`, with the whole margins or, failing that, with half of them."""
        found, thrust = self.plans(state)
        rest = np.flatnonzero(~found)
        if len(rest):
            found[rest], thrust[rest] = self.plans(state[rest], 0.5)
        return found, thrust

    def admissible(self, state: RelativeState, control: FloatArray) -> BoolArray:
        """Return the rows whose control would be applied unchanged, shape (R,)."""
        control = checked(state, control)
        out = np.empty(len(state), np.bool_)
        compiled("backup.rows").admissible_rows(
            self._model, state.position, state.velocity, state.sun_angle, control, out
        )  # fmt: skip
        return out
