"""Planners of the approach."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from pydantic import Field

from safe_inspect.rendezvous.plugins.base import ApproachPlanner, DataFile

if TYPE_CHECKING:
    from safe_inspect.rendezvous.planner.query import Plan, PlanQuery


class SplineSCPPlanner(ApproachPlanner):
    """Splines of degree five by sequential convex programming, with a certificate of clearance between the samples.

    Attributes:
        control_points: Control points of each axis.
        samples: Samples at which the constraints are held.
        multi_start: Whether bent splines are tried too where the cheapest one leads to a plan.
        table: File of solved approaches (`PlanTable.save`), whose neighbours of a query are further starts; null for
            none.
    """

    control_points: int = Field(default=20, ge=8)
    samples: int = Field(default=121, ge=11)
    multi_start: bool = False
    table: DataFile | None = None

    def __call__(self, query: PlanQuery) -> Plan:
        """Return a plan, whose status says if it may be flown."""
        from safe_inspect.rendezvous.planner.approach import PlannerOptions, plan_approach
        from safe_inspect.rendezvous.planner.table import read_table

        starts = None if self.table is None else read_table(Path(self.table))
        return plan_approach(query, PlannerOptions(self.control_points, self.samples, self.multi_start, starts=starts))


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
