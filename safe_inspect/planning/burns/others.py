"""Prediction of the other deputies: their coasting arcs, and the points that they will inspect. Compiled."""

from __future__ import annotations

import numpy as np

from safe_inspect.compiling import njit
from safe_inspect.dynamics.step_maps import advance_steps
from safe_inspect.planning.burns.problem import BurnProblem
from safe_inspect.types import FloatArray


@njit
def coast_others(problem: BurnProblem, position: FloatArray, velocity: FloatArray) -> int:
    """Write `BurnProblem.others`, and remove from `BurnProblem.needed` the points that the others will inspect.

    The others are assumed to coast from now on. Points that a deputy would see after it has left the range from the
    points' radius to `FlightLimits.far` do not count, as it will not fly there.

    Args:
        problem: The deputy's planning problem.
        position: Positions of the others [m], shape (D - 1, 3).
        velocity: Velocities of the others [m/s], shape (D - 1, 3).

    Returns:
        Number of steps after which the last of those points is inspected.
    """
    points, needed, lit, radius, sight = problem.points, problem.needed, problem.lit, problem.radius, problem.sight
    far, maps = problem.limits.far, problem.maps
    state, after, coasting = np.empty(6), np.empty(6), np.zeros(3)
    last = 0
    for k in range(position.shape[0]):
        state[:3], state[3:] = position[k], velocity[k]
        inside = True
        for j in range(lit.shape[0]):
            advance_steps(maps, j, state, coasting, after)
            x, y, z = after[0], after[1], after[2]
            problem.others[k, j] = after
            r2 = x * x + y * y + z * z
            inside = inside and radius * radius <= r2 <= far * far
            if j == 0 or not inside or r2 < sight * sight:
                continue
            for p in range(points.shape[0]):
                if not needed[p] or not lit[j, p]:
                    continue
                if points[p, 0] * x + points[p, 1] * y + points[p, 2] * z >= radius * radius:
                    needed[p] = False
                    last = max(last, j)
    return last
