"""From looks to a plan and back, until nothing is gained: the local part of the search. Compiled.

A choice of looks gives a programme, its solution a path, and along the path there may be better looks for the points
than those that it was made for. The looks of the path itself are still possible when the programme is solved again, so
the fuel never grows, apart from what the limits of range cost on the way.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from safe_inspect.compiling import njit
from safe_inspect.planning.course import Course, track
from safe_inspect.planning.programme import Programme, programme, set_row, solve
from safe_inspect.types import FloatArray, IntArray

#: How far beyond its limit a position is wanted [m]: the simulator's own sums round otherwise.
MARGIN = 1e-6
#: Rows that may be tight at a time, and so columns that are used.
MOST = 48
#: Rows for limits of range, and how many times they are added to one programme.
_LIMIT_ROWS, _ROUNDS = 40, 12
#: A lever that stands for none [s].
_TINY = 1e-6
#: A descent goes on while a round saves this much [m/s].
_WORTHWHILE = 2e-6


class Desk(NamedTuple):
    """Room to work in for one episode.

    Attributes:
        work: The programme.
        stride: Positions are looked at after every so-many-th step.
        position: Positions along the path, rows beside the stride are stale [m], shape (J + 1, 3).
        start: First step of each burn, shape (K,).
        delta_v: Velocity change of each burn [m/s], shape (K, 3).
        score: Best score of each point so far, shape (P,).
    """

    work: Programme
    stride: int
    position: FloatArray
    start: IntArray
    delta_v: FloatArray
    score: FloatArray


@njit
def desk(course: Course, begin: IntArray, stride: int) -> Desk:
    """Return room to work in; `begin` and `stride` as in `Programme` and `Desk`."""
    points = course.normals.shape[0]
    return Desk(
        programme(begin, points + _LIMIT_ROWS, MOST),
        stride,
        np.zeros_like(course.coast),
        np.zeros(MOST, np.int64),
        np.zeros((MOST, 3)),
        np.zeros(points),
    )


@njit
def burns_of(work: Programme, size: int, start: IntArray, delta_v: FloatArray) -> int:
    """Write the burns of a solved programme in order of time; return how many there are."""
    count, columns = 0, work.cost.shape[0] // 3
    for c in range(size):
        begin, axis, amount = work.begin[work.basic[c] % columns], work.basic[c] // columns, work.value[c]
        if amount == 0.0:
            continue
        k = 0
        while k < count and start[k] < begin:
            k += 1
        if k == count or start[k] != begin:
            for i in range(count, k, -1):
                start[i] = start[i - 1]
                for a in range(3):
                    delta_v[i, a] = delta_v[i - 1, a]
            start[k] = begin
            for a in range(3):
                delta_v[k, a] = 0.0
            count += 1
        delta_v[k, axis] += work.sign[c] * amount
    return count


@njit
def choose(
    course: Course, position: FloatArray, stride: int, score: FloatArray, look: IntArray, bounded: bool = True
) -> int:
    """Choose for each point the step at which a path comes closest to showing it lit, or shows it most safely.

    What counts is how far the position is above the plane of the point, by what a burn could add to it by then. Looks
    end where the path leaves the limits of range.

    Args:
        course: The episode.
        position: Positions after every `stride`-th step [m], shape (J + 1, 3).
        stride: As there.
        score: Receives that share of each point [m/s], shape (P,).
        look: Receives the steps, shape (P,); -1 for a point that is never lit.
        bounded: Whether looks end where the path leaves the limits of range.

    Returns:
        Step before which the path keeps within the limits of range.
    """
    points = course.normals.shape[0]
    nx, ny, nz = course.normals[:, 0], course.normals[:, 1], course.normals[:, 2]
    for p in range(points):
        score[p], look[p] = -math.inf, -1
    end: int = position.shape[0]
    near, far = course.near * course.near, course.far * course.far
    for j in range(stride, position.shape[0], stride):
        x, y, z = position[j, 0], position[j, 1], position[j, 2]
        r2 = x * x + y * y + z * z
        if bounded and (r2 < near or r2 > far):
            end = j
            break
        plane, across = course.lever[j, 0], course.lever[j, 1]
        if r2 < near:
            continue
        for p in range(points):
            if not course.lit[j, p]:
                continue
            answer = max(course.slopes[p, 0] * plane, course.slopes[p, 1] * across, _TINY)
            above = (nx[p] * x + ny[p] * y + nz[p] * z - course.radius) / answer
            if above > score[p]:
                score[p], look[p] = above, j
    return end


@njit
def _limit_rows(course: Course, bench: Desk, rows: int, end: int) -> int:
    """Add rows for the places where a path breaks the limits of range worst; return the number of rows."""
    work, position = bench.work, bench.position
    near, far = course.near, course.far
    worst, at = 0.0, -1
    direction = np.empty(3)
    for j in range(bench.stride, end + 2 * bench.stride, bench.stride):  # one more ends the last stretch
        broken = 0.0
        if j <= end:
            r = math.sqrt(position[j, 0] ** 2 + position[j, 1] ** 2 + position[j, 2] ** 2)
            broken = max(near - r, r - far)
        if broken > 0.0 and broken > worst:
            worst, at = broken, j
        elif broken <= 0.0 and at >= 0:
            if rows == work.bound.shape[0]:
                return -1
            r = math.sqrt(position[at, 0] ** 2 + position[at, 1] ** 2 + position[at, 2] ** 2)
            side = 1.0 if r < near else -1.0
            for i in range(3):
                direction[i] = side * position[at, i] / max(r, 1e-9)
            set_row(course, work, rows, direction, at, near + MARGIN if side > 0.0 else MARGIN - far)
            rows += 1
            worst, at = 0.0, -1
    return rows


@njit
def cheapest(course: Course, bench: Desk, look: IntArray, bar: float) -> tuple[float, int]:
    """Find the burns of least fuel for given looks within the limits of range.

    Args:
        course: The episode.
        bench: Room; holds burns and path afterwards.
        look: Step at which each point is looked at, shape (P,).
        bar: Break off above this velocity change [m/s].

    Returns:
        The velocity change [m/s], infinite for none, and how many columns of the programme are used.
    """
    work, points, end = bench.work, look.shape[0], 0
    for p in range(points):
        if look[p] < 0:
            return math.inf, 0
        set_row(course, work, p, course.normals[p], look[p], course.radius + MARGIN)
        end = max(end, look[p])
    rows, size = points, 0
    for _ in range(_ROUNDS):
        found = solve(course, work, rows, size, bar)
        if not found.solved:
            return math.inf, 0
        size = found.size
        count = burns_of(work, size, bench.start, bench.delta_v)
        track(course, bench.start, bench.delta_v, count, bench.stride, bench.position)
        more = _limit_rows(course, bench, rows, end)
        if more == rows:
            return found.cost, size
        if more < 0:
            break
        rows = more
    return math.inf, 0


@njit
def descend(
    course: Course, bench: Desk, look: IntArray, first_bar: float, bar: float, rounds: int
) -> tuple[float, int, int]:
    """Better the looks and the burns by turns until nothing is gained.

    Args:
        course: The episode.
        bench: Room; its programme holds the last solution afterwards.
        look: The looks, shape (P,); read and written.
        first_bar: Give up when the first solution costs more [m/s].
        bar: Give up when the second one costs more [m/s].
        rounds: Number of solutions at most.

    Returns:
        The velocity change [m/s], infinite for none; how many columns are used; how many programmes were solved.
    """
    best, kept, size = math.inf, look.copy(), 0
    limit = first_bar
    solved = 0
    for turn in range(rounds):
        cost, used = cheapest(course, bench, look, limit)
        solved += 1
        if cost >= best - _WORTHWHILE:
            if cost < best:
                best, size = cost, used
                kept[:] = look
            break
        best, size = cost, used
        kept[:] = look
        if best == 0.0:
            break
        choose(course, bench.position, bench.stride, bench.score, look)
        limit = bar if turn == 0 else best
        limit = min(limit, best)
    look[:] = kept
    return best, size, solved
