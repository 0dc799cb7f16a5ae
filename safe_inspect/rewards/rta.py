"""The price of being corrected by run-time assurance."""

from __future__ import annotations

import numpy as np

from safe_inspect.rewards.base import Reward
from safe_inspect.simulators.view import Step
from safe_inspect.types import FloatArray


class InspectionRTAReward(Reward):
    """Pay `scale` in a step in which a safety filter changed the thrust; shape (R,).

    Attributes:
        scale: Reward of an intervention, a negative number [-].
    """

    scale: float = -0.01

    def __call__(self, step: Step) -> FloatArray:
        """Return scale in the rows with an intervention, else 0, shape (R,)."""
        return np.where(step.intervening, self.scale, 0.0)
