"""Base classes of the metrics."""

from __future__ import annotations

import re
from abc import abstractmethod
from typing import ClassVar, Literal

from safe_inspect.plugins.plugin import Plugin
from safe_inspect.simulators.team import TeamStep
from safe_inspect.simulators.view import Step
from safe_inspect.types import FloatArray

#: How the values of an episode's steps are reduced to one number.
Reduce = Literal["sum", "max", "min", "last", "mean"]


class BaseMetric(Plugin):
    """Base class of metrics. A metric is called at every step; its values are reduced to one number per episode.

    A metric has no state and must not modify its arguments. NaN means "nothing to measure in this step" and is ignored;
    an episode without any value has the result NaN.

    Class attributes:
        unit: Unit of the number; ``-`` for a dimensionless number. A property if it depends on the fields.
        reduce: Reduction of the values of the steps to one number: ``sum``, ``max``, ``min``, ``mean`` or ``last``.
        over_agents: Reduction of the numbers of several agents to one of the team. Default: that of `reduce`, or the
            mean for ``last``.
    """

    kind: ClassVar[str] = "metric"
    unit: ClassVar[str] = "-"
    reduce: ClassVar[Reduce]
    over_agents: ClassVar[Literal["sum", "max", "min", "mean"] | None] = None

    @property
    def label(self) -> str:
        """Name of the metric in tables and files. By default the words of the class name."""
        words = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", " ", self.registered_name)
        return words.lower().replace("delta v", "delta-v")

    @property
    def team_reduce(self) -> Literal["sum", "max", "min", "mean"]:
        """Reduction of the numbers of several agents to one of the team."""
        return self.over_agents or ("mean" if self.reduce == "last" else self.reduce)


class Metric(BaseMetric):
    """Base class of metrics of an agent. Called with a `Step`, one returns a value for each row, shape (R,)."""

    @abstractmethod
    def __call__(self, step: Step) -> FloatArray:
        """Return a value for each row, NaN where there is nothing to measure, shape (R,)."""

    def conclude(self, value: FloatArray, step: Step) -> FloatArray:
        """Return the final number of each row's episode, shape (R,), if it ends in this step. Default: `value`.

        Args:
            value: Reduced value of the episode's steps, NaN if there is none, shape (R,).
            step: The last step; rows whose episodes do not end in it are ignored.
        """
        return value


class TeamMetric(BaseMetric):
    """Base class of metrics of an environment. Called with a `TeamStep`, one returns a value for each, shape (N,).

    The fields `fired` and `has` of the step are empty.
    """

    @abstractmethod
    def __call__(self, step: TeamStep) -> FloatArray:
        """Return a value for each environment, NaN where there is nothing to measure, shape (N,)."""
