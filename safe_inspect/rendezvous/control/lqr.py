"""Linear-quadratic regulator about the reference, with clipped force: for comparison, and for holding a position."""

from __future__ import annotations

import numpy as np

from safe_inspect.rendezvous.control.axis import Axis
from safe_inspect.rendezvous.control.design import DesignRequest, TubeDesign, design_without_tube
from safe_inspect.rendezvous.control.gains import TrackingWeights, lqr_gain
from safe_inspect.rendezvous.control.tightening import TrackedReference
from safe_inspect.rendezvous.control.tracker import AxisStatus, Tracker, TrackerOutput
from safe_inspect.types import FloatArray


class LQRTracker(Tracker):
    """Linear-quadratic regulator about the reference, with clipped force and without a tube."""

    def design(self, request: DesignRequest) -> TubeDesign:
        """Return a design whose tube has zero width."""
        return design_without_tube(request)

    def __call__(self, design: TubeDesign) -> LQRTrackerRun:
        """Return the tracker for one approach."""
        return LQRTrackerRun(design.axis, design.limits.force)


class LQRTrackerRun:
    """Linear-quadratic regulator of one approach: ``u = u_r + K (x_hat - r_hat)``, clipped."""

    def __init__(self, axis: Axis, force: float = 0.30, weights: TrackingWeights | None = None) -> None:
        """Compute the gain.

        Args:
            axis: Dynamics of each axis.
            force: Maximum force along each axis [N].
            weights: Weights of the cost; by default `TrackingWeights.of_force` of this force.
        """
        self.axis, self.force = axis, force
        self.gain = lqr_gain(axis, weights or TrackingWeights.of_force(force))

    def step(self, estimate: FloatArray, reference: TrackedReference, k: int) -> TrackerOutput:
        """Return the force at step k of the reference, for an estimate (position, velocity) in W, shape (6,)."""
        error = np.asarray(estimate).reshape(2, 3).T - np.stack((reference.position[k], reference.velocity[k]), axis=1)
        tide = None if reference.tide is None else reference.tide[k : k + 2]
        two = TrackedReference(reference.position[k : k + 2], reference.velocity[k : k + 2], tide)
        demand = two.feed_forward(self.axis)[0] + error @ self.gain
        force = np.clip(demand, -self.force, self.force)
        return TrackerOutput(force, error, np.zeros(3), (AxisStatus.SOLVED,) * 3)
