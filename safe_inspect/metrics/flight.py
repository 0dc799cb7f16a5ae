"""Metrics of an agent's flight: fuel, time, range and speed, safety, and errors of what it knows."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from safe_inspect.geometry.distance import lengths
from safe_inspect.metrics.base import Metric, Reduce
from safe_inspect.plugins.functor import functor_field
from safe_inspect.plugins.plugin import EntityName
from safe_inspect.rta.constraints import Constraint, RelativeState
from safe_inspect.rta.constraints.ranges import ChiefCollision
from safe_inspect.rta.constraints.sets import name_of
from safe_inspect.simulators.view import DECISION, REMAINING, Step, View
from safe_inspect.types import FloatArray
from safe_inspect.units import PositiveForce


def _extreme(step: Step, measure: Callable[[View], FloatArray], choose: Callable[..., Any]) -> FloatArray:
    """Return a measure of the state after the step, in first steps combined with that of the initial state.

    Args:
        step: The step.
        measure: Function from a state to a value for each row.
        choose: ``np.minimum`` or ``np.maximum``, which combines the two values.
    """
    after, first = measure(step.after), step.before.step == 0
    if not first.any():
        return after
    return np.where(first, choose(measure(step.before), after), after)


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
        return _extreme(step, lambda view: _range(view, self.entity_name), np.minimum)


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
        return _extreme(step, lambda view: _range(view, self.entity_name), np.maximum)


def _range(view: View, entity: str) -> FloatArray:
    return lengths(view.position - view.entity_position(entity))


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
        return _extreme(step, lambda view: lengths(view.velocity - view.entity_velocity(self.entity_name)), np.maximum)


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


class Interventions(Metric):
    """Number of steps in which a safety filter changed the agent's thrust; shape (R,)."""

    unit: ClassVar[str] = "steps"
    reduce: ClassVar[Reduce] = "sum"

    def __call__(self, step: Step) -> FloatArray:
        """Return 1 in the rows with an intervention, otherwise 0, shape (R,)."""
        return np.where(step.intervening, 1.0, 0.0)


class InterventionShare(Metric):
    """Fraction of the steps in which a safety filter changed the agent's thrust [-]; shape (R,)."""

    reduce: ClassVar[Reduce] = "mean"

    def __call__(self, step: Step) -> FloatArray:
        """Return 1 in the rows with an intervention, otherwise 0, shape (R,)."""
        return np.where(step.intervening, 1.0, 0.0)


class SmallestPhi(Metric):
    """Smallest plain safety quantity phi of a constraint, at the initial state and after the steps; shape (R,).

    A value below 0 is a violation. Only the states matter, not whether a filter is enabled.

    Attributes:
        constraint: The constraint, with its parameters.
        about: Body relative to which the constraint is evaluated: the ``chief``, or each of the other ``deputies``, of
            which the smallest value counts; NaN if there are none.
    """

    reduce: ClassVar[Reduce] = "min"

    constraint: functor_field("constraint") = Field(default_factory=ChiefCollision)  # type: ignore[valid-type]
    about: Literal["chief", "deputies"] = "chief"

    @property
    def unit(self) -> str:  # type: ignore[override]
        """Unit of the constraint's quantity."""
        return str(self.constraint.unit)  # type: ignore[attr-defined]

    @property
    def label(self) -> str:
        """Name of the metric in tables."""
        return f"phi {name_of(self.constraint)}"  # type: ignore[arg-type]

    def __call__(self, step: Step) -> FloatArray:
        """Return phi, shape (R,)."""
        return _extreme(step, self._phi, np.minimum)

    def _phi(self, view: View) -> FloatArray:
        constraint: Any = self.constraint
        assert isinstance(constraint, Constraint), "the field only accepts constraints"
        if self.about == "chief":
            return constraint.phi(RelativeState(view.position, view.velocity, view.sun_angle))
        least = np.full(view.num_rows, np.nan)
        for other in range(view.world.num_deputies - 1):
            position = view.position - view.others_position[:, other]
            velocity = view.velocity - view.others_velocity[:, other]
            least = np.fmin(least, constraint.phi(RelativeState(position, velocity, view.sun_angle)))
        return least


class ReadingError(Metric):
    """Mean length of the difference that a sensor's `errors` make to its reading after the steps; shape (R,).

    Attributes:
        sensor: Name of the sensor.
        symbol: SI unit of the reading.
    """

    reduce: ClassVar[Reduce] = "mean"

    sensor: str = Field(default="Sensor_Position", min_length=1)
    symbol: str = "-"

    @property
    def unit(self) -> str:  # type: ignore[override]
        """Unit of the reading."""
        return self.symbol or "-"

    @property
    def label(self) -> str:
        """Name of the metric in tables."""
        return f"error of {self.sensor}"

    def __call__(self, step: Step) -> FloatArray:
        """Return the length of the difference, NaN for agents without that sensor, shape (R,)."""
        view = step.after
        sensor: Any = view.group.sensors.get(self.sensor)
        if sensor is None:
            return np.full(view.num_rows, np.nan)
        return lengths(view.reading(self.sensor) - getattr(sensor, "truth", sensor)(view))


class EstimateError(Metric):
    """Mean distance between the estimated and the real state after the steps, 0 without an estimate; shape (R,).

    Attributes:
        quantity: ``position`` [m] or ``velocity`` [m/s].
    """

    reduce: ClassVar[Reduce] = "mean"

    quantity: Literal["position", "velocity"] = "position"

    @property
    def unit(self) -> str:  # type: ignore[override]
        """Unit of the quantity."""
        return "m" if self.quantity == "position" else "m/s"

    @property
    def label(self) -> str:
        """Name of the metric in tables."""
        return f"error of estimated {self.quantity}"

    def __call__(self, step: Step) -> FloatArray:
        """Return the distance, shape (R,)."""
        view, name = step.after, f"estimated_{self.quantity}"
        if name not in view.world.offers.view:
            return np.zeros(view.num_rows)
        return lengths(getattr(view, name) - getattr(view, self.quantity))
