"""From sightings to a plan and back, until nothing is gained: the local part of the search. Compiled.

A choice of sightings gives a program, its solution a path, and along the path there may be better sightings than those
that it was made for. The sightings of the path itself are still possible when the program is solved again, so the fuel
never grows, apart from what the limits of range cost on the way.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from safe_inspect.compiling import njit
from safe_inspect.planning.coverage.linear_program import LinearProgram, linear_program, set_row, solve
from safe_inspect.planning.coverage.problem import CoverageProblem, write_positions
from safe_inspect.types import FloatArray, IntArray

#: How far beyond its limit a position is wanted [m]: the simulator's own sums round otherwise.
MARGIN = 1e-6
#: Rows that may be tight at a time, and so columns that are used.
MAX_BURNS = 48
#: Rows for limits of range, and how many times they are added to one program.
_LIMIT_ROWS, _ROUNDS = 40, 12
#: A control authority that stands for none [s].
_TINY = 1e-6
#: A descent goes on while a round saves this much [m/s].
_WORTHWHILE = 2e-6


class DescentWorkspace(NamedTuple):
    """Arrays for one episode.

    Attributes:
        program: The linear program.
        stride: Positions are looked at after every so-many-th step.
        position: Positions along the path, rows beside the stride are stale [m], shape (J + 1, 3).
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
    """Return the arrays; `begin` and `stride` as in `LinearProgram` and `DescentWorkspace`."""
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
    """Write the burns of a solved program in order of time; return how many there are."""
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
                start[i] = start[i - 1]
                for a in range(3):
                    delta_v[i, a] = delta_v[i - 1, a]
            start[k] = begin
            for a in range(3):
                delta_v[k, a] = 0.0
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
    """Choose for each point the step at which a path comes closest to showing it lit, or shows it most safely.

    What counts is how far the position is above the plane of the point, by what a burn could add to it by then.
    Sightings end where the path leaves the limits of range.

    Args:
        problem: The episode.
        position: Positions after every `stride`-th step [m], shape (J + 1, 3).
        stride: As there.
        score: Receives that share of each point [m/s], shape (P,).
        sighting: Receives the steps, shape (P,); -1 for a point that is never lit.
        bounded: Whether sightings end where the path leaves the limits of range.

    Returns:
        Step before which the path keeps within the limits of range.
    """
    points = problem.normals.shape[0]
    nx, ny, nz = problem.normals[:, 0], problem.normals[:, 1], problem.normals[:, 2]
    for p in range(points):
        score[p], sighting[p] = -math.inf, -1
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
    """Add rows for the places where a path breaks the limits of range worst; return the number of rows."""
    program, position = workspace.program, workspace.position
    near, far = problem.near, problem.far
    worst, at = 0.0, -1
    direction = np.empty(3)
    for j in range(workspace.stride, end + 2 * workspace.stride, workspace.stride):  # one more ends the last stretch
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
            for i in range(3):
                direction[i] = side * position[at, i] / max(r, 1e-9)
            set_row(problem, program, rows, direction, at, near + MARGIN if side > 0.0 else MARGIN - far)
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
        workspace: Receives burns and path afterwards.
        sighting: Step at which each point is looked at, shape (P,).
        cutoff: Break off above this velocity change [m/s].

    Returns:
        The velocity change [m/s], infinite for none, and how many columns of the program are used.
    """
    program, points, end = workspace.program, sighting.shape[0], 0
    for p in range(points):
        if sighting[p] < 0:
            return math.inf, 0
        set_row(problem, program, p, problem.normals[p], sighting[p], problem.radius + MARGIN)
        end = max(end, sighting[p])
    rows, size = points, 0
    for _ in range(_ROUNDS):
        found = solve(problem, program, rows, size, cutoff)
        if not found.solved:
            return math.inf, 0
        size = found.size
        count = burns_of(program, size, workspace.start, workspace.delta_v)
        write_positions(problem, workspace.start, workspace.delta_v, count, workspace.stride, workspace.position)
        more = _limit_rows(problem, workspace, rows, end)
        if more == rows:
            return found.cost, size
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
    rounds: int,
) -> tuple[float, int, int]:
    """Improve the sightings and the burns by turns until nothing is gained.

    Args:
        problem: The episode.
        workspace: Its program holds the last solution afterwards.
        sighting: The sightings, shape (P,); read and written.
        first_cutoff: Give up when the first solution costs more [m/s].
        cutoff: Give up when the second one costs more [m/s].
        rounds: Number of solutions at most.

    Returns:
        The velocity change [m/s], infinite for none; how many columns are used; how many programs were solved.
    """
    best, kept, size = math.inf, sighting.copy(), 0
    limit = first_cutoff
    solved = 0
    for turn in range(rounds):
        cost, used = least_fuel(problem, workspace, sighting, limit)
        solved += 1
        if cost >= best - _WORTHWHILE:
            if cost < best:
                best, size = cost, used
                kept[:] = sighting
            break
        best, size = cost, used
        kept[:] = sighting
        if best == 0.0:
            break
        choose_sightings(problem, workspace.position, workspace.stride, workspace.score, sighting)
        limit = cutoff if turn == 0 else best
        limit = min(limit, best)
    sighting[:] = kept
    return best, size, solved
