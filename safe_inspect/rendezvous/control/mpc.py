"""Tube model predictive control of the three axes about a reference that may change at every step."""

from __future__ import annotations

from typing import Any

import numpy as np
from pydantic import Field

from safe_inspect.rendezvous.control.design import DesignRequest, TubeDesign, design_by_clearance
from safe_inspect.rendezvous.control.gains import TrackingWeights, lqr_gain
from safe_inspect.rendezvous.control.tightening import (
    UNLIMITED,
    AxisLimits,
    TightenedLimits,
    TrackedReference,
    TrackingLimits,
    TrackingSolution,
)
from safe_inspect.rendezvous.control.tracker import AxisStatus, Tracker, TrackerOutput
from safe_inspect.rendezvous.control.tube import Axis, Tube
from safe_inspect.rendezvous.libraries import require
from safe_inspect.types import FloatArray
from safe_inspect.units import PositiveAngularRate

#: Multiples of the configured horizon that are tried if the first step has no solution.
_LONGER = (2, 4)
#: Number of natural frequencies that are tried between the smallest and the largest.
_FREQUENCIES = 20


class TrackingQP:
    """Limon's programme in error coordinates, condensed to the variables (z_0, v_0 .. v_{N-1}, p_s).

    ``min sum_{k<N} |z_k - z_s|_Q^2 + |v_k|_R^2 + S p_s^2``, subject to ``z_{k+1} = A z_k + B v_k``, ``z_N = z_s``,
    ``z_0 = x``, ``z_s = (p_s, 0)``, and z_k (k >= 1) and v_k within their limits. The artificial steady state z_s
    makes the programme feasible even if the reference cannot be reached within the horizon.

    Source:
        Limon, Alvarado, Alamo and Camacho, "MPC for tracking piecewise constant references for constrained linear
        systems", 2008; with the terminal equality in place of a terminal set.
    """

    def __init__(self, a: FloatArray, b: FloatArray, horizon: int = 20, weights: TrackingWeights | None = None) -> None:
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
        self.cost = np.asfortranarray(2.0 * cost)
        self.equalities = np.asfortranarray(np.vstack((states[horizon] - steady, states[0])))
        self.inequalities = np.asfortranarray(states[1:].reshape(-1, size))
        self._solver: Any = None
        self._solved: Any = None

    def bounds(self, state: FloatArray, limits: AxisLimits) -> tuple[FloatArray, ...]:
        """Return the right-hand side of the equalities, then lower and upper bounds of inequalities and variables."""
        lower, upper = np.tile(limits.lower, self.horizon), np.tile(limits.upper, self.horizon)
        right = np.concatenate((np.zeros(2), state))
        least = np.full(self.horizon + 3, -UNLIMITED)
        largest = np.full(self.horizon + 3, UNLIMITED)
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
            linear = np.zeros(len(self.cost))
            self._solver.setup(
                self.cost, linear, self.equalities, right, self.inequalities, lower, upper, least, largest
            )
        else:
            self._solver.update(b=right, h_l=lower, h_u=upper, x_l=least, x_u=largest)
        if self._solver.solve() != self._solved:
            return None
        variables = np.array(self._solver.result.x)  # a copy: the next solve overwrites it
        return TrackingSolution(self._states @ variables, variables[2:-1], float(variables[-1]))


class TubeMPCTracker(Tracker):
    """Tube model predictive control with the gain, of those that the force allows, that leaves the most clearance.

    Attributes:
        horizon: Number of steps of the quadratic programme.
        least_frequency: Smallest natural frequency of the feedback gains that are tried [rad/s].
        largest_frequency: Largest natural frequency of the feedback gains that are tried [rad/s].
    """

    horizon: int = Field(default=20, ge=2)
    least_frequency: PositiveAngularRate = 0.15  # type: ignore[valid-type]
    largest_frequency: PositiveAngularRate = 1.0  # type: ignore[valid-type]

    def design(self, request: DesignRequest) -> TubeDesign:
        """Return the tube for a plan, or a design that says why there is none."""
        frequencies = np.geomspace(self.least_frequency, self.largest_frequency, _FREQUENCIES)
        return design_by_clearance(request, tuple(frequencies))

    def __call__(self, design: TubeDesign) -> TubeMPC:
        """Return the tracker for one approach."""
        return TubeMPC(design.axis, design.tube, design.limits, self.horizon)


