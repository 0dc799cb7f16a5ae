"""A tracker of one's own."""

import numpy as np

from safe_inspect.rendezvous.interfaces import TrackerOutput, design_without_tube
from safe_inspect.rendezvous.plugins import Tracker
from safe_inspect.units import PositiveAngularRate


class ProportionalDerivativeTracker(Tracker, name="PDTracker"):
    """Proportional-derivative control about the reference, critically damped, with clipped force.

    Attributes:
        frequency: Natural frequency of the closed loop [rad/s].
    """

    frequency: PositiveAngularRate = 0.5

    def design(self, request):
        """Return a tube of no width: the plan keeps 2 % of the scenario's length beyond the chaser's radius."""
        return design_without_tube(request)

    def __call__(self, design):
        """Return the tracker of one approach."""
        return _Run(design.axis, design.limits.force, self.frequency)


class _Run:
    """``u = u_r - m (w^2 (p - p_r) + 2 w (v - v_r))``, clipped."""

    def __init__(self, axis, force, frequency):
        self.axis, self.force = axis, force
        self.gain = -axis.mass * np.array([frequency**2, 2.0 * frequency])

    def step(self, estimate, reference, k):
        """Return the force at step k of the reference, for position and velocity in W, shape (6,)."""
        error = estimate.reshape(2, 3).T - np.stack((reference.position[k], reference.velocity[k]), axis=1)
        force = np.clip(reference.feed_forward(self.axis)[k] + error @ self.gain, -self.force, self.force)
        return TrackerOutput(force, outside=error[:, 0])  # a tube of no width
