"""`CoastGlue`: the part of an action that sets the duration of a decision in control steps."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from pydantic import model_validator

from safe_inspect.glues.base import ActionGlue, Bounds, Parts
from safe_inspect.types import FloatArray, IntArray


class CoastGlue(ActionGlue):
    """Duration of a decision: the other action glues apply thrust for one control step, then the deputy coasts.

    The action has one more element, the index of a duration. Combined with continuous thrust it is a real number
    that is rounded to the nearest index. While the deputy coasts, thrust and, for a vehicle with attitude, moment are
    zero. Simulation, rewards, dones and safety filter are still evaluated at every control step. A step in which the
    safety filter intervenes is the last step of its decision. The glue must come after the glues of the controllers.

    Attributes:
        durations: Possible durations of a decision [control steps], including the step with thrust, in ascending order.
    """

    durations: tuple[int, ...] = (1, 2, 4, 8, 16, 32, 64)

    @model_validator(mode="after")
    def _ascending(self) -> CoastGlue:
        if not self.durations:
            raise ValueError("`durations` is empty; give one or more numbers of control steps")
        if self.durations[0] < 1:
            raise ValueError(f"a duration must be at least 1 control step, not {self.durations[0]}; change `durations`")
        if any(second <= first for first, second in zip(self.durations, self.durations[1:], strict=False)):
            raise ValueError(f"`durations` {list(self.durations)} must be in ascending order, without repetitions")
        return self

    @cached_property
    def table(self) -> IntArray:
        """The durations in control steps, shape (K,)."""
        return np.array(self.durations, dtype=np.int64)

    def names(self, parts: Parts) -> tuple[str, ...]:
        """Return ``coast``."""
        return ("coast",)

    def choices(self, parts: Parts) -> tuple[int, ...]:
        """Return the number of durations."""
        return (len(self.durations),)

    def bounds(self, parts: Parts) -> Bounds:
        """Return the first and the last index."""
        return np.zeros(1), np.array([len(self.durations) - 1.0])

    def __call__(self, action: FloatArray, parts: Parts) -> FloatArray:
        """Return no thrust [N], shape (R, 3)."""
        return np.zeros((len(action), 3))

    def steps(self, action: FloatArray) -> IntArray:
        """Return the durations of decisions [control steps], shape (R,), for their duration indices, shape (R,)."""
        index = np.minimum(np.maximum(np.rint(action), 0.0), len(self.durations) - 1.0)
        return self.table[index.astype(np.int64)]
