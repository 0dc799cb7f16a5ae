"""Units in which an approach of any size looks like one of a free flyer in a room, for which the optimiser is set.

The unit of length is the scenario's, that of mass is such that the chaser has Astrobee's, and that of time such that
the largest planned acceleration is Astrobee's too: trust region, weights and steps of the optimiser then fit.
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
    """The units of a query.

    Attributes:
        original: The query.
        query: The same in these units, of length 1.
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
        """Return the units of a query."""
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
        """Return a plan of these units in metres, kilograms and seconds.

        Args:
            plan: The plan.
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
    """Return the value that is nearest, which differs by the rounding of a change of units; else what is wanted."""
    found = min(values, key=lambda value: abs(value - wanted))
    return found if abs(found - wanted) < 1e-6 * max(1.0, wanted) else wanted
