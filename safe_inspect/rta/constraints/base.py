"""Base class of the safety constraints: plugins that compute four quantities for a batch of states."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterable, Mapping, Set
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np

from safe_inspect.compiling import Kernel
from safe_inspect.plugins.plugin import Plugin
from safe_inspect.rta.constraints.parameters import ConstraintParameters
from safe_inspect.rta.constraints.rows import RowKernels
from safe_inspect.simulators.arrays import for_kernel
from safe_inspect.types import BoolArray, FloatArray

#: Row kernel of a half-space: takes parameters, a state (6,) and an array (6,) for the direction; returns the need.
HalfSpace = Callable[[Any, Any, Any], float]


@dataclass(frozen=True, eq=False)
class MotionBatch:
    """Positions, velocities and sun angles of a batch, whose arrays are contiguous and writable, as compiled rows need.

    Class attributes:
        row: What a row of the batch is called in messages.

    Attributes:
        position: Position relative to the chief [m], Hill frame, shape (N, ..., 3).
        velocity: Velocity relative to the chief [m/s], Hill frame, shape (N, ..., 3).
        sun_angle: Sun angle [rad], shape (N,).
    """

    row: ClassVar[str] = "row"

    position: FloatArray
    velocity: FloatArray
    sun_angle: FloatArray

    def __post_init__(self) -> None:
        """Make the arrays contiguous and writable."""
        for field in ("position", "velocity", "sun_angle"):
            object.__setattr__(self, field, for_kernel(getattr(self, field), np.float64))

    def __len__(self) -> int:
        return len(self.position)

    @property
    def finite(self) -> BoolArray:
        """The rows in which every number is finite, shape (N,)."""
        axes = tuple(range(1, self.position.ndim))
        finite = np.isfinite(self.position).all(axis=axes) & np.isfinite(self.velocity).all(axis=axes)
        return np.asarray(finite & np.isfinite(self.sun_angle))

    def __getitem__(self, rows: Any) -> Self:
        """Return the selected rows (a mask, a slice or an array of indices)."""
        return type(self)(*(array[rows] for array in vars(self).values()))

    @classmethod
    def joined(cls, states: Iterable[Self]) -> Self:
        """Return the rows of several states, one after the other."""
        return cls(*map(np.concatenate, zip(*(vars(state).values() for state in states), strict=True)))

    def unless(self, accepted: Callable[[Self], BoolArray]) -> BoolArray:
        """Return the mask of the rows that are not finite, or that a function does not accept, shape (N,)."""
        rejected, whole = ~self.finite, self.finite
        rejected[whole] = ~accepted(self[whole])
        return rejected


@dataclass(frozen=True, eq=False)
class RelativeState(MotionBatch):
    """Motion of R deputies relative to the chief, and the sun angle.

    Attributes:
        position: Relative position [m], Hill frame, shape (R, 3).
        velocity: Relative velocity [m/s], Hill frame, shape (R, 3).
        sun_angle: Sun angle theta [rad], shape (R,). Seen from the chief, the sun is in the direction
            (cos theta, -sin theta, 0), and theta grows at the mean motion.

    Raises:
        ValueError: The shapes do not match.
    """

    def __post_init__(self) -> None:
        """Make the arrays contiguous and writable, and check their shapes."""
        super().__post_init__()
        rows = len(self.position)
        if self.position.shape != (rows, 3) or self.velocity.shape != (rows, 3) or self.sun_angle.shape != (rows,):
            raise ValueError(
                f"expected a relative state with position (R, 3), velocity (R, 3) and sun_angle (R,), "
                f"got {self.position.shape}, {self.velocity.shape} and {self.sun_angle.shape}"
            )


@dataclass(frozen=True, eq=False)
class ConstraintValues:
    """Quantities of one constraint for R states.

    Attributes:
        phi: Safety quantity, >= 0 where the state is safe now, shape (R,).
        h: Barrier function, >= 0 where the state can be kept safe, shape (R,).
        gradient: Derivative of h with respect to (position, velocity), shape (R, 6).
        rate: Partial derivative of h with respect to time [units of h per s], shape (R,).
    """

    phi: FloatArray
    h: FloatArray
    gradient: FloatArray
    rate: FloatArray

    @classmethod
    def zeros(cls, rows: int) -> ConstraintValues:
        """Return values filled with zeros, to be written into."""
        return cls(np.zeros(rows), np.zeros(rows), np.zeros((rows, 6)), np.zeros(rows))

    @classmethod
    def computed(cls, kernel: Kernel[..., None], state: RelativeState, *numbers: Any) -> ConstraintValues:
        """Return what a kernel writes; it takes the arrays of the state, the numbers, and the arrays of the values."""
        out = cls.zeros(len(state))
        kernel((state.position, state.velocity, state.sun_angle), *numbers, out.phi, out.h, out.gradient, out.rate)
        return out


class Constraint(Plugin):
    """Base class of the safety constraints.

    A state satisfies the constraint where the *safety quantity* phi is >= 0, and can be kept so where the *barrier
    function* h is >= 0. The filter ``continuous`` chooses the control u such that the state stays in the set h >= 0:

        gradient . (drift + input u) + rate + alpha(h + bias) >= 0,   alpha(s) = alpha_linear s + alpha_cubic s^3.

    A subclass defines `evaluate` and its fields with their defaults, and `from_task` or `from_parameters` if it can be
    built from a task's parameters. Row i of every result depends only on row i of the state, and is finite for every
    finite state whose squares do not overflow.

    A *guarantee* is that phi >= 0 at every moment. Only the filters that certify whole holds (periods of constant
    thrust) give it, ``backup`` and the filter of a team, under these premises:

    - The initial state has a backup plan.
    - The thrust is constant along Hill's axes during a hold, and possible in both directions of each axis.
    - The chief rests at the origin.
    - The motion is that of Clohessy and Wiltshire, exactly or within the filter's `disturbance`.

    `config.building` refuses experiments that violate them, with two exceptions, which only warn. A start
    that no rejection sampler tests is tested at the reset, and flown even if the filter rejects it. With
    ``undeclared: warn``, components and dynamics that declare no `disturbance_bounds` are accepted.

    From a state without a plan, nothing is guaranteed: the filter ignores the desired thrust, applies a return control
    (in a team first each deputy's own safe plan, if there is one) and marks the step as infeasible. The constraint
    ``sun`` also requires a `Sun` in the plane of a circular orbit, which turns at the orbit's mean motion and starts at
    the angle with which initial states are tested.

    These filters do not use h to choose a thrust, but their test of initial states requires h >= 0 and phi >= 0. For
    them, a subclass also defines `half_space`, a static method that the filter compiles::

        @staticmethod
        def half_space(p, x, d):  # n . position <= limit, with p = (n_x, n_y, n_z, limit)
            d[0], d[1], d[2] = -p[0], -p[1], -p[2]
            return -p[3]

    It writes a direction into d, which is filled with zeros beforehand, in the space of states y = (position [m],
    velocity [m/s]), Hill frame, and returns a threshold, the need, such that

    - every state y with d.y >= need is safe, and
    - the state x itself is safe if and only if d.x >= need.

    `p` contains `half_space_parameters`. A bound that is linear in the state has the same half-space at every x. For a
    convex obstacle, it is the half-space beyond the tangent plane at the obstacle's point nearest to x. A region that
    the deputy must not leave is usually convex, and contains no half-space: define one constraint for each face. The
    filter keeps states within the half-spaces at every moment. It therefore guarantees what `half_space` says, which
    must agree with phi. `half_space` cannot depend on time or on the sun. Both filters refuse a constraint without
    `half_space`, except those of `sets.CERTIFIED`.

    Defining a class registers it under its class name, or the class keyword ``name``. An experiment imports its module
    by `plugin_paths`, and lists ``{functor: NAME, config: {...}}`` in the `constraints` of a filter.
    `safe_inspect.testing.check_plugin` checks it.

    Class attributes:
        unit: Unit of phi.
        pair: True if the state is that of one deputy relative to another, instead of relative to the chief. Derive such
            a constraint from `PairConstraint`, because a team's filter enforces any other one relative to the chief.
            `half_space` is not used for pairs.
        from_task: Names of the parameters of a task, see `ConstraintParameters`, by the field that takes their value.
        kernels: What the certifying filters use for a constraint of the inspection task, instead of a half-space: the
            built-in constraints have these and no `half_space`, except for PSM and those of pairs, which have neither.
        uncertified: Fields that the certifying filters do not use and reject if given: those of alpha, and a mean
            motion, because the filters use that of the orbit.

    Attributes:
        name: Name in messages and results, to distinguish several constraints of one class; default: that of the class.
        alpha_linear: Linear coefficient of alpha [1/s].
        alpha_cubic: Cubic coefficient of alpha [1/(s h^2)].
        bias: Margin added to h within alpha [units of h]; a negative value keeps the state off the boundary.
    """

    kind: ClassVar[str] = "constraint"
    unit: ClassVar[str] = "-"
    pair: ClassVar[bool] = False
    from_task: ClassVar[Mapping[str, str]] = {}
    half_space: ClassVar[HalfSpace | None] = None
    kernels: ClassVar[RowKernels | None] = None
    uncertified: ClassVar[frozenset[str]] = frozenset({"alpha_linear", "alpha_cubic", "bias"})

    name: str = ""
    alpha_linear: float = 0.01
    alpha_cubic: float = 0.001
    bias: float = 0.0

    @abstractmethod
    def evaluate(self, state: RelativeState) -> ConstraintValues:
        """Compute phi, h, the gradient of h and its rate for every row."""

    @classmethod
    def from_parameters(cls, parameters: ConstraintParameters) -> Self:
        """Build the constraint from a task's parameters, of which it takes those of `from_task`."""
        return cls(**{field: getattr(parameters, name) for field, name in cls.from_task.items()})

    @classmethod
    def counts(cls, chosen: Set[str]) -> bool:
        """Return whether the `kernels` apply when the constraints with those names are chosen."""
        return cls.kernels is not None and cls.registered_name in chosen

    @classmethod
    def row_numbers(cls, n: float, chosen: Mapping[str, Any]) -> tuple[Any, ...]:
        """Return the numbers that the `kernels` take as p.

        Args:
            n: Mean motion [rad/s].
            chosen: The chosen constraints, by name. If this one does not apply, its kernels reject nothing with the
                numbers returned.
        """
        return ()

    def half_space_parameters(self) -> tuple[float, ...]:
        """Return the numbers that `half_space` takes as p."""
        return ()

    def __call__(self, state: RelativeState) -> FloatArray:
        """Return the safety quantity phi, >= 0 where the state is safe, shape (R,)."""
        return self.evaluate(state).phi

    def phi(self, state: RelativeState) -> FloatArray:
        """Return the safety quantity phi, >= 0 where the state is safe, shape (R,)."""
        return self.evaluate(state).phi

    def h(self, state: RelativeState) -> FloatArray:
        """Return the barrier function h, shape (R,)."""
        return self.evaluate(state).h

    def gradient(self, state: RelativeState) -> FloatArray:
        """Return the derivative of h with respect to (position, velocity), shape (R, 6)."""
        return self.evaluate(state).gradient

    def alpha(self, h: FloatArray) -> FloatArray:
        """Return alpha_linear h + alpha_cubic h^3, element by element."""
        return h * (self.alpha_linear + self.alpha_cubic * (h * h))