class TubeMPC:
    """Controller ``u = u_r + v_0 + K (x_hat - r_hat - z_0)`` that solves a `TrackingQP` for each axis.

    An object stores the nominal errors of one approach. If the programme has no solution at the first step, longer
    horizons are tried, and the one that works is used from then on. At later steps, the rest of the last solution is
    flown. If there is none, the axis is regulated with clipped force and its status says so: the guarantee of the tube
    then no longer holds.

    A new reference moves the limits of z. If they move by no more than the bound of references allows, they are
    relaxed to contain the rest of the last solution: that solution respected the limits about the previous reference,
    which is within the bound too. A feasible programme therefore remains feasible.

    Source:
        Limon, Alvarado, Alamo and Camacho, "Robust tube-based MPC for tracking of constrained linear systems with
        additive disturbances", 2010.
    """

    def __init__(self, axis: Axis, tube: Tube, limits: TrackingLimits | None = None, horizon: int = 20) -> None:
        """Set up the programmes.

        Args:
            axis: Dynamics of each axis.
            tube: The tube.
            limits: Limits before tightening.
            horizon: Number of steps N of the programme.
        """
        self.axis, self.tube, self.limits = axis, tube, limits or TrackingLimits()
        self._horizon, self._weights = horizon, TrackingWeights.of_force(self.limits.force)
        self._regulator = lqr_gain(axis, self._weights)
        self._programmes: dict[int, TrackingQP] = {}
        self._reference: TrackedReference | None = None
        self._solutions: list[TrackingSolution | None] = [None, None, None]
        self._factors = [1, 1, 1]
        # The largest distance between two references that are both within the bound. The tube about an estimated
        # reference is wider than that about the true one by half of it.
        self._jump = 2.0 * float((tube.position - tube.clearance).max())
        self.tightened = TightenedLimits(axis, TrackedReference(np.zeros((1, 3)), np.zeros((1, 3))), tube, self.limits)

    def step(self, estimate: FloatArray, reference: TrackedReference, k: int) -> TrackerOutput:
        """Return the force at a step.

        Args:
            estimate: Position [m] and velocity [m/s] of the chaser in W, shape (6,).
            reference: Reference to follow, from step 0 on; a new object if it has changed.
            k: The step.
        """
        if reference is not self._reference:
            self._reference = reference
            self.tightened = TightenedLimits(self.axis, reference, self.tube, self.limits)
        error = np.asarray(estimate).reshape(2, 3).T - np.stack((reference.position[k], reference.velocity[k]), axis=1)
        nominal, nominal_force = np.zeros((3, 2)), np.zeros(3)
        feedback, status = np.zeros(3), []
        for i in range(3):
            solution, how = self._solve(i, error[i], self.tightened.at(k, i))
            self._solutions[i] = solution
            status.append(how)
            if solution is None:
                nominal[i] = error[i]
                feedback[i] = self._regulator @ error[i]
            else:
                nominal[i], nominal_force[i] = solution.states[0], solution.forces[0]
                feedback[i] = self.tube.gain_at(k) @ (error[i] - nominal[i])
        demand = self.tightened.feed_forward[k] + nominal_force + feedback
        force = np.clip(demand, -self.limits.force, self.limits.force)
        return TrackerOutput(force, nominal, nominal_force, tuple(status))

    def _solve(self, i: int, error: FloatArray, limits: AxisLimits) -> tuple[TrackingSolution | None, AxisStatus]:
        """Return the solution of axis i for its error x_hat - r_hat, shape (2,), and how it was found."""
        last = self._solutions[i]
        start = error if last is None else last.states[1]  # the tube holds about a nominal error that continues
        if last is not None:
            limits = limits.holding(last, self._jump)
        # Use the horizon of the last solution: with a shorter one, a feasible programme could become infeasible.
        solution = self._programme(self._factors[i]).solve(start, limits)
        if solution is not None:
            return solution, AxisStatus.SOLVED if self._factors[i] == 1 else AxisStatus.LONGER_HORIZON
        if last is not None and len(last.forces) > 1:
            return TrackingSolution(last.states[1:], last.forces[1:], last.steady), AxisStatus.SHIFTED
        for factor in _LONGER:
            solution = self._programme(factor).solve(start, limits)
            if solution is not None:
                self._factors[i] = factor
                return solution, AxisStatus.LONGER_HORIZON
        return None, AxisStatus.REGULATOR

    def _programme(self, factor: int) -> TrackingQP:
        """Return the programme with `factor` times the horizon."""
        if factor not in self._programmes:
            self._programmes[factor] = TrackingQP(self.axis.A, self.axis.B, factor * self._horizon, self._weights)
        return self._programmes[factor]
