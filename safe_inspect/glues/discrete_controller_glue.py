"""`DiscreteControllerGlue`: a part of the action that selects one of a few levels of a controller."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from pydantic import Field, model_validator

from safe_inspect.glues.base import ActionGlue, Bounds, Parts, controller_of
from safe_inspect.plugins.plugin import ControllerName
from safe_inspect.types import FloatArray
from safe_inspect.units import Force


class DiscreteControllerGlue(ActionGlue):
    """The command of a controller as one of a few levels; the action is the index of the level, from 0.

    The action space is Gymnasium's `MultiDiscrete`, and RLlib's policies sample from categorical distributions. An
    environment rejects an action that is not an integer or is out of range. Either all action glues of an agent are of
    this class, or none is. A few levels of small thrust performed best at inspection in Hamilton et al., Investigating
    the Impact of Choice on Deep Reinforcement Learning for Space Controls, 2024 (arXiv 2405.12355).

    Attributes:
        controller: Name of the controller, which must take one value.
        levels: The levels [N] in ascending order; include 0 so that the deputy can coast.
    """

    controller: ControllerName = "RateController"
    levels: tuple[Force, ...] = Field(default=(-1.0, 0.0, 1.0), min_length=2)

    @model_validator(mode="after")
    def _rising(self) -> DiscreteControllerGlue:
        if any(second <= first for first, second in zip(self.levels, self.levels[1:], strict=False)):
            raise ValueError(f"`levels` {list(self.levels)} must be in ascending order, without repetitions")
        return self

    @cached_property
    def table(self) -> FloatArray:
        """The levels [N], shape (K,)."""
        return np.array(self.levels)

    def names(self, parts: Parts) -> tuple[str, ...]:
        """Return the controller's name."""
        return (self.controller,)

    def choices(self, parts: Parts) -> tuple[int, ...]:
        """Return the number of levels."""
        return (len(self.levels),)

    def bounds(self, parts: Parts) -> Bounds:
        """Return the first and the last index.

        Raises:
            ValueError: A level exceeds the controller's limits, or the controller takes several values.
        """
        controller = controller_of(parts, self.controller)
        if controller.size != 1:
            raise ValueError(f"{self.controller!r} takes {controller.size} values, but `levels` can only command one")
        low, high = (float(limit[0]) for limit in controller.limits)
        for level in self.levels:
            if not low <= level <= high:
                raise ValueError(
                    f"the level {level:g} N exceeds the range of {self.controller!r}, {low:g} to {high:g} N; "
                    "change `levels`, or `low` and `high` of the controller's property"
                )
        return np.zeros(1), np.array([len(self.levels) - 1.0])

    def __call__(self, action: FloatArray, parts: Parts) -> FloatArray:
        """Return the controller's part of the thrust [N], Hill frame, shape (R, 3), for indices of shape (R, 1)."""
        index = np.minimum(np.maximum(np.rint(action), 0.0), len(self.levels) - 1.0).astype(np.int64)
        return controller_of(parts, self.controller)(self.table[index])
