"""The planner, which returns a certified plan for a query."""

from __future__ import annotations

import time
from abc import abstractmethod
from dataclasses import replace
from typing import ClassVar

import numpy as np
from pydantic import Field

from safe_inspect.plugins.plugin import Plugin
from safe_inspect.rendezvous.planner.certificate import certify
from safe_inspect.rendezvous.planner.checks import start_problem
from safe_inspect.rendezvous.planner.problem import ApproachProblem, approach_problem, sampled_plan
from safe_inspect.rendezvous.planner.query import Plan, PlanQuery, PlanReport, PlanStatus
from safe_inspect.rendezvous.planner.scp import optimise_scp
from safe_inspect.rendezvous.planner.spline import SplinePath
from safe_inspect.rendezvous.planner.units import PlanUnits
from safe_inspect.rendezvous.planner.waiting import ranked_problems
from safe_inspect.types import FloatArray

_TRIED = 3  # Number of ranked waits and durations to optimise.
#: Sideways bend of the starts that are tried if the cheapest spline does not lead to a plan [m].
_BEND = 0.5


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
            units = PlanUnits.of(query)
            return units.restored(self(units.query), time.perf_counter() - began)
        wrong = start_problem(query)
        if wrong:
            return _without(PlanStatus.START_INFEASIBLE, query, wrong, began)
        problems, wrong = ranked_problems(query, self.control_points, self.samples)
        if not problems:
            return _without(PlanStatus.TERMINAL_INFEASIBLE, query, wrong, began)
        best: Plan | None = None
        for cold in [True] if self.multi_start else [True, False]:
            for problem in problems[:_TRIED]:
                starts = [problem.cold()] if cold else []
                if self.multi_start or not cold:
                    starts += _bent_starts(problem)
                for start in starts:
                    best = _better(best, self._plan_from(problem, start))
            assert best is not None, "each problem must have a start"
            if best.solved:
                break
        assert best is not None, "each problem must have a start"
        return replace(best, report=replace(best.report, seconds=time.perf_counter() - began))

    def _plan_from(self, problem: ApproachProblem, start: FloatArray) -> Plan:
        """Return the plan from one start; if its clearance cannot be certified, the samples are doubled once."""
        query, wait, duration = problem.query, problem.wait, problem.basis.duration
        iterations = 0
        for samples in (self.samples, 2 * self.samples - 1):
            if samples != self.samples:
                problem = approach_problem(query, wait, duration, self.control_points, samples)
            result = optimise_scp(problem, start)
            iterations += result.iterations
            report = PlanReport(cost=result.cost, iterations=iterations, starts=1, violation=result.violation)
            if not result.feasible:
                message = f"a constraint is violated by {result.violation:.2g} m"
                if not np.isfinite(result.violation):
                    message = "no spline of this duration satisfies the limits of speed, force and keep-in box"
                return Plan(
                    PlanStatus.NOT_CONVERGED, query.t0 + wait, duration, report=replace(report, message=message)
                )
            path = SplinePath(problem.basis, result.points)
            proof = certify(query, path, wait)
            if proof.certified:
                report = replace(report, clearance=proof.clearance)
                return sampled_plan(query, path, wait, report)
            start = result.points
        message = f"the clearance is {proof.clearance:.3f} m below radius and margin {proof.time:.1f} s after the start"
        return Plan(PlanStatus.NOT_CERTIFIED, query.t0 + wait, duration, report=replace(report, message=message))


def _better(best: Plan | None, other: Plan) -> Plan:
    """Return the better of two plans, with the iterations and starts of both."""
    if best is None:
        return other
    wins = other.solved and (not best.solved or other.report.cost < best.report.cost)
    chosen = other if wins else best
    iterations = best.report.iterations + other.report.iterations
    starts = best.report.starts + other.report.starts
    return replace(chosen, report=replace(chosen.report, iterations=iterations, starts=starts))


def _without(status: PlanStatus, query: PlanQuery, message: str, began: float) -> Plan:
    seconds = time.perf_counter() - began
    return Plan(status, query.t0, query.durations[0], report=PlanReport(message=message, seconds=seconds))


def _bent_starts(problem: ApproachProblem) -> list[FloatArray]:
    """Return the cheapest splines bent by 0.5 m sin(pi s) to four sides of the chord, shape (n, 3) each."""
    cold = problem.cold()
    chord = problem.end[0] - problem.start[0]
    chord = chord / max(float(np.linalg.norm(chord)), 1e-9)
    side = np.cross(chord, np.eye(3)[np.abs(chord).argmin()])
    side /= np.linalg.norm(side)
    bend = _BEND * np.sin(np.pi * np.linspace(0.0, 1.0, len(cold)))[:, None]
    bend[: problem.basis.free.start] = bend[problem.basis.free.stop :] = 0.0
    return [cold + sign * bend * axis for axis in (side, np.cross(chord, side)) for sign in (1.0, -1.0)]
