"""What an evaluation measures besides."""

from typing import ClassVar

import numpy as np

from safe_inspect.metrics import Metric, TeamMetric


class PathLength(Metric):
    """Length of the way that a deputy has flown, from step to step; shape (R,)."""

    unit: ClassVar[str] = "m"
    reduce: ClassVar[str] = "sum"

    def __call__(self, step):
        """Return the length of this step's way [m], shape (R,)."""
        return np.sqrt(((step.after.position - step.before.position) ** 2).sum(axis=-1))


class TeamSpread(TeamMetric):
    """Largest distance of two deputies; shape (N,)."""

    unit: ClassVar[str] = "m"
    reduce: ClassVar[str] = "max"

    def __call__(self, step):
        """Return the largest distance at the end of the step [m], shape (N,); NaN for one deputy."""
        distance = step.after.distance
        return distance.max(axis=1) if distance.shape[1] else np.full(len(distance), np.nan)
