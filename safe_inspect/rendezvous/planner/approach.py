"""The planner, which returns a certified plan for a query: units, ranking of waits, and optimisation."""

from __future__ import annotations

import time
from abc import abstractmethod
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from pydantic import Field

from safe_inspect.plugins.plugin import Plugin
from safe_inspect.rendezvous.planner.checks import certify, possible_waits, start_problem, terminal_problem
from safe_inspect.rendezvous.planner.paths import SplinePath, spline_basis
from safe_inspect.rendezvous.planner.problem import ApproachProblem, approach_problem, approach_problems, sampled_plan
from safe_inspect.rendezvous.planner.query import Limits, Plan, PlanQuery, PlanReport, PlanStatus
from safe_inspect.rendezvous.planner.scp import optimise_scp
from safe_inspect.types import FloatArray

_ROOM = Limits()
_PRICE = 0.05  # N^2 per metre of penetration
_TRIED = 3  # Number of ranked waits and durations to optimise.
#: Sideways bend of the starts that are tried if the cheapest spline does not lead to a plan [m].
_BEND = 0.5


@dataclass(frozen=True, eq=False)
class _PlanUnits:
    """Units that scale an approach of any size to that of Astrobee, for which the optimiser is tuned.

    The unit of length is the length of the scenario. The unit of mass is such that the chaser has the mass of Astrobee,
    and the unit of time such that its largest planned acceleration is that of Astrobee. The trust region, weights and
    steps of the optimiser then apply.

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
    def of(cls, query: PlanQuery) -> _PlanUnits:
        """Return the units for a query."""
        limits, length = query.limits, query.length
        mass = limits.mass / _ROOM.mass
        time = float(np.sqrt(length * (_ROOM.planned_force / _ROOM.mass) / (limits.planned_force / limits.mass)))
        force = mass * length / time**2
        margin = query.margin
        scaled = replace(
            query,
            t0=query.t0 / time,
            state=query.state / np.repeat((length, length / time), 3),
            angular_velocity=query.angular_velocity * time,
            mating_point=query.mating_point / length,
            solid=query.solid.in_units_of(length),
            limits=replace(
                limits,
                speed=limits.speed * time / length,
                planned_force=limits.planned_force / force,
                force=limits.force / force,
                keep_in=limits.keep_in / length,
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
            hold=query.hold / time,
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


def _ranked_problems(query: PlanQuery, count: int, samples: int) -> tuple[list[ApproachProblem], str]:
    """Return the approaches with admissible ends, the most promising first, and why the first of the others is not.

    They are ordered by the cost of the cheapest spline plus 0.05 N^2/m times the integral of its penetration
    max(0, radius + margin - distance).

    Args:
        query: The query.
        count: Number of control points of an axis.
        samples: Number of samples of an approach.
    """
    waits, admissible, reason = possible_waits(query), [], ""
    if not waits:
        return [], "the chaser moves, and it can only wait at rest; include a wait of 0 s"
    for duration in query.durations:
        for problem in approach_problems(query, waits, duration, count, samples):
            wrong = terminal_problem(problem)
            reason = reason or wrong
            if not wrong:
                admissible.append(problem)
    if len(admissible) < 2:
        return admissible, reason
    cold = [problem.cold() for problem in admissible]
    price = []
    for problem, points in zip(admissible, cold, strict=True):
        in_model = np.einsum("kij,kj->ki", problem.R_MW, problem.basis.values[0] @ points)
        lacking = np.maximum(query.limits.radius + problem.margin - query.solid.distance(in_model), 0.0)
        price.append(problem.cost(points) + _PRICE * (lacking.mean() * problem.basis.duration))
    return [admissible[i] for i in np.argsort(price, kind="stable")], reason


class ApproachPlanner(Plugin):
    """Base class of approach planners."""

    kind: ClassVar[str] = "approach_planner"

    @abstractmethod
    def __call__(self, query: PlanQuery) -> Plan:
        """Return a plan, whose status states whether it may be flown."""


class SplineSCPPlanner(ApproachPlanner):
    """Planner of splines of degree five by sequential convex programming, with a certificate of their clearance.

    Waits and durations are ranked by the cost of their cheapest splines. The three best are optimised, starting from
    their cheapest splines and, if that fails, from bent ones.

    Attributes:
        control_points: Number of control points of each axis.
        samples: Number of samples at which the constraints must hold.
        multi_start: Whether to also try bent splines if the cheapest one leads to a plan.
    """

    control_points: int = Field(default=20, ge=8)
    samples: int = Field(default=121, ge=11)
    multi_start: bool = False

    def __call__(self, query: PlanQuery) -> Plan:
        """Return the certified plan with the lowest cost that is found.

        If there is none, the plan's status states why; this is not an exception.

        Raises:
            MissingLibraryError: The solver is not installed.
        """
        began = time.perf_counter()
        if query.length != 1.0:
            units = _PlanUnits.of(query)
            return units.restored(self(units.query), time.perf_counter() - began)
        wrong = start_problem(query)
        if wrong:
            return _without(PlanStatus.START_INFEASIBLE, query, wrong, began)
        problems, wrong = _ranked_problems(query, self.control_points, self.samples)
        if not problems:
            return _without(PlanStatus.TERMINAL_INFEASIBLE, query, wrong, began)
        starts = [(problem, problem.cold()) for problem in problems[:_TRIED]]
        plans = [self._plan_from(*start) for start in starts]
        if self.multi_start or not any(plan.solved for plan in plans):
            plans += [self._plan_from(one, bent) for one, cold in starts for bent in _bent_starts(one, cold)]
        best = min(plans, key=lambda plan: plan.report.cost if plan.solved else np.inf)
        iterations, seconds = sum(plan.report.iterations for plan in plans), time.perf_counter() - began
        return replace(best, report=replace(best.report, iterations=iterations, starts=len(plans), seconds=seconds))

    def _plan_from(self, problem: ApproachProblem, start: FloatArray) -> Plan:
        """Return the plan from one start; if its clearance cannot be certified, the samples are doubled once."""
        query, wait, duration = problem.query, problem.wait, problem.basis.duration
        report = PlanReport(starts=1)
        for samples in (self.samples, 2 * self.samples - 1):
            if samples != self.samples:
                problem = approach_problem(query, wait, duration, self.control_points, samples)
            result = optimise_scp(problem, start)
            start, iterations = result.points, report.iterations + result.iterations
            report = replace(report, cost=result.cost, iterations=iterations, violation=result.violation)
            if not result.feasible:
                message = f"a constraint is violated by {result.violation:.2g} m"
                if not np.isfinite(result.violation):
                    message = "no spline of this duration satisfies the limits of speed, force and keep-in box"
                report = replace(report, message=message)
                return Plan(PlanStatus.NOT_CONVERGED, query.t0 + wait, duration, report=report)
            path = SplinePath(problem.basis, start)
            proof = certify(query, path, wait)
            if proof.certified:
                return sampled_plan(query, path, wait, replace(report, clearance=proof.clearance))
        message = f"the clearance is {proof.clearance:.3f} m below radius and margin {proof.time:.1f} s after the start"
        return Plan(PlanStatus.NOT_CERTIFIED, query.t0 + wait, duration, report=replace(report, message=message))


def _without(status: PlanStatus, query: PlanQuery, message: str, began: float) -> Plan:
    seconds = time.perf_counter() - began
    return Plan(status, query.t0, query.durations[0], report=PlanReport(message=message, seconds=seconds))


def _bent_starts(problem: ApproachProblem, cold: FloatArray) -> list[FloatArray]:
    """Return the cheapest spline bent by 0.5 m sin(pi s) to four sides of the chord, shape (n, 3) each."""
    chord = problem.end[0] - problem.start[0]
    chord = chord / max(float(np.linalg.norm(chord)), 1e-9)
    side = np.cross(chord, np.eye(3)[np.abs(chord).argmin()])
    side /= np.linalg.norm(side)
    bend = _BEND * np.sin(np.pi * np.linspace(0.0, 1.0, len(cold)))[:, None]
    bend[: problem.basis.free.start] = bend[problem.basis.free.stop :] = 0.0
    return [cold + sign * bend * axis for axis in (side, np.cross(chord, side)) for sign in (1.0, -1.0)]
