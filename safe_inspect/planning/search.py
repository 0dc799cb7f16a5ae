"""The search for the cheapest plan of one episode: many beginnings, then hops from the best of them. Compiled."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from safe_inspect.compiling import njit
from safe_inspect.planning.course import Course, track
from safe_inspect.planning.descent import MOST, Desk, burns_of, cheapest, choose, descend, desk
from safe_inspect.planning.kicks import kick, other_looks, vary
from safe_inspect.policies.search import draw
from safe_inspect.types import FloatArray, IntArray

Seed = NDArray[np.uint64]

#: Steps between two beginnings of burns, and between two looks, while the search is coarse.
BURN_STEP, LOOK_STEP = 8, 4
#: Two plans whose fuel differs by less than this share are taken for one.
_SAME = 0.01
#: Hops are allowed to pass through plans dearer by this share and amount [m/s] before the looks are bettered.
_DETOUR, _DETOUR_MORE = 0.5, 0.01
#: Rounds of a descent, and of the refinement.
_ROUNDS, _REFINEMENTS = 6, 8


class Effort(NamedTuple):
    """How long is searched.

    Attributes:
        beginnings: Paths at random from which plans are made.
        chains: How many of the best plans are bettered by hops.
        programmes: Linear programmes that each of them may solve.
        temperature: By how much a hop may make a plan worse at first [m/s].
    """

    beginnings: int
    chains: int
    programmes: int
    temperature: float


@njit
def search(
    course: Course, given: IntArray, seed: Seed, effort: Effort, start: IntArray, burns: FloatArray
) -> tuple[float, int]:
    """Search the cheapest plan of an episode.

    Args:
        course: The episode.
        given: Looks to begin with, of G plans, shape (G, P).
        seed: State of the random numbers, shape (1,); read and written.
        effort: How long is searched.
        start: First step of each burn, shape (`MOST`,); written.
        burns: Velocity change of each burn [m/s], Hill frame, shape (`MOST`, 3); written.

    Returns:
        The velocity change of the plan [m/s], infinite when none was found, and its number of burns K: the first K
        rows of `start` and `burns` are the plan.
    """
    points = course.normals.shape[0]
    bench = desk(course, np.arange(0, course.coast.shape[0] - 1, BURN_STEP), LOOK_STEP)
    cost = np.full(effort.chains, math.inf)
    looks = np.zeros((effort.chains, points), np.int64)
    look = np.zeros(points, np.int64)
    for number in range(given.shape[0] + effort.beginnings):
        if number < given.shape[0]:
            look[:] = given[number]
        else:
            _begin(course, bench, seed, number > given.shape[0], look)
        bar = max(3.0 * cost[0], 0.3)
        reached, _, _ = descend(course, bench, look, bar, math.inf, _ROUNDS)
        _keep(cost, looks, reached, look)
        if reached == 0.0:
            break
    best, count = math.inf, 0
    for chain in range(effort.chains):
        if best == 0.0 or not cost[chain] < math.inf:
            break
        _hop(course, bench, seed, effort, looks[chain])
        reached, found_start, found_burns = _refine(course, bench, looks[chain])
        if reached < best:
            best, count = reached, found_start.shape[0]
            start[:count], burns[:count] = found_start, found_burns
    for number in range(given.shape[0]):
        if best > 0.0:  # a given plan is never spoilt by the coarse looks
            reached, found_start, found_burns = _refine(course, bench, given[number])
            if reached < best:
                best, count = reached, found_start.shape[0]
                start[:count], burns[:count] = found_start, found_burns
    return best, count


@njit
def _begin(course: Course, bench: Desk, seed: Seed, burning: bool, look: IntArray) -> None:
    """Write the looks of a path with one or two burns at random, or of none."""
    start, delta_v, count = np.zeros(2, np.int64), np.zeros((2, 3)), 0
    if burning:
        count = 1 + int(2.0 * draw(seed))
        for k in range(count):
            kick(course, seed, -2.5, -0.8, start, delta_v, k)
    track(course, start, delta_v, count, bench.stride, bench.position)
    choose(course, bench.position, bench.stride, bench.score, look, False)


@njit
def _keep(cost: FloatArray, looks: IntArray, reached: float, look: IntArray) -> None:
    """Keep the looks if they are among the best of their kind; the arrays stay in order of cost."""
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
        looks[place] = looks[place - 1]
        place -= 1
    cost[place] = reached
    looks[place] = look


@njit
def _hop(course: Course, bench: Desk, seed: Seed, effort: Effort, best: IntArray) -> None:
    """Better looks by hops: change some, descend, and keep what is not much worse."""
    points = best.shape[0]
    now, look = best.copy(), best.copy()
    start, delta_v, count = np.zeros(MOST + 1, np.int64), np.zeros((MOST + 1, 3)), 0
    tight, tights = np.zeros(MOST, np.int64), 0
    cost, lowest, spent, fresh = math.inf, math.inf, 0, True
    while spent < effort.programmes:
        if fresh:
            cost, size = cheapest(course, bench, now, math.inf)
            spent += 1
            if not cost < math.inf:
                break
            lowest = min(lowest, cost)
            count = burns_of(bench.work, size, start, delta_v)
            tights = 0
            for i in range(size):
                if bench.work.tight[i] < points:
                    tight[tights] = bench.work.tight[i]
                    tights += 1
            fresh = False
        if cost == 0.0:
            break
        look[:] = now
        bar = cost - effort.temperature * (1.0 - spent / effort.programmes) * math.log(draw(seed) + 1e-300)
        if tights > 0 and draw(seed) < 0.5:
            other_looks(course, seed, bench.stride, tight, tights, look)
        else:
            vary(course, seed, start, delta_v, count, bench.stride, bench.position)
            choose(course, bench.position, bench.stride, bench.score, look, False)
        detour = _DETOUR * cost + _DETOUR_MORE
        reached, _, used = descend(course, bench, look, bar + detour, bar + 0.5 * detour, _ROUNDS)
        spent += used
        if reached < bar:
            cost, fresh = reached, True
            now[:] = look
            if reached < lowest:
                lowest = reached
                best[:] = look


@njit
def _refine(course: Course, coarse: Desk, look: IntArray) -> tuple[float, IntArray, FloatArray]:
    """Solve once more with a look at every step, and with burns at any step about those that are used.

    Returns:
        The velocity change [m/s], infinite for none; first step and velocity change of each burn, as in `search`.
    """
    steps = course.coast.shape[0] - 1
    wanted = np.zeros(steps, np.bool_)
    wanted[coarse.work.begin] = True
    wanted[: 2 * BURN_STEP] = True
    best, start, burns = math.inf, np.zeros(0, np.int64), np.zeros((0, 3))
    now = look.copy()
    for _ in range(_REFINEMENTS):
        bench = desk(course, np.flatnonzero(wanted), 1)
        cost, _, _ = descend(course, bench, now, math.inf, math.inf, _ROUNDS)
        if cost < math.inf:
            cost, size = cheapest(course, bench, now, math.inf)
        if not cost < best:
            break
        gain, best = best - cost, cost
        count = burns_of(bench.work, size, bench.start, bench.delta_v)
        start, burns = bench.start[:count].copy(), bench.delta_v[:count].copy()
        if gain < 1e-7:
            break
        for k in range(count):
            for away in (-4, -2, -1, 1, 2, 4):
                if 0 <= start[k] + away < steps:
                    wanted[start[k] + away] = True
    return best, start, burns
