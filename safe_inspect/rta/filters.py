"""Interface of the safety filters: their arguments and results, and sampled states for testing constraints."""

from __future__ import annotations

import importlib
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from functools import cache
from typing import Any, cast

import numpy as np

from safe_inspect.rta.constraints.base import Constraint, MotionBatch, RelativeState
from safe_inspect.rta.constraints.parameters import ConstraintParameters
from safe_inspect.rta.constraints.sets import NAMES, constraint_set, name_of
from safe_inspect.simulators.arrays import for_kernel
from safe_inspect.simulators.resets.parameters import either
from safe_inspect.simulators.view import FilterResult
from safe_inspect.types import BoolArray, FloatArray, IntArray

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
        return self.columns([constraint.phi(state) for constraint in self.constraints.values()], len(state))

    @staticmethod
    def columns(parts: list[FloatArray], rows: int) -> FloatArray:
        """Return arrays of shape (R,) as the columns of one array, shape (R, C)."""
        return np.stack(parts, axis=1) if parts else np.empty((rows, 0))

    @staticmethod
    def active(refused: IntArray, codes: Mapping[int, int]) -> IntArray:
        """Return bits of constraints, the bit of each code moved to the place that a mapping gives for it."""
        active: IntArray = np.zeros(refused.shape, np.int64)
        for code, j in codes.items():
            active |= (refused >> code & 1) << j
        return active

    @staticmethod
    def refusals(looks: Iterable[tuple[str, Constraint, RelativeState]]) -> dict[str, BoolArray]:
        """Return, for each constraint, the mask of the rows that it rejects: not (h >= 0 and phi >= 0), NaN included.

        Args:
            looks: Name of a constraint, the constraint, and a state of each row; a constraint may look several times.
        """
        refused: dict[str, BoolArray] = {}
        for name, constraint, state in looks:
            value = constraint.evaluate(state)
            refused = either(refused, {name: ~((value.h >= 0.0) & (value.phi >= 0.0))})
        return refused


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


def checked(state: MotionBatch, desired: FloatArray, ignored: BoolArray | None = None) -> FloatArray:
    """Return the desired controls as an array that the compiled rows accept.

    Args:
        state: The states.
        desired: Desired controls [N], with the shape of the positions.
        ignored: Mask of the deputies whose desired control is replaced by zero; by default, none.

    Raises:
        ValueError: The shapes differ, or a number is not finite.
    """
    desired = for_kernel(desired, np.float64)
    if desired.shape != state.position.shape:
        raise ValueError(f"the desired controls must have the shape {state.position.shape}, got {desired.shape}")
    if ignored is not None:
        desired = np.where(ignored[..., None], 0.0, desired)
    given = np.asarray(np.isfinite(desired).all(axis=tuple(range(1, desired.ndim))))
    finite = given & state.finite
    if not finite.all():
        row = int(np.argmin(finite))
        what, parts = ("state", vars(state).values()) if given[row] else ("desired control", (desired,))
        values = [part[row].tolist() for part in parts]
        raise ValueError(f"the {what} of {state.row} {row} is not finite: {values}; check what computed it")
    return desired


def differs(control: FloatArray, desired: FloatArray) -> BoolArray:
    """Return the rows that a filter changed by more than `INTERVENTION_THRESHOLD`, shape (...,), for (..., 3)."""
    away = control - desired
    changed: BoolArray = away[..., 0] ** 2 + away[..., 1] ** 2 + away[..., 2] ** 2 > INTERVENTION_THRESHOLD**2
    return changed


@cache
def compiled(module: str) -> Any:
    """Return a module of compiled rows of this package, imported at the first call."""
    return importlib.import_module(f"safe_inspect.rta.{module}")


#: Smallest and largest range [m] and speed [m/s].
_RANGES, _SPEEDS = (1.0, 2000.0), (1e-3, 10.0)
#: Number of states that are sampled to estimate the share of safe states that are recoverable.
SAFE_DRAWS = 4096


def probe_states(rows: int = 512) -> RelativeState:
    """Return states in all directions, with ranges of 1 m to 2 km and speeds of 1 mm/s to 10 m/s, always the same.

    Args:
        rows: Number of states, R.
    """
    generator = np.random.default_rng(11)

    def vectors(low: float, high: float) -> FloatArray:
        direction = generator.normal(size=(rows, 3))
        length = np.exp(generator.uniform(np.log(low), np.log(high), (rows, 1)))
        return np.asarray(length * direction / np.sqrt((direction**2).sum(axis=1, keepdims=True)))

    position, velocity = vectors(*_RANGES), vectors(*_SPEEDS)
    return RelativeState(position, velocity, generator.uniform(0.0, 2.0 * np.pi, rows))


def safe_states(constraints: Mapping[str, Constraint], parameters: ConstraintParameters, rows: int) -> RelativeState:
    """Sample states over all ranges and speeds, always the same, and return those that are safe.

    Args:
        constraints: The constraints.
        parameters: Their parameters, which give the limits for which there is no constraint.
        rows: Number of states to sample.
    """
    generator, kept, p = np.random.default_rng(12), cast("Mapping[str, Any]", constraints), parameters
    near, far = (kept.get(name, p) for name in ("chief_collision", "r_max"))
    fastest = np.linalg.norm([kept.get(name, p).vel_limit for name in ("x_vel", "y_vel", "z_vel")])
    direction = generator.normal(size=(2, rows, 3))
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    distance = generator.uniform(near.collision_radius, far.r_max, rows)
    speed = np.full(rows, fastest)
    if "rel_vel" in kept:
        line = kept["rel_vel"]
        speed = np.clip(line.v0 + line.v1 * (distance - line.v0_distance), 0.0, fastest)
    speed *= generator.uniform(0.0, 1.0, rows)
    drawn = RelativeState(
        direction[0] * distance[:, None], direction[1] * speed[:, None], generator.uniform(0.0, 2.0 * np.pi, rows)
    )
    return drawn[np.all([constraint.phi(drawn) >= 0.0 for constraint in constraints.values()], axis=0)]


def responds_to_thrust(constraint: Constraint) -> bool:
    """Return whether the gradient of h has a velocity part anywhere; if not, thrust does not affect the rate of h."""
    return bool(np.any(constraint.gradient(probe_states())[:, 3:]))
