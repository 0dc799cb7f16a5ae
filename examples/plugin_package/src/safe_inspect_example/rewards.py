"""A price for flying too fast."""

import numpy as np

from safe_inspect.rewards import Reward
from safe_inspect.units import NonNegativeSpeed


class SpeedLimitReward(Reward):
    """Pay `scale` for every m/s above the `limit`: scale * max(0, |velocity| - limit); shape (R,).

    Attributes:
        scale: Reward of 1 m/s too much, a negative number [1/(m/s)].
        limit: Largest speed that costs nothing [m/s].
    """

    scale: float = -0.1
    limit: NonNegativeSpeed = 0.5

    def __call__(self, step):
        """Return the price of each row's speed, shape (R,)."""
        speed = np.sqrt((step.after.velocity**2).sum(axis=-1))
        return self.scale * np.maximum(0.0, speed - self.limit)
