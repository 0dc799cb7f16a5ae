"""A policy that is written, not trained."""

import numpy as np

from safe_inspect.policies import ScriptedPolicy


class BrakingPolicy(ScriptedPolicy):
    """Thrust against the velocity, so that it would be gone after `steps` steps.

    Attributes:
        steps: Number of steps to stop in.
    """

    steps: int = 5

    def __call__(self, view, limits):
        """Return -m v / (steps dt) within the limits [N], shape (R, 3)."""
        wanted = -view.mass[:, None] * view.velocity / (self.steps * view.world.step_size)
        return np.clip(wanted, limits.low, limits.high)
