"""Quadratic programme of model predictive control for tracking along one axis."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from safe_inspect.rendezvous.control.gains import TrackingWeights
from safe_inspect.rendezvous.libraries import require
from safe_inspect.types import FloatArray

_NO_BOUND = 1e31  # the solver treats 1e30 and more as infinite
# Tolerance of a solution, in m, m/s and N.
_ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class TrackingSolution:
    """Solution of a `TrackingQP`.

    Attributes:
        states: Nominal errors z_0 .. z_N, shape (N+1, 2).
        forces: Nominal forces v_0 .. v_{N-1} [N], shape (N,).
        steady: Position error of the artificial steady state [m].
    """

    states: FloatArray
    forces: FloatArray
    steady: float


@dataclass(frozen=True, eq=False)
class AxisLimits:
    """Admissible nominal errors z and forces v of one axis.

    Attributes:
        lower: Lower limits of position error [m] and velocity error [m/s], shape (2,).
        upper: Upper limits of them, shape (2,).
        least_force: Lower limit of the nominal force v [N].
        largest_force: Upper limit of the nominal force v [N].
    """

    lower: FloatArray
    upper: FloatArray
    least_force: float
    largest_force: float

    def holding(self, solution: TrackingSolution, jump: float) -> AxisLimits:
        """Return limits that also admit the rest of a solution: its states from z_2 on and its forces from v_1 on.

        Args:
            solution: The solution.
            jump: Largest change of a position limit [m]; if a larger change is needed, the limits are not changed.
        """
        states, forces = solution.states[2:], solution.forces[1:]
        if not len(states):
            return self
        lower = np.minimum(self.lower, states.min(axis=0) - _ROUNDING)
        upper = np.maximum(self.upper, states.max(axis=0) + _ROUNDING)
        if max(self.lower[0] - lower[0], upper[0] - self.upper[0]) > jump + _ROUNDING:
            return self
        least = min(self.least_force, float(forces.min(initial=0.0)) - _ROUNDING)
        return AxisLimits(lower, upper, least, max(self.largest_force, float(forces.max(initial=0.0)) + _ROUNDING))


class TrackingQP:
    """Limon's programme in error coordinates, condensed to the variables (z_0, v_0 .. v_{N-1}, p_s).

    ``min sum_{k<N} |z_k - z_s|_Q^2 + |v_k|_R^2 + S p_s^2``, subject to ``z_{k+1} = A z_k + B v_k``, ``z_N = z_s``,
    ``z_0 = x``, ``z_s = (p_s, 0)``, and z_k (k >= 1) and v_k within their limits. The artificial steady state z_s
    makes the programme feasible even if the reference cannot be reached within the horizon.

    Source:
        Limon, Alvarado, Alamo and Camacho, "MPC for tracking piecewise constant references for constrained linear
        systems", 2008; with the terminal equality in place of a terminal set.
    """

    def __init__(
        self,
        a: FloatArray,
        b: FloatArray,
        horizon: int = 20,
        weights: TrackingWeights | None = None,
    ) -> None:
        """Set up the constant matrices.

        Args:
            a: State matrix A, shape (2, 2).
            b: Input vector B, shape (2,).
            horizon: Number of steps N.
            weights: Weights Q, R and S of the cost.
        """
        weights = weights or TrackingWeights()
        self.horizon = horizon
        size = horizon + 3
        # states[k] @ variables = z_k
        states = np.zeros((horizon + 1, 2, size))
        states[0, :, :2] = np.eye(2)
        for k in range(horizon):
            states[k + 1] = a @ states[k]
            states[k + 1, :, 2 + k] += b
        self._states = states
        steady = np.zeros((2, size))
        steady[0, -1] = 1.0
        errors = states[:horizon] - steady
        q = np.array([weights.position, weights.velocity])
        cost = np.einsum("kis,i,kit->st", errors, q, errors)
        cost[np.arange(2, 2 + horizon), np.arange(2, 2 + horizon)] += weights.force
        cost[-1, -1] += weights.offset
        self.cost = 2.0 * cost
        self.equalities = np.vstack((states[horizon] - steady, states[0]))
        self.inequalities = states[1:].reshape(-1, size)
        self._solver: Any = None
        self._solved: Any = None

    def bounds(self, state: FloatArray, limits: AxisLimits) -> tuple[FloatArray, ...]:
        """Return the right-hand side of the equalities, then lower and upper bounds of inequalities and variables."""
        lower, upper = np.tile(limits.lower, self.horizon), np.tile(limits.upper, self.horizon)
        right = np.concatenate((np.zeros(2), state))
        least = np.full(self.horizon + 3, -_NO_BOUND)
        largest = np.full(self.horizon + 3, _NO_BOUND)
        least[2:-1], largest[2:-1] = limits.least_force, limits.largest_force
        return right, lower, upper, least, largest

    def solve(self, state: FloatArray, limits: AxisLimits) -> TrackingSolution | None:
        """Return the solution, or None if there is none or the solver found none.

        Args:
            state: Error ``x`` in position [m] and velocity [m/s], shape (2,).
            limits: The tightened limits.
        """
        right, lower, upper, least, largest = self.bounds(state, limits)
        if np.any(lower > upper) or np.any(least > largest):
            return None
        if self._solver is None:
            piqp = require("piqp")
            self._solver, self._solved = piqp.DenseSolver(), piqp.PIQP_SOLVED
            self._solver.setup(
                np.asfortranarray(self.cost),
                np.zeros(len(self.cost)),
                np.asfortranarray(self.equalities),
                right,
                np.asfortranarray(self.inequalities),
                lower,
                upper,
                least,
                largest,
            )
        else:
            self._solver.update(b=right, h_l=lower, h_u=upper, x_l=least, x_u=largest)
        if self._solver.solve() != self._solved:
            return None
        variables = np.array(self._solver.result.x)  # a copy: the next solve overwrites it
        return TrackingSolution(self._states @ variables, variables[2:-1], float(variables[-1]))
