"""Glues of the action: the command of a controller, one of its levels, and the duration of a decision."""

from __future__ import annotations

from functools import cached_property
from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from safe_inspect.glues.base import ActionGlue, Bounds, Parts, controller_of
from safe_inspect.glues.normalizers import Normalization
from safe_inspect.plugins.plugin import ControllerName
from safe_inspect.types import FloatArray, IntArray
from safe_inspect.units import Force


class ControllerGlue(ActionGlue):
    """The command of a controller, in the normaliser's range, or in SI units without normalisation.

    Attributes:
        controller: Name of the controller.
        normalization: Mapping of the action to the controller's limits; from [-1, 1] by default.
    """

    controller: ControllerName = "RateController"
    normalization: Normalization = Normalization()

    def names(self, parts: Parts) -> tuple[str, ...]:
        """Return the controller's name, with an index if the controller takes several values."""
        size = controller_of(parts, self.controller).size
        return (self.controller,) if size == 1 else tuple(f"{self.controller}.{index}" for index in range(size))

    def bounds(self, parts: Parts) -> Bounds:
        """Return the bounds of the action.

        Raises:
            ValueError: The normaliser does not match the controller.
        """
        return self.normalization.bounds(*controller_of(parts, self.controller).limits)

    def __call__(self, action: FloatArray, parts: Parts) -> FloatArray:
        """Return the controller's part of the thrust [N], shape (R, 3), or of the control [N, N m], shape (R, 6)."""
        controller = controller_of(parts, self.controller)
        normalizer = self.normalization.active
        return controller(action if normalizer is None else normalizer.inverse(action, *controller.limits))


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


class CoastGlue(ActionGlue):
    """Duration of a decision: the other action glues apply thrust for one control step, then the deputy coasts.

    The action has one more element, the index of a duration. Combined with continuous thrust it is a real number
    that is rounded to the nearest index. While the deputy coasts, thrust and, for a vehicle with attitude, moment are
    zero. Simulation, rewards, dones and safety filter are still evaluated at every control step. A step in which the
    safety filter intervenes is the last step of its decision. The glue must come after the glues of the controllers.

    Attributes:
        durations: Possible durations of a decision [control steps], including the step with thrust, in ascending order.
    """

    durations: tuple[Annotated[int, Field(ge=1)], ...] = (1, 2, 4, 8, 16, 32, 64)

    @model_validator(mode="after")
    def _ascending(self) -> CoastGlue:
        if not self.durations:
            raise ValueError("`durations` is empty; give one or more numbers of control steps")
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
