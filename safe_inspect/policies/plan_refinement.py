"""`refine_plan`: the least fuel with which the points that a path sees can be seen, by linear programmes.

Positions are linear in the burns, and a point is seen from all positions beyond a plane. A sighting is a step at which
a point is to be seen. If the sightings are given, the burns with the least sum of abs(dv_x) + abs(dv_y) + abs(dv_z)
therefore solve a linear programme. Along the new path there may be better sightings than those for which it was made,
so that sightings and programmes alternate until the fuel no longer decreases.
"""

from __future__ import annotations

import numpy as np

from safe_inspect.geometry.distance import lengths
from safe_inspect.policies.burn_problem import BurnProblem
from safe_inspect.types import FloatArray, IntArray

#: Margin by which a position must satisfy its limit [m], as the solver and the simulator's sums are not exact.
_MARGIN = 1e-6
#: Number of steps between two possible starts of burns, and the offsets from the burns so far at which more may start.
_COARSE, _NEARBY = 8, np.array([-4, -2, -1, 0, 1, 2, 4])
#: Largest number of choices of sightings, and of programmes for one choice.
_ROUNDS, _PROGRAMMES = 8, 30
#: Amount by which a sighting after the path leaves the limits of range counts less [m/s].
_OUTSIDE = 1e6
#: The refinement continues while a round saves at least this velocity change [m/s].
_WORTHWHILE = 1e-6


def refine_plan(problem: BurnProblem, state: FloatArray, delta_v: FloatArray) -> FloatArray | None:
    """Return a plan that sees all needed points with less fuel, from sightings along the path of a given plan.

    Only the limits of range and of thrust are considered.

    Args:
        problem: The planning problem of a deputy that is alone, J steps.
        state: Position [m] and velocity [m/s] now, shape (6,).
        delta_v: Velocity change in each step of the given plan [m/s], shape (J, 3).

    Returns:
        The velocity change in each step [m/s], shape (J, 3); None if no solution was found.
    """
    if not problem.lit[1:, problem.needed].any(axis=0).all():
        return None
    maps, horizon = problem.maps, delta_v.shape[0]
    response = np.zeros((horizon + 1, 3, 3))  # of the position m steps after the start of a burn of 1 m/s in one step
    response[1:] = maps.phi[:-1, :3] @ maps.gamma[1] / maps.step_size
    coast = maps.phi[:, :3] @ state
    path, best, cost = _path(coast, response, delta_v), None, np.inf
    for _ in range(_ROUNDS):
        nearby = np.flatnonzero(delta_v.any(axis=1))[:, None] + _NEARBY
        steps = np.union1d(np.arange(0, horizon, _COARSE), np.clip(nearby, 0, horizon - 1))
        found = _least_fuel(problem, coast, response, steps, _sightings(problem, response, path))
        if found is None or np.abs(found).sum() > cost - _WORTHWHILE:
            break
        best = delta_v = found
        cost, path = np.abs(found).sum(), _path(coast, response, found)
    return best


def _path(coast: FloatArray, response: FloatArray, delta_v: FloatArray) -> FloatArray:
    """Return the position after 0, 1, ... steps [m], shape (J + 1, 3)."""
    position = coast.copy()
    for step in np.flatnonzero(delta_v.any(axis=1)):
        position[step:] += response[: len(position) - step] @ delta_v[step]
    return position


def _excess(problem: BurnProblem, path: FloatArray) -> FloatArray:
    """Return by how much each position of a path violates the limits of range [m], negative if it does not."""
    distance = lengths(path)
    return np.maximum(problem.limits.near - distance, distance - problem.limits.far)


def _sightings(problem: BurnProblem, response: FloatArray, path: FloatArray) -> IntArray:
    """Return for each needed point the lit step at which a path is farthest beyond its plane, shape (P,).

    The height above the plane is divided by the largest response of a position to an earlier burn. Steps after the
    path leaves the limits of range only count for points that are not lit before.
    """
    outside = np.maximum.accumulate(_excess(problem, path[1:]) > 0.0)[:, None]
    authority = np.maximum.accumulate(np.abs(response[1:]).max(axis=(1, 2)))[:, None]
    height = path[1:] @ (problem.points[problem.needed] / problem.radius).T - problem.radius
    score = np.where(problem.lit[1:, problem.needed], height / authority - _OUTSIDE * outside, -np.inf)
    return np.asarray(1 + score.argmax(axis=0))


def _least_fuel(
    problem: BurnProblem, coast: FloatArray, response: FloatArray, steps: IntArray, sightings: IntArray
) -> FloatArray | None:
    """Return the burns of least fuel for given sightings; a limit of range is added where a solution violates it most.

    Args:
        problem: The planning problem.
        coast: Position after 0, 1, ... steps without thrust [m], shape (J + 1, 3).
        response: Response of the position to a burn [s], shape (J + 1, 3, 3).
        steps: The steps at which burns are possible, shape (C,).
        sightings: Step at which each needed point is to be seen, shape (P,).

    Returns:
        The velocity change in each step [m/s], shape (J, 3); None if no solution was found.
    """
    from scipy.optimize import linprog  # slow to import

    direction, time = problem.points[problem.needed] / problem.radius, sightings
    least = np.full(len(time), problem.radius + _MARGIN)
    reach = np.tile(problem.reach, 2 * len(steps))
    for _ in range(_PROGRAMMES):
        since = np.maximum(time[:, None] - steps, 0)
        rows = np.einsum("ri,rcij->rcj", direction, response[since]).reshape(len(time), -1)
        solution = linprog(
            np.ones(len(reach)),
            A_ub=np.hstack((-rows, rows)),
            b_ub=(direction * coast[time]).sum(axis=1) - least,
            bounds=np.stack((np.zeros(len(reach)), reach), axis=1),
            method="highs-ds",
            options={"presolve": False},
        )
        if solution.status != 0:
            return None
        delta_v = np.zeros((len(coast) - 1, 3))
        delta_v[steps] = np.subtract(*solution.x.reshape(2, -1, 3))
        path = _path(coast, response, delta_v)[1 : sightings.max() + 1]
        excess = _excess(problem, path)
        worst = excess.argmax()
        if excess[worst] <= 0.0:
            return delta_v
        distance = lengths(path[worst])
        side, limit = (1.0, problem.limits.near) if distance < problem.limits.near else (-1.0, problem.limits.far)
        direction = np.vstack((direction, side * path[worst] / distance))
        time, least = np.append(time, worst + 1), np.append(least, side * limit + _MARGIN)
    return None
