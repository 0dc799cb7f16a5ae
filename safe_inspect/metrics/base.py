"""Bases of the metrics."""

from __future__ import annotations

import re
from abc import abstractmethod
from collections.abc import Callable
from typing import Any, ClassVar, Literal, TypeVar

import numpy as np

from safe_inspect.plugins.plugin import Plugin
from safe_inspect.simulators.team import TeamStep
from safe_inspect.simulators.view import Step
from safe_inspect.types import BoolArray, FloatArray

#: How the values of an episode's steps become one number.
Reduce = Literal["sum", "max", "min", "last", "mean"]

Seen = TypeVar("Seen")


class BaseMetric(Plugin):
    """Measures an episode: called at every step, its values are reduced to one number.

    A metric has no memory and changes nothing that it is given. NaN means "nothing to measure in this step" and is
    left out; an episode without any value is NaN.

    Class attributes:
        unit: Unit of the number; ``-`` for a pure number. A property where it depends on the fields.
        reduce: How the values of the steps become one number: their ``sum``, ``max``, ``min``, ``mean``, or the
            ``last`` of them.
        over_agents: How the numbers of several agents become the team's; as `reduce` says unless given, and the mean
            for ``last``.
    """

    kind: ClassVar[str] = "metric"
    unit: ClassVar[str] = "-"
    reduce: ClassVar[Reduce]
    over_agents: ClassVar[Literal["sum", "max", "min", "mean"] | None] = None

    @property
    def label(self) -> str:
        """Name of the metric in tables and files; the class name in words unless it is overridden."""
        words = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", " ", self.registered_name)
        return words.lower().replace("delta v", "delta-v")

    @property
    def team_reduce(self) -> Literal["sum", "max", "min", "mean"]:
        """How the numbers of several agents become the team's."""
        return self.over_agents or ("mean" if self.reduce == "last" else self.reduce)


class Metric(BaseMetric):
    """Measures every agent: called with a `Step`, it returns a value of each row, shape (R,)."""

    @abstractmethod
    def __call__(self, step: Step) -> FloatArray:
        """Return a value of each row, NaN where there is nothing to measure, shape (R,)."""

    def conclude(self, value: FloatArray, step: Step) -> FloatArray:
        """Return the number of each row's episode, shape (R,), when it ends with this step; as it is by default.

        Args:
            value: What the steps of the episode were reduced to, NaN without any value, shape (R,).
            step: The last step; rows that do not end with it count for nothing.
        """
        return value


class TeamMetric(BaseMetric):
    """Measures every environment: called with a `TeamStep`, it returns a value of each, shape (N,).

    `fired` and `has` of the step are empty.
    """

    @abstractmethod
    def __call__(self, step: TeamStep) -> FloatArray:
        """Return a value of each environment, NaN where there is nothing to measure, shape (N,)."""


def over_both(
    step: Any, first: BoolArray, measure: Callable[[Any], FloatArray], choose: Callable[..., Any]
) -> FloatArray:
    """Return a measure of the state after the step; in first steps that of the beginning counts too.

    Args:
        step: What has `before` and `after`.
        first: Rows in which this is the first step of the episode.
        measure: From a state to a value of each row.
        choose: ``np.minimum`` or ``np.maximum``.
    """
    after = measure(step.after)
    if not first.any():
        return after
    return np.where(first, choose(measure(step.before), after), after)
