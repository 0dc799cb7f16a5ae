"""Metrics of an agent's safety: interventions, safety quantities and distances."""

from __future__ import annotations

from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from safe_inspect.metrics.base import Metric, Reduce, TeamMetric, over_both
from safe_inspect.plugins.functor import functor_field
from safe_inspect.rta.constraints import Constraint, RelativeState
from safe_inspect.rta.constraints.ranges import ChiefCollision
from safe_inspect.rta.constraints.sets import name_of
from safe_inspect.simulators.team import TeamStep, TeamView
from safe_inspect.simulators.view import Step, View
from safe_inspect.types import FloatArray


class Interventions(Metric):
    """Number of steps in which a safety filter changed the agent's thrust; shape (R,)."""

    unit: ClassVar[str] = "steps"
    reduce: ClassVar[Reduce] = "sum"

    def __call__(self, step: Step) -> FloatArray:
        """Return 1 in the rows with an intervention, otherwise 0, shape (R,)."""
        return np.where(step.intervening, 1.0, 0.0)


class InvalidActions(Metric):
    """Number of steps with a NaN or infinite action, which the safety filter replaced by the backup's; shape (R,)."""

    unit: ClassVar[str] = "steps"
    reduce: ClassVar[Reduce] = "sum"

    def __call__(self, step: Step) -> FloatArray:
        """Return 1 in the rows with an invalid action, otherwise 0, shape (R,)."""
        return np.zeros(step.after.num_rows) if step.invalid is None else np.where(step.invalid, 1.0, 0.0)


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
        return over_both(step, step.first, self._phi, np.minimum)

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


class ClosestDeputies(TeamMetric):
    """Smallest distance between two deputies, at the initial state and after the steps, NaN with one; shape (N,)."""

    unit: ClassVar[str] = "m"
    reduce: ClassVar[Reduce] = "min"

    def __call__(self, step: TeamStep) -> FloatArray:
        """Return the smallest distance between two deputies [m], shape (N,)."""
        return over_both(step, np.asarray(step.before.step == 0), self._distance, np.minimum)

    @staticmethod
    def _distance(team: TeamView) -> FloatArray:
        if team.world.num_deputies < 2:
            return np.full(team.num_envs, np.nan)
        return np.asarray(team.distance.min(axis=1))
