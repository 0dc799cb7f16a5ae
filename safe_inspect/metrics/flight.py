"""Metrics of an agent's trajectory: fuel, time, range and speed."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from safe_inspect.geometry.distance import lengths
from safe_inspect.metrics.base import Metric, Reduce, over_both
from safe_inspect.plugins.plugin import EntityName
from safe_inspect.simulators.view import DECISION, REMAINING, Step, View
from safe_inspect.types import FloatArray
from safe_inspect.units import PositiveForce


class DeltaV(Metric):
    """Velocity change: the sum of abs(u_i) dt / m over axes and steps; shape (R,)."""

    unit: ClassVar[str] = "m/s"
    reduce: ClassVar[Reduce] = "last"

    def __call__(self, step: Step) -> FloatArray:
        """Return the velocity change since the reset [m/s], shape (R,)."""
        return np.array(step.after.delta_v)


class EpisodeLength(Metric):
    """Number of steps until the agent's episode ends; shape (R,)."""

    unit: ClassVar[str] = "steps"
    reduce: ClassVar[Reduce] = "sum"
    over_agents: ClassVar = "max"

    def __call__(self, step: Step) -> FloatArray:
        """Return 1, shape (R,)."""
        return np.ones(step.after.num_rows)


class Decisions(Metric):
    """Number of decisions, fewer than steps if an action lasts for several of them; shape (R,)."""

    unit: ClassVar[str] = "decisions"
    reduce: ClassVar[Reduce] = "sum"
    over_agents: ClassVar = "mean"

    def __call__(self, step: Step) -> FloatArray:
        """Return 1 in the rows with a new action in this step, otherwise 0, shape (R,)."""
        if not step.before.group.decides:
            return np.ones(step.after.num_rows)
        return np.asarray(step.before.memory(DECISION, REMAINING) == 0, dtype=np.float64)


class SmallestRange(Metric):
    """Smallest distance from a body's centre, at the initial state and after the steps; shape (R,).

    Attributes:
        entity_name: Name of the body.
    """

    unit: ClassVar[str] = "m"
    reduce: ClassVar[Reduce] = "min"

    entity_name: EntityName = "chief"

    def __call__(self, step: Step) -> FloatArray:
        """Return the distance [m], shape (R,)."""
        return over_both(step, step.first, self._range, np.minimum)

    def _range(self, view: View) -> FloatArray:
        return lengths(view.position - view.entity_position(self.entity_name))


class LargestRange(Metric):
    """Largest distance from a body's centre, at the initial state and after the steps; shape (R,).

    Attributes:
        entity_name: Name of the body.
    """

    unit: ClassVar[str] = "m"
    reduce: ClassVar[Reduce] = "max"

    entity_name: EntityName = "chief"

    def __call__(self, step: Step) -> FloatArray:
        """Return the distance [m], shape (R,)."""
        return over_both(step, step.first, self._range, np.maximum)

    def _range(self, view: View) -> FloatArray:
        return lengths(view.position - view.entity_position(self.entity_name))


class LargestSpeed(Metric):
    """Largest speed relative to a body, at the initial state and after the steps; shape (R,).

    Attributes:
        entity_name: Name of the body.
    """

    unit: ClassVar[str] = "m/s"
    reduce: ClassVar[Reduce] = "max"

    entity_name: EntityName = "chief"

    def __call__(self, step: Step) -> FloatArray:
        """Return the speed in the rotating Hill frame [m/s], shape (R,)."""
        return over_both(step, step.first, self._speed, np.maximum)

    def _speed(self, view: View) -> FloatArray:
        return lengths(view.velocity - view.entity_velocity(self.entity_name))


class ThrustingSteps(Metric):
    """Number of steps with thrust; shape (R,).

    Attributes:
        threshold: A step counts if the sum of abs(u_i) exceeds this value [N].
    """

    unit: ClassVar[str] = "steps"
    reduce: ClassVar[Reduce] = "sum"

    threshold: PositiveForce = 1e-3

    def __call__(self, step: Step) -> FloatArray:
        """Return 1 in the rows with thrust, otherwise 0, shape (R,)."""
        return np.where(step.total_thrust > self.threshold, 1.0, 0.0)
