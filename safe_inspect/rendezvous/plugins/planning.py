"""Planners of the approach."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pydantic import Field

from safe_inspect.rendezvous.plugins.base import ApproachPlanner

if TYPE_CHECKING:
    from safe_inspect.rendezvous.planner.query import Plan, PlanQuery


class SplineSCPPlanner(ApproachPlanner):
    """Splines of degree five by sequential convex programming, with a certificate of clearance between the samples.

    Attributes:
        control_points: Control points of each axis.
        samples: Samples at which the constraints are held.
        multi_start: Whether bent splines are tried too where the cheapest one leads to a plan.
    """

    control_points: int = Field(default=20, ge=8)
    samples: int = Field(default=121, ge=11)
    multi_start: bool = False

    def __call__(self, query: PlanQuery) -> Plan:
        """Return a plan, whose status says if it may be flown."""
        from safe_inspect.rendezvous.planner.approach import PlannerOptions, plan_approach

        return plan_approach(query, PlannerOptions(self.control_points, self.samples, self.multi_start))


class SLSQPPlanner(ApproachPlanner):
    """The same splines by SciPy's sequential least squares programming, as a cross-check.

    Attributes:
        control_points: Control points of each axis.
        samples: Samples at which the constraints are held.
    """

    control_points: int = Field(default=20, ge=8)
    samples: int = Field(default=61, ge=11)

    def __call__(self, query: PlanQuery) -> Plan:
        """Return a plan, whose status says if it may be flown."""
        from safe_inspect.rendezvous.planner.approach import PlannerOptions, plan_approach
        from safe_inspect.rendezvous.planner.slsqp import optimise_slsqp

        options = PlannerOptions(self.control_points, self.samples, retry=False, optimise=optimise_slsqp)
        return plan_approach(query, options)
