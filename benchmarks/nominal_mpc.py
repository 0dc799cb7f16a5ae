"""Tube model predictive control whose nominal state is free within the tube, for comparison with feedback alone.

For each axis and step it solves ``min sum_{k<N} |z_k - z_s|_Q^2 + |v_k|_R^2 + S p_s^2`` subject to
``z_{k+1} = A z_k + B v_k``, ``z_N = z_s = (p_s, 0)`` and z_k (k >= 1) and v_k within the limits less the reference and
the tube from this step on. The start z_0 is free as long as the rest ``x - z_0`` is within the tube's half widths in
position, velocity and feedback, a hull of its cross-section. If there is no solution, horizons of 40 and 80 steps are
tried; then the linear-quadratic regulator acts, and the step counts as one without a solution.

Source:
    Limon, Alvarado, Alamo and Camacho, "Robust tube-based MPC for tracking of constrained linear systems with additive
    disturbances", 2010; with the terminal equality in place of a terminal set.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import piqp

from safe_inspect.rendezvous.control.design import lqr_gain, tracking_weights
from safe_inspect.rendezvous.control.tracker import TrackerOutput
from safe_inspect.rendezvous.control.tube import Axis, TrackedReference, TrackingLimits, Tube

_UNLIMITED, _HORIZONS, _OFFSET = 1e31, (20, 40, 80), 1e5


class NominalMPC:
    """The tracker of one approach; `unsolved` counts the steps without a solution."""

    def __init__(self, axis: Axis, tube: Tube, limits: TrackingLimits) -> None:
        self.axis, self.tube, self.limits, self.unsolved = axis, tube, limits, 0
        *self._state_weights, self._force_weight = tracking_weights(limits.force)
        self._regulator = lqr_gain(axis, limits.force)
        self._programmes = {horizon: self._programme(horizon) for horizon in _HORIZONS}
        self._reference: TrackedReference | None = None

    def _programme(self, horizon: int) -> tuple[Any, ...]:
        """Return cost, equalities and states for the variables (z_0, v_0 .. v_{N-1}, p_s)."""
        states = np.zeros((horizon + 1, 2, horizon + 3))
        states[0, :, :2] = np.eye(2)
        for k in range(horizon):
            states[k + 1] = self.axis.A @ states[k]
            states[k + 1, :, 2 + k] += self.axis.B
        steady = np.zeros((2, horizon + 3))
        steady[0, -1] = 1.0
        errors = states[:horizon] - steady
        cost = np.einsum("kis,i,kit->st", errors, self._state_weights, errors)
        forces = np.arange(2, 2 + horizon)
        cost[forces, forces] += self._force_weight
        cost[-1, -1] += _OFFSET
        return np.asfortranarray(2.0 * cost), np.asfortranarray(states[horizon] - steady), states

    def _limits(self, reference: TrackedReference) -> tuple[Any, Any]:
        """Return the limits of z and v from each step on, shape (K, 3 axes, 3) each."""
        steps = np.minimum(np.arange(len(reference.position)), len(self.tube.position) - 1)
        box = np.full(3, _UNLIMITED) if self.limits.keep_in is None else np.asarray(self.limits.keep_in)
        half = np.stack((box, np.full(3, self.limits.speed), np.full(3, self.limits.force)), axis=1)
        half = half - np.stack((self.tube.position, self.tube.velocity, self.tube.force), axis=1)[steps][:, None, :]
        centre = np.stack((reference.position, reference.velocity, reference.feed_forward(self.axis)), axis=2)
        upper, lower = half - centre, -half - centre
        return (
            np.maximum.accumulate(lower[::-1])[::-1],
            np.minimum.accumulate(upper[::-1])[::-1],
        )

    def step(self, estimate: Any, reference: TrackedReference, k: int) -> TrackerOutput:
        """Return the force at step k."""
        if reference is not self._reference:
            self._reference, self._tightened = reference, self._limits(reference)
        error = np.asarray(estimate).reshape(2, 3).T - np.stack((reference.position[k], reference.velocity[k]), axis=1)
        demand, solved = reference.feed_forward(self.axis)[k], True
        lower, upper = (limits[k] for limits in self._tightened)
        for i in range(3):
            force = self._force(error[i], lower[i], upper[i], k)
            solved &= force is not None
            demand[i] += self._regulator @ error[i] if force is None else force
        self.unsolved += not solved
        return TrackerOutput(np.clip(demand, -self.limits.force, self.limits.force), np.zeros(3))

    def _force(self, error: Any, lower: Any, upper: Any, k: int) -> float | None:
        """Return the nominal and the feedback force of an axis [N]; None without a solution."""
        at, gain = min(k, len(self.tube.position) - 1), self.tube.gain_at(k)
        rows = np.vstack((np.eye(2), gain))
        width = np.array([self.tube.position[at], self.tube.velocity[at], self.tube.force[at]])
        if (np.abs(rows @ error) <= width).all() and (lower <= 0.0).all() and (upper >= 0.0).all():
            return float(gain @ error)  # the optimum is z = 0, v = 0
        if (lower > upper).any():
            return None
        for horizon, (cost, end, states) in self._programmes.items():
            least, most = np.full(horizon + 3, -_UNLIMITED), np.full(horizon + 3, _UNLIMITED)
            least[2:-1], most[2:-1] = lower[2], upper[2]
            matrix = np.vstack((states[1:].reshape(-1, horizon + 3), rows @ states[0]))
            low = np.concatenate((np.tile(lower[:2], horizon), rows @ error - width))
            high = np.concatenate((np.tile(upper[:2], horizon), rows @ error + width))
            solver = piqp.DenseSolver()
            solver.setup(
                cost, np.zeros(horizon + 3), end, np.zeros(2), np.asfortranarray(matrix), low, high, least, most
            )
            if solver.solve() == piqp.PIQP_SOLVED:
                found = np.array(solver.result.x)
                return float(found[2] + gain @ (error - found[:2]))
        return None
