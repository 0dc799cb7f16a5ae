"""Units that scale an approach of any size to that of Astrobee, for which the optimiser is tuned.

The unit of length is the length of the scenario. The unit of mass is such that the chaser has the mass of Astrobee, and
the unit of time such that its largest planned acceleration is that of Astrobee. The trust region, weights and steps of
the optimiser then apply.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from safe_inspect.geometry.oriented_boxes import OrientedBoxes
from safe_inspect.rendezvous.planner.problem import sampled_plan
from safe_inspect.rendezvous.planner.query import Limits, Plan, PlanQuery
from safe_inspect.rendezvous.planner.spline import SplinePath, spline_basis

_ROOM = Limits()


@dataclass(frozen=True, eq=False)
class PlanUnits:
    """The units for a query.

    Attributes:
        original: The query.
        query: The query in these units, with a length of 1.
        length: The unit of length [m].
        mass: The unit of mass [kg].
        time: The unit of time [s].
    """

    original: PlanQuery
    query: PlanQuery
    length: float
    mass: float
    time: float

    @classmethod
    def of(cls, query: PlanQuery) -> PlanUnits:
        """Return the units for a query."""
        limits, length = query.limits, query.length
        mass = limits.mass / _ROOM.mass
        time = float(np.sqrt(length * (_ROOM.planned_force / _ROOM.mass) / (limits.planned_force / limits.mass)))
        force = mass * length / time**2
        boxes, margin = query.boxes, query.margin
        scaled = replace(
            query,
            t0=query.t0 / time,
            state=query.state / np.repeat((length, length / time), 3),
            angular_velocity=query.angular_velocity * time,
            mating_point=query.mating_point / length,
            boxes=OrientedBoxes(boxes.centre / length, boxes.half_size / length, boxes.rotation),
            limits=replace(
                limits,
                speed=limits.speed * time / length,
                planned_force=limits.planned_force / force,
                force=limits.force / force,
                keep_in=None if limits.keep_in is None else limits.keep_in / length,
                radius=limits.radius / length,
                line_of_sight_rate=limits.line_of_sight_rate * time,
                mass=limits.mass / mass,
                cone_range=limits.cone_range / length,
                least_range=limits.least_range / length,
            ),
            margin=lambda times: margin(time * times) / length,
            durations=tuple(duration / time for duration in query.durations),
            waits=tuple(wait / time for wait in query.waits),
            mean_motion=query.mean_motion * time,
            length=1.0,
            step=query.step / time,
        )
        return cls(query, scaled, length, mass, time)

    def restored(self, plan: Plan, seconds: float) -> Plan:
        """Return a plan in these units converted to metres, kilograms and seconds.

        Args:
            plan: The plan in these units.
            seconds: Computing time [s].
        """
        wait = _nearest(self.original.waits, self.time * (plan.t_start - self.query.t0))
        duration = _nearest(self.original.durations, self.time * plan.duration)
        message = plan.report.message and f"{plan.report.message} (in units of {self.length:g} m and {self.time:.3g} s)"
        report = replace(
            plan.report,
            message=message,
            cost=plan.report.cost * (self.mass * self.length / self.time**2) ** 2 * self.time,
            violation=plan.report.violation * self.length,
            clearance=plan.report.clearance * self.length,
            seconds=seconds,
        )
        if not isinstance(plan.path, SplinePath):
            return Plan(plan.status, self.original.t0 + wait, duration, report=report)
        points = plan.path.points * self.length
        path = SplinePath(spline_basis(len(points), len(plan.times), float(duration)), points)
        return sampled_plan(self.original, path, wait, report)


def _nearest(values: tuple[float, ...], wanted: float) -> float:
    """Return the nearest value if it differs only by the rounding errors of a change of units, else `wanted`."""
    found = min(values, key=lambda value: abs(value - wanted))
    return found if abs(found - wanted) < 1e-6 * max(1.0, wanted) else wanted
