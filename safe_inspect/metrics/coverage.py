"""Metrics of coverage: inspected points, and the time and velocity change that they required."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from pydantic import Field

from safe_inspect.metrics.base import Metric, Reduce, TeamMetric
from safe_inspect.plugins.plugin import PointsName
from safe_inspect.simulators.team import TeamStep
from safe_inspect.simulators.view import Step
from safe_inspect.types import FloatArray


class TimeToCoverage(TeamMetric):
    """Time at which the team has inspected a fraction of the points, NaN if it does not; shape (N,).

    Attributes:
        fraction: Required fraction of the points [-], in (0, 1].
        inspection_entity_name: Name of the body with the points.
    """

    unit: ClassVar[str] = "s"
    reduce: ClassVar[Reduce] = "min"

    fraction: float = Field(default=0.9, gt=0, le=1)
    inspection_entity_name: PointsName = "chief"

    @property
    def label(self) -> str:
        """Name of the metric in tables."""
        return f"time to {100 * self.fraction:g} %"

    def __call__(self, step: TeamStep) -> FloatArray:
        """Return the time since the reset where the fraction is reached [s], otherwise NaN, shape (N,)."""
        name = self.inspection_entity_name
        wanted = self.fraction * step.after.world.points[name].num_points - 1e-9
        reached = step.after.state.points[name].team_count >= wanted
        begun = (step.before.step == 0) & (step.before.state.points[name].team_count >= wanted)
        now = np.where(reached, step.after.state.time, np.nan)
        return np.where(begun, step.before.state.time, now)


class DeltaVToCoverage(Metric):
    """Velocity change that the agent has used when the team has inspected a fraction of the points; shape (R,).

    Attributes:
        fraction: Required fraction of the points [-], in (0, 1].
        inspection_entity_name: Name of the body with the points.
    """

    unit: ClassVar[str] = "m/s"
    reduce: ClassVar[Reduce] = "min"
    over_agents: ClassVar = "mean"

    fraction: float = Field(default=0.9, gt=0, le=1)
    inspection_entity_name: PointsName = "chief"

    @property
    def label(self) -> str:
        """Name of the metric in tables."""
        return f"delta-v to {100 * self.fraction:g} %"

    def __call__(self, step: Step) -> FloatArray:
        """Return the velocity change where the fraction is reached [m/s], otherwise NaN, shape (R,)."""
        points = step.after.points(self.inspection_entity_name)
        return np.where(points.count >= self.fraction * points.num_points - 1e-9, step.after.delta_v, np.nan)


class DeltaVAfterLastPoint(Metric):
    """Velocity change that is used after the step in which the team inspected its last new point; shape (R,).

    Attributes:
        inspection_entity_name: Name of the body with the points.
    """

    unit: ClassVar[str] = "m/s"
    reduce: ClassVar[Reduce] = "last"

    inspection_entity_name: PointsName = "chief"

    @property
    def label(self) -> str:
        """Name of the metric in tables."""
        return "delta-v after last point"

    def __call__(self, step: Step) -> FloatArray:
        """Return the velocity change so far in steps with new points [m/s], otherwise NaN, shape (R,)."""
        return np.where(step.new_points(self.inspection_entity_name) > 0, step.after.delta_v, np.nan)

    def conclude(self, value: FloatArray, step: Step) -> FloatArray:
        """Return the velocity change since the last new point [m/s], or the total if there was none, shape (R,)."""
        return np.asarray(step.after.delta_v - np.where(np.isnan(value), 0.0, value))
