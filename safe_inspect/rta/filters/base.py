"""Interface of the safety filters: their arguments and results."""

from __future__ import annotations

import importlib
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from functools import cache
from typing import Any

import numpy as np

from safe_inspect.rta.constraints.base import Constraint, RelativeState
from safe_inspect.rta.constraints.certified import NAMES
from safe_inspect.rta.constraints.parameters import ConstraintParameters
from safe_inspect.rta.constraints.sets import constraint_set, name_of
from safe_inspect.simulators.arrays import for_kernel
from safe_inspect.simulators.view import FilterResult
from safe_inspect.types import BoolArray, FloatArray

#: A control that differs from the desired one by more than this counts as an intervention [N].
INTERVENTION_THRESHOLD = 0.01


class SafetyFilter(ABC):
    """Base class of the filters: a fixed function of the state and the desired control, row by row.

    Attributes:
        parameters: The task's parameters.
        names: The names of the constraints.
        constraints: The constraints by name.
    """

    def __init__(
        self,
        parameters: Mapping[str, Any] | ConstraintParameters | None = None,
        names: Iterable[str | Constraint] = NAMES,
    ) -> None:
        """Build the constraints.

        Args:
            parameters: Parameters by name, as in safe-autonomy-sims; see `ConstraintParameters`.
            names: Registered names of constraints, or constraints.

        Raises:
            ValueError: A name or a parameter is wrong; see `constraint_set`.
        """
        self.parameters = ConstraintParameters.of({} if parameters is None else parameters)
        self.constraints: dict[str, Constraint] = constraint_set(self.parameters, names)
        self.names = tuple(self.constraints)

    @abstractmethod
    def __call__(self, state: RelativeState, desired: FloatArray) -> FilterResult:
        """Return the controls to apply.

        Args:
            state: The states of R deputies.
            desired: Desired controls [N], Hill frame, shape (R, 3).

        Raises:
            ValueError: The shapes differ, or a number is not finite; the message names the first such row.
        """

    def limit(self, field: str, *names: str) -> float:
        """Return a field of the first named constraint that the filter has, or the task's parameter of that name."""
        kept = [self.constraints[name] for name in names if name in self.constraints]
        return float(getattr([*kept, self.parameters][0], field))

    def phi(self, state: RelativeState) -> FloatArray:
        """Return the safety quantity phi of every constraint, >= 0 where safe, shape (R, C)."""
        return as_columns([constraint.phi(state) for constraint in self.constraints.values()], len(state))


def check_used(entries: Iterable[str | Constraint]) -> None:
    """Check that no constraint sets a field that a certifying filter does not use.

    Raises:
        ValueError: One does, to another value than the default.
    """
    for entry in entries:
        if isinstance(entry, Constraint):
            for field in sorted(entry.uncertified & entry.model_fields_set):
                if getattr(entry, field) != type(entry).model_fields[field].default:
                    raise ValueError(
                        f"the constraint {name_of(entry)!r} sets `{field}`, which this filter does not use, so the "
                        "value would have no effect; remove the field, or use the method 'continuous'"
                    )


def as_columns(parts: list[FloatArray], rows: int) -> FloatArray:
    """Return arrays of shape (R,) as the columns of one array, shape (R, C)."""
    return np.stack(parts, axis=1) if parts else np.empty((rows, 0))


def checked(state: RelativeState, desired: FloatArray) -> FloatArray:
    """Return the desired controls as an array that the compiled rows accept.

    Raises:
        ValueError: The shapes differ, or a number is not finite.
    """
    desired = for_kernel(desired, np.float64)
    if desired.shape != (len(state), 3):
        raise ValueError(f"{len(state)} states need desired controls of shape ({len(state)}, 3), got {desired.shape}")
    whole = np.concatenate((desired, state.position, state.velocity, state.sun_angle[:, None]), axis=1)
    finite = np.isfinite(whole)
    if not finite.all():
        row = int(np.argmin(finite.all(axis=1)))
        what = "desired control" if not finite[row, :3].all() else "state"
        values = whole[row, :3] if what == "desired control" else whole[row, 3:]
        raise ValueError(f"the {what} of row {row} is not finite: {values.tolist()}; check what computed it")
    return desired


def differs(control: FloatArray, desired: FloatArray) -> BoolArray:
    """Return the rows that a filter changed by more than `INTERVENTION_THRESHOLD`, shape (R,)."""
    away = control - desired
    changed: BoolArray = away[:, 0] ** 2 + away[:, 1] ** 2 + away[:, 2] ** 2 > INTERVENTION_THRESHOLD**2
    return changed


@cache
def compiled(module: str) -> Any:
    """Return a module of compiled rows of this package, imported at the first call."""
    return importlib.import_module(f"safe_inspect.rta.filters.{module}")
