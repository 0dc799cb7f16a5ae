"""The search for the plan of least cost of one episode: many starts, then hops from the best of them. Compiled.

A sighting is a step at which a point is seen. A choice of sightings defines a linear program, and its solution defines
a path. Along the path there may be better sightings than those for which it was made. The descent alternates between
sightings and programs until the fuel no longer decreases: as the sightings of the path itself remain possible when the
program is solved again, the fuel never increases, except for the cost of satisfying the limits of range.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from safe_inspect.compiling import njit
from safe_inspect.planning.burn_search import accepted_cost
from safe_inspect.planning.coverage_problem import (
    CoverageProblem,
    perturb_burns,
    random_burn,
    resample_sightings,
    write_positions,
)
from safe_inspect.planning.linear_program import LinearProgram, linear_program, set_row, solve
from safe_inspect.random.splitmix import SplitMixState, next_uniform
from safe_inspect.types import FloatArray, IntArray

#: Margin by which a position must satisfy its limit [m], as the simulator's sums are rounded differently.
_MARGIN = 1e-6
#: Largest number of tight rows, and therefore of basic columns.
MAX_BURNS = 48
#: Largest number of rows for limits of range, and of rounds in which they are added to one program.
_LIMIT_ROWS, _LIMIT_ROUNDS = 40, 12
#: Lower bound of the control authority in divisions [s].
_TINY = 1e-6
#: A descent continues while a round saves at least this velocity change [m/s].
_WORTHWHILE = 2e-6


class DescentWorkspace(NamedTuple):
    """Arrays for one episode.

    Attributes:
        program: The linear program.
        stride: Number of steps between two positions that are used.
        position: Positions along the path; rows that are no multiples of the stride are stale [m], shape (J + 1, 3).
        start: First step of each burn, shape (K,).
        delta_v: Velocity change of each burn [m/s], shape (K, 3).
        score: Best score of each point so far, shape (P,).
    """

    program: LinearProgram
    stride: int
    position: FloatArray
    start: IntArray
    delta_v: FloatArray
    score: FloatArray


@njit
def descent_workspace(problem: CoverageProblem, begin: IntArray, stride: int) -> DescentWorkspace:
    """Return the arrays of a descent; see `LinearProgram` for `begin` and `DescentWorkspace` for `stride`."""
    points = problem.normals.shape[0]
    return DescentWorkspace(
        linear_program(begin, points + _LIMIT_ROWS, MAX_BURNS),
        stride,
        np.zeros_like(problem.coast),
        np.zeros(MAX_BURNS, np.int64),
        np.zeros((MAX_BURNS, 3)),
        np.zeros(points),
    )


@njit
def burns_of(program: LinearProgram, size: int, start: IntArray, delta_v: FloatArray) -> int:
    """Write the burns of a solved program in order of time and return their number."""
    count, columns = 0, program.cost.shape[0] // 3
    for c in range(size):
        begin, axis, amount = program.begin[program.basic[c] % columns], program.basic[c] // columns, program.value[c]
        if amount == 0.0:
            continue
        k = 0
        while k < count and start[k] < begin:
            k += 1
        if k == count or start[k] != begin:
            for i in range(count, k, -1):
                start[i], delta_v[i] = start[i - 1], delta_v[i - 1]
            start[k], delta_v[k] = begin, 0.0
            count += 1
        delta_v[k, axis] += program.sign[c] * amount
    return count


@njit
def choose_sightings(
    problem: CoverageProblem,
    position: FloatArray,
    stride: int,
    score: FloatArray,
    sighting: IntArray,
    bounded: bool = True,
) -> int:
    """Choose for each point the lit step at which a path is farthest beyond the plane from which the point is seen.

    The score is the height of the position above the plane of the point, divided by the response of the position to a
    burn up to then. Sightings end where the path leaves the limits of range.

    Args:
        problem: The episode.
        position: Positions after every `stride`-th step [m], shape (J + 1, 3).
        stride: Number of steps between two positions that are used.
        score: Output: the score of each point [m/s], shape (P,).
        sighting: Output: the steps, shape (P,); -1 for a point that is never lit.
        bounded: Whether sightings end where the path leaves the limits of range.

    Returns:
        Step before which the path is within the limits of range.
    """
    points = problem.normals.shape[0]
    nx, ny, nz = problem.normals[:, 0], problem.normals[:, 1], problem.normals[:, 2]
    score[:], sighting[:] = -math.inf, -1
    end: int = position.shape[0]
    near, far = problem.near * problem.near, problem.far * problem.far
    for j in range(stride, position.shape[0], stride):
        x, y, z = position[j, 0], position[j, 1], position[j, 2]
        r2 = x * x + y * y + z * z
        if bounded and (r2 < near or r2 > far):
            end = j
            break
        plane, across = problem.control_authority[j, 0], problem.control_authority[j, 1]
        if r2 < near:
            continue
        for p in range(points):
            if not problem.lit[j, p]:
                continue
            reach = max(problem.slopes[p, 0] * plane, problem.slopes[p, 1] * across, _TINY)
            above = (nx[p] * x + ny[p] * y + nz[p] * z - problem.radius) / reach
            if above > score[p]:
                score[p], sighting[p] = above, j
    return end


@njit
def _limit_rows(problem: CoverageProblem, workspace: DescentWorkspace, rows: int, end: int) -> int:
    """Add a row for each part of a path that violates the limits of range, at its worst step.

    Returns:
        The number of rows; -1 if there are too many.
    """
    program, position = workspace.program, workspace.position
    near, far = problem.near, problem.far
    worst, at = 0.0, -1
    for j in range(workspace.stride, end + 2 * workspace.stride, workspace.stride):  # one more ends the last part
        broken = 0.0
        if j <= end:
            r = math.sqrt(position[j, 0] ** 2 + position[j, 1] ** 2 + position[j, 2] ** 2)
            broken = max(near - r, r - far)
        if broken > 0.0 and broken > worst:
            worst, at = broken, j
        elif broken <= 0.0 and at >= 0:
            if rows == program.bound.shape[0]:
                return -1
            r = math.sqrt(position[at, 0] ** 2 + position[at, 1] ** 2 + position[at, 2] ** 2)
            side = 1.0 if r < near else -1.0
            direction = side * position[at] / max(r, 1e-9)
            set_row(problem, program, rows, direction, at, near + _MARGIN if side > 0.0 else _MARGIN - far)
            rows += 1
            worst, at = 0.0, -1
    return rows


@njit
def least_fuel(
    problem: CoverageProblem, workspace: DescentWorkspace, sighting: IntArray, cutoff: float
) -> tuple[float, int]:
    """Find the burns of least fuel for given sightings within the limits of range.

    Args:
        problem: The episode.
        workspace: The burns and the path are written to it.
        sighting: Step at which each point is to be seen, shape (P,).
        cutoff: Velocity change above which the solution is abandoned [m/s].

    Returns:
        The velocity change [m/s], infinite if there is no solution, and the number of basic columns of the program.
    """
    program, points, end = workspace.program, sighting.shape[0], 0
    for p in range(points):
        if sighting[p] < 0:
            return math.inf, 0
        set_row(problem, program, p, problem.normals[p], sighting[p], problem.radius + _MARGIN)
        end = max(end, sighting[p])
    rows, size = points, 0
    for _ in range(_LIMIT_ROUNDS):
        cost, size = solve(problem, program, rows, size, cutoff)
        if not cost < math.inf:
            return math.inf, 0
        count = burns_of(program, size, workspace.start, workspace.delta_v)
        write_positions(problem, workspace.start, workspace.delta_v, count, workspace.stride, workspace.position)
        more = _limit_rows(problem, workspace, rows, end)
        if more == rows:
            return cost, size
        if more < 0:
            break
        rows = more
    return math.inf, 0


@njit
def descend(
    problem: CoverageProblem,
    workspace: DescentWorkspace,
    sighting: IntArray,
    first_cutoff: float,
    cutoff: float,
) -> tuple[float, int]:
    """Improve the sightings and the burns in turn until the fuel no longer decreases.

    Args:
        problem: The episode.
        workspace: Its program contains the last solution afterwards.
        sighting: The sightings, shape (P,); read and written.
        first_cutoff: Velocity change above which the first solution is abandoned [m/s].
        cutoff: Velocity change above which the second solution is abandoned [m/s].

    Returns:
        The velocity change [m/s], infinite if there is no solution, and the number of solved programs.
    """
    best, kept = math.inf, sighting.copy()
    limit = first_cutoff
    solved = 0
    for turn in range(_ROUNDS):
        cost, _ = least_fuel(problem, workspace, sighting, limit)
        solved += 1
        saves = cost < best - _WORTHWHILE
        if cost < best:
            best = cost
            kept[:] = sighting
        if not saves or best == 0.0:
            break
        choose_sightings(problem, workspace.position, workspace.stride, workspace.score, sighting)
        limit = min(cutoff, best) if turn == 0 else best
    sighting[:] = kept
    return best, solved


#: Number of steps between two possible starts of burns, and between two sightings, in the coarse search.
_BURN_STEP, _SIGHTING_STEP = 8, 4
#: Plans whose fuel differs by less than this share are treated as the same.
_SAME = 0.01
#: Hops may pass through plans that are more expensive by this share and amount [m/s] until sightings are improved.
_DETOUR, _DETOUR_MORE = 0.5, 0.01
#: Number of rounds of a descent, and of the refinement.
_ROUNDS, _REFINEMENTS = 6, 8


class SearchEffort(NamedTuple):
    """Extent of a search.

    Attributes:
        starts: Number of random paths from which plans are made.
        chains: How many of the best plans are improved by hops.
        programs: Number of linear programs that may be solved for each of them.
        temperature: Initial amount by which a hop may make a plan worse [m/s].
    """

    starts: int
    chains: int
    programs: int
    temperature: float


@njit
def search_plan(
    problem: CoverageProblem,
    given: IntArray,
    seed: SplitMixState,
    effort: SearchEffort,
    start: IntArray,
    burns: FloatArray,
) -> tuple[float, int]:
    """Search for the plan of least cost of an episode.

    Args:
        problem: The episode.
        given: Initial sightings of G plans, shape (G, P).
        seed: State of the random numbers, shape (1,); read and written.
        effort: Extent of the search.
        start: First step of each burn, shape (`MAX_BURNS`,); written.
        burns: Velocity change of each burn [m/s], Hill frame, shape (`MAX_BURNS`, 3); written.

    Returns:
        The velocity change of the plan [m/s], infinite if none was found, and its number of burns K: the first K rows
            of `start` and `burns` are the plan.
    """
    points = problem.normals.shape[0]
    workspace = descent_workspace(problem, np.arange(0, problem.coast.shape[0] - 1, _BURN_STEP), _SIGHTING_STEP)
    cost = np.full(effort.chains, math.inf)
    sightings = np.zeros((effort.chains, points), np.int64)
    sighting = np.zeros(points, np.int64)
    for number in range(given.shape[0] + effort.starts):
        if number < given.shape[0]:
            sighting[:] = given[number]
        else:
            _random_sightings(problem, workspace, seed, number > given.shape[0], sighting)
        cutoff = max(3.0 * cost[0], 0.3)
        reached, _ = descend(problem, workspace, sighting, cutoff, math.inf)
        _keep(cost, sightings, reached, sighting)
        if reached == 0.0:
            break
    best, count = math.inf, 0
    for chain in range(effort.chains):
        if best == 0.0 or not cost[chain] < math.inf:
            break
        _hop(problem, workspace, seed, effort, sightings[chain])
        reached, found_start, found_burns = _refine(problem, workspace, sightings[chain])
        if reached < best:
            best, count = reached, found_start.shape[0]
            start[:count], burns[:count] = found_start, found_burns
    for number in range(given.shape[0]):
        if best > 0.0:  # coarse sightings must not make a given plan worse
            reached, found_start, found_burns = _refine(problem, workspace, given[number])
            if reached < best:
                best, count = reached, found_start.shape[0]
                start[:count], burns[:count] = found_start, found_burns
    return best, count


@njit
def _random_sightings(
    problem: CoverageProblem, workspace: DescentWorkspace, seed: SplitMixState, with_burns: bool, sighting: IntArray
) -> None:
    """Write the sightings of a path with one or two random burns, or with none."""
    start, delta_v, count = np.zeros(2, np.int64), np.zeros((2, 3)), 0
    if with_burns:
        count = 1 + int(2.0 * next_uniform(seed))
        for k in range(count):
            random_burn(problem, seed, -2.5, -0.8, start, delta_v, k)
    write_positions(problem, start, delta_v, count, workspace.stride, workspace.position)
    choose_sightings(problem, workspace.position, workspace.stride, workspace.score, sighting, False)


@njit
def _keep(cost: FloatArray, sightings: IntArray, reached: float, sighting: IntArray) -> None:
    """Keep the sightings if they are among the best distinct ones; the arrays stay sorted by cost."""
    place = cost.shape[0] - 1
    if not reached < cost[place]:
        return
    for k in range(cost.shape[0]):
        if cost[k] < math.inf and abs(cost[k] - reached) <= _SAME * cost[k]:
            if reached >= cost[k]:
                return
            place = k
            break
    while place > 0 and cost[place - 1] > reached:
        cost[place], sightings[place] = cost[place - 1], sightings[place - 1]
        place -= 1
    cost[place], sightings[place] = reached, sighting


@njit
def _hop(
    problem: CoverageProblem, workspace: DescentWorkspace, seed: SplitMixState, effort: SearchEffort, best: IntArray
) -> None:
    """Improve sightings by hops: change some, descend, and accept results that are not much worse."""
    points = best.shape[0]
    now, sighting = best.copy(), best.copy()
    start, delta_v, count = np.zeros(MAX_BURNS + 1, np.int64), np.zeros((MAX_BURNS + 1, 3)), 0
    tight, tights = np.zeros(MAX_BURNS, np.int64), 0
    cost, lowest, spent, fresh = math.inf, math.inf, 0, True
    while spent < effort.programs:
        if fresh:
            cost, size = least_fuel(problem, workspace, now, math.inf)
            spent += 1
            if not cost < math.inf:
                break
            lowest = min(lowest, cost)
            count = burns_of(workspace.program, size, start, delta_v)
            tights = 0
            for i in range(size):
                if workspace.program.tight[i] < points:
                    tight[tights] = workspace.program.tight[i]
                    tights += 1
            fresh = False
        if cost == 0.0:
            break
        sighting[:] = now
        cutoff = accepted_cost(cost, effort.temperature, spent / effort.programs, next_uniform(seed))
        if tights > 0 and next_uniform(seed) < 0.5:
            resample_sightings(problem, seed, workspace.stride, tight, tights, sighting)
        else:
            perturb_burns(problem, seed, start, delta_v, count, workspace.stride, workspace.position)
            choose_sightings(problem, workspace.position, workspace.stride, workspace.score, sighting, False)
        detour = _DETOUR * cost + _DETOUR_MORE
        reached, used = descend(problem, workspace, sighting, cutoff + detour, cutoff + 0.5 * detour)
        spent += used
        if reached < cutoff:
            cost, fresh = reached, True
            now[:] = sighting
            if reached < lowest:
                lowest = reached
                best[:] = sighting


@njit
def _refine(
    problem: CoverageProblem, coarse: DescentWorkspace, sighting: IntArray
) -> tuple[float, IntArray, FloatArray]:
    """Solve again with sightings at every step, and with burns at any step near those that are used.

    Returns:
        The velocity change [m/s], infinite if there is no solution; first step and velocity change of each burn, as in
            `search_plan`.
    """
    steps = problem.coast.shape[0] - 1
    wanted = np.zeros(steps, np.bool_)
    wanted[coarse.program.begin] = True
    wanted[: 2 * _BURN_STEP] = True
    best, start, burns = math.inf, np.zeros(0, np.int64), np.zeros((0, 3))
    now = sighting.copy()
    for _ in range(_REFINEMENTS):
        workspace = descent_workspace(problem, np.flatnonzero(wanted), 1)
        cost, _ = descend(problem, workspace, now, math.inf, math.inf)
        if cost < math.inf:
            cost, size = least_fuel(problem, workspace, now, math.inf)
        if not cost < best:
            break
        gain, best = best - cost, cost
        count = burns_of(workspace.program, size, workspace.start, workspace.delta_v)
        start, burns = workspace.start[:count].copy(), workspace.delta_v[:count].copy()
        if gain < 1e-7:
            break
        for k in range(count):
            for away in (-4, -2, -1, 1, 2, 4):
                if 0 <= start[k] + away < steps:
                    wanted[start[k] + away] = True
    return best, start, burns
