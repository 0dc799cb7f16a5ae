"""The ranking of waits and durations before the optimisation."""

from __future__ import annotations

import numpy as np

from safe_inspect.rendezvous.planner.checks import possible_waits, terminal_problem
from safe_inspect.rendezvous.planner.problem import ApproachProblem, approach_problems
from safe_inspect.rendezvous.planner.query import PlanQuery

_PRICE = 0.05  # N^2 per metre of penetration


def ranked_problems(query: PlanQuery, count: int, samples: int) -> tuple[list[ApproachProblem], str]:
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
    points = np.concatenate(
        [np.einsum("kij,kj->ki", p.R_MW, p.basis.values[0] @ c) for p, c in zip(admissible, cold, strict=True)]
    )
    distance = query.boxes.distance(points).reshape(len(admissible), samples)
    price = []
    for problem, control_points, row in zip(admissible, cold, distance, strict=True):
        penetration = np.maximum(query.limits.radius + problem.margin - row, 0.0).mean() * problem.basis.duration
        price.append(problem.cost(control_points) + _PRICE * penetration)
    return [admissible[i] for i in np.argsort(price, kind="stable")], reason
