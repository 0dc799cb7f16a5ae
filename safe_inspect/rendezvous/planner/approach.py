"""The planner: from a query to a certified plan."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from safe_inspect.rendezvous.planner.certificate import certify
from safe_inspect.rendezvous.planner.checks import start_problem
from safe_inspect.rendezvous.planner.problem import ApproachProblem, approach_problem, sampled_plan
from safe_inspect.rendezvous.planner.query import Plan, PlanQuery, PlanReport, PlanStatus
from safe_inspect.rendezvous.planner.scp import ScpOptions, ScpResult, optimise_scp
from safe_inspect.rendezvous.planner.spline import SplinePath
from safe_inspect.rendezvous.planner.units import PlanUnits
from safe_inspect.rendezvous.planner.waiting import ranked_problems
from safe_inspect.types import FloatArray

#: Finds control points near those that it starts from.
ApproachOptimiser = Callable[[ApproachProblem, FloatArray, ScpOptions], ScpResult]
_TRIED = 3  # of the ranked waits and durations
#: How far a start is bent to the side where the cheapest spline leads nowhere [m].
_BEND = 0.5


@dataclass(frozen=True, eq=False)
class PlannerOptions:
    """How plans are made.

    Attributes:
        control_points: Control points of an axis.
        samples: Samples at which the constraints are held.
        multi_start: Whether the bent starts are tried even where the cheapest spline leads to a plan.
        retry: Whether they are tried where it does not.
        scp: How the iteration goes.
        optimise: The optimiser.
    """

    control_points: int = 20
    samples: int = 121
    multi_start: bool = False
    retry: bool = True
    scp: ScpOptions = field(default_factory=ScpOptions)
    optimise: ApproachOptimiser = optimise_scp


def plan_approach(query: PlanQuery, options: PlannerOptions | None = None) -> Plan:
    """Return the cheapest certified plan that is found.

    Waits and durations are ranked by their cheapest splines; the three best are optimised, from their cheapest splines
    and, where that fails, from bent ones. A plan is SOLVED only with the certificate of clearance.

    Args:
        query: The query.
        options: How plans are made.

    Returns:
        The plan. A query without one gives a status, not an exception.

    Raises:
        ImportError: The solver is not installed.
    """
    options, began = options or PlannerOptions(), time.perf_counter()
    if query.length != 1.0:
        units = PlanUnits.of(query)
        scaled = plan_approach(units.query, options)
        return units.restored(scaled, time.perf_counter() - began)
    wrong = start_problem(query)
    if wrong:
        return _without(PlanStatus.START_INFEASIBLE, query, wrong, began)
    problems, wrong = ranked_problems(query, options.control_points, options.samples)
    if not problems:
        return _without(PlanStatus.TERMINAL_INFEASIBLE, query, wrong, began)
    best: Plan | None = None
    for some in [True, False] if options.retry and not options.multi_start else [True]:
        for problem in problems[:_TRIED]:
            starts = [problem.cold()] if some else []
            if options.multi_start or not some:
                starts += _bent_starts(problem)
            for start in starts:
                best = _better(best, _plan_from(problem, start, options))
        assert best is not None, "each problem has a start"
        if best.solved:
            break
    assert best is not None, "as said"
    return replace(best, report=replace(best.report, seconds=time.perf_counter() - began))


def _plan_from(problem: ApproachProblem, start: FloatArray, options: PlannerOptions) -> Plan:
    """Return the plan of one start; without a certificate the samples are doubled once."""
    query, wait, duration = problem.query, problem.wait, problem.basis.duration
    iterations = 0
    for samples in (options.samples, 2 * options.samples - 1):
        if samples != options.samples:
            problem = approach_problem(query, wait, duration, options.control_points, samples)
        result = options.optimise(problem, start, options.scp)
        iterations += result.iterations
        report = PlanReport(cost=result.cost, iterations=iterations, starts=1, violation=result.violation)
        if not result.feasible:
            message = f"a constraint is broken by {result.violation:.2g} m"
            if not np.isfinite(result.violation):
                message = "no spline of this duration keeps the limits of speed, force and keep-in"
            return Plan(PlanStatus.NOT_CONVERGED, query.t0 + wait, duration, report=replace(report, message=message))
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
    """Return the cheapest approach bent by 0.5 m sin(pi s) to four sides of its chord, each of shape (n, 3)."""
    cold = problem.cold()
    chord = problem.end[0] - problem.start[0]
    chord = chord / max(float(np.linalg.norm(chord)), 1e-9)
    side = np.cross(chord, np.eye(3)[np.abs(chord).argmin()])
    side /= np.linalg.norm(side)
    bend = _BEND * np.sin(np.pi * np.linspace(0.0, 1.0, len(cold)))[:, None]
    bend[: problem.basis.free.start] = bend[problem.basis.free.stop :] = 0.0
    return [cold + sign * bend * axis for axis in (side, np.cross(chord, side)) for sign in (1.0, -1.0)]
