"""What a constraint of the run-time assurance is: a plugin that gives four quantities of a batch of states."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping, Set
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np

from safe_inspect.plugins.plugin import Plugin
from safe_inspect.rta.constraints.parameters import ConstraintParameters
from safe_inspect.rta.constraints.rows import RowKernels
from safe_inspect.simulators.arrays import for_kernel
from safe_inspect.types import FloatArray

#: Row kernel of a half-space: takes parameters, a state (6,) and an array (6,) for the direction; returns the need.
HalfSpace = Callable[[Any, Any, Any], float]


@dataclass(frozen=True, eq=False)
class RelativeState:
    """The motion of R deputies about the chief, with the sun's angle.

    Attributes:
        position: Relative position [m], Hill frame, shape (R, 3).
        velocity: Relative velocity [m/s], Hill frame, shape (R, 3).
        sun_angle: Sun angle theta [rad], shape (R,). The sun stands in the direction (cos theta, -sin theta, 0)
            as seen from the chief, and theta grows at the mean motion.

    Raises:
        ValueError: The shapes do not belong together.
    """

    position: FloatArray
    velocity: FloatArray
    sun_angle: FloatArray

    def __post_init__(self) -> None:
        """Make the arrays contiguous and writable, which the compiled rows need, and check their shapes."""
        for field in ("position", "velocity", "sun_angle"):
            object.__setattr__(self, field, for_kernel(getattr(self, field), np.float64))
        rows = len(self.position)
        if self.position.shape != (rows, 3) or self.velocity.shape != (rows, 3) or self.sun_angle.shape != (rows,):
            raise ValueError(
                f"a relative state has position (R, 3), velocity (R, 3) and sun_angle (R,), "
                f"not {self.position.shape}, {self.velocity.shape} and {self.sun_angle.shape}"
            )

    def __len__(self) -> int:
        return len(self.position)

    def __getitem__(self, rows: Any) -> RelativeState:
        """Return some rows (a mask, a slice or an array of indices)."""
        return RelativeState(self.position[rows], self.velocity[rows], self.sun_angle[rows])


@dataclass(frozen=True, eq=False)
class ConstraintValues:
    """A constraint's quantities for R states.

    Attributes:
        phi: Plain safety quantity, >= 0 where the state is safe now, shape (R,).
        h: Invariance function, >= 0 where the state can be kept safe, shape (R,).
        gradient: Derivative of h with respect to (position, velocity), shape (R, 6).
        rate: Partial derivative of h with respect to time [units of h per s], shape (R,).
    """

    phi: FloatArray
    h: FloatArray
    gradient: FloatArray
    rate: FloatArray

    @classmethod
    def zeros(cls, rows: int) -> ConstraintValues:
        """Return an evaluation to be written into."""
        return cls(np.zeros(rows), np.zeros(rows), np.zeros((rows, 6)), np.zeros(rows))


class Constraint(Plugin):
    """Base of every safety constraint.

    A filter keeps the state in the set h >= 0 by choosing the control u such that

        gradient . (drift + input u) + rate + alpha(h + bias) >= 0,   alpha(s) = alpha_linear s + alpha_cubic s^3.

    A subclass defines `evaluate`, its fields with their defaults, and, to be built from a task's parameters,
    `from_parameters`. Row i of every result depends on row i of the state alone, and is finite for every
    finite state whose squares do not overflow.

    For the filters ``backup`` and ``simplex`` and that of a team, which certify whole holds, it also defines
    `half_space`, a static method that the filter compiles::

        @staticmethod
        def half_space(p, x, d):  # n . position <= limit, with p = (n_x, n_y, n_z, limit)
            d[0], d[1], d[2] = -p[0], -p[1], -p[2]
            return -p[3]

    It writes into d, which comes filled with zeros, a direction in the space of states y = (position [m], velocity
    [m/s]), Hill frame, and returns a need such that

    - every state y with d.y >= need is safe, and
    - the state x itself is safe exactly where d.x >= need.

    `p` holds `half_space_parameters`. A bound that is linear in the state has the same half-space at every x. For an
    obstacle that is convex it is the half-space beyond the tangent plane of the point next to x. A set from which
    one must not leave is convex in general, and no half-space lies within it: give one constraint for each face. The
    filter keeps states within the half-spaces at every moment, so what holds is what `half_space` says, and it must
    agree with phi. It cannot depend on time or on the sun.

    Class attributes:
        unit: Unit of phi.
        pair: True where the state is that of one deputy relative to another, instead of to the chief.
        kernels: What the certifying filters ask of a constraint of the inspection task, in place of a half-space.
        uncertified: Fields that the certifying filters do not use, and refuse to be given: those of alpha, and a mean
            motion, which is that of the orbit.

    Attributes:
        alpha_linear: Linear coefficient of alpha [1/s].
        alpha_cubic: Cubic coefficient of alpha [1/(s h^2)].
        bias: Margin that is added to h within alpha [units of h]; negative keeps the state off the boundary.
    """

    kind: ClassVar[str] = "constraint"
    unit: ClassVar[str] = "-"
    pair: ClassVar[bool] = False
    half_space: ClassVar[HalfSpace | None] = None
    kernels: ClassVar[RowKernels | None] = None
    uncertified: ClassVar[frozenset[str]] = frozenset({"alpha_linear", "alpha_cubic", "bias"})

    alpha_linear: float = 0.01
    alpha_cubic: float = 0.001
    bias: float = 0.0

    @abstractmethod
    def evaluate(self, state: RelativeState) -> ConstraintValues:
        """Return all four quantities of every row at once."""

    @classmethod
    def from_parameters(cls, parameters: ConstraintParameters) -> Self:
        """Return the constraint for a task's parameters; one that takes none of them is built from its defaults."""
        return cls()

    @classmethod
    def counts(cls, chosen: Set[str]) -> bool:
        """Return whether the `kernels` have a say when the constraints of those names are chosen."""
        return cls.kernels is not None and cls.registered_name in chosen

    @classmethod
    def row_numbers(cls, n: float, chosen: Mapping[str, Any]) -> tuple[Any, ...]:
        """Return the numbers that the `kernels` take as p.

        Args:
            n: Mean motion [rad/s].
            chosen: The constraints that count, by name. With the numbers of one that does not, nothing is refused.
        """
        return ()

    def half_space_parameters(self) -> tuple[float, ...]:
        """Return the numbers that `half_space` takes as p."""
        return ()

    def __call__(self, state: RelativeState) -> FloatArray:
        """Return the plain safety quantity phi, >= 0 where the state is safe, shape (R,)."""
        return self.evaluate(state).phi

    def phi(self, state: RelativeState) -> FloatArray:
        """Return the plain safety quantity, >= 0 where the state is safe, shape (R,)."""
        return self.evaluate(state).phi

    def h(self, state: RelativeState) -> FloatArray:
        """Return the invariance function, shape (R,)."""
        return self.evaluate(state).h

    def gradient(self, state: RelativeState) -> FloatArray:
        """Return the derivative of h with respect to (position, velocity), shape (R, 6)."""
        return self.evaluate(state).gradient

    def rate(self, state: RelativeState) -> FloatArray:
        """Return the partial derivative of h with respect to time, shape (R,); 0 unless h depends on the sun."""
        return self.evaluate(state).rate

    def alpha(self, h: FloatArray) -> FloatArray:
        """Return alpha_linear h + alpha_cubic h^3, element by element."""
        return h * (self.alpha_linear + self.alpha_cubic * (h * h))
