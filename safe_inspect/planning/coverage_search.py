"""The search for the plan of least cost of one episode: many starts, then hops from the best of them. Compiled."""

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
from safe_inspect.planning.descent import (
    MAX_BURNS,
    DescentWorkspace,
    burns_of,
    choose_sightings,
    descend,
    descent_workspace,
    least_fuel,
)
from safe_inspect.random.splitmix import SplitMixState, next_uniform
from safe_inspect.types import FloatArray, IntArray

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
        reached, _, _ = descend(problem, workspace, sighting, cutoff, math.inf, _ROUNDS)
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
        cost[place] = cost[place - 1]
        sightings[place] = sightings[place - 1]
        place -= 1
    cost[place] = reached
    sightings[place] = sighting


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
        reached, _, used = descend(problem, workspace, sighting, cutoff + detour, cutoff + 0.5 * detour, _ROUNDS)
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
        cost, _, _ = descend(problem, workspace, now, math.inf, math.inf, _ROUNDS)
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
