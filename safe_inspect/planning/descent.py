"""The local part of the search: alternate between sightings and plans until the fuel no longer decreases. Compiled.

A sighting is a step at which a point is seen. A choice of sightings defines a linear program, and its solution defines
a path. Along the path there may be better sightings than those for which it was made. As the sightings of the path
itself remain possible when the program is solved again, the fuel never increases, except for the cost of satisfying the
limits of range.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from safe_inspect.compiling import njit
from safe_inspect.planning.coverage_problem import CoverageProblem, write_positions
from safe_inspect.planning.linear_program import LinearProgram, linear_program, set_row, solve
from safe_inspect.types import FloatArray, IntArray

#: Margin by which a position must satisfy its limit [m], as the simulator's sums are rounded differently.
_MARGIN = 1e-6
#: Largest number of tight rows, and therefore of basic columns.
MAX_BURNS = 48
#: Largest number of rows for limits of range, and of rounds in which they are added to one program.
_LIMIT_ROWS, _ROUNDS = 40, 12
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
    """Add a row for each part of a path that violates the limits of range, at its worst step.

    Returns:
        The number of rows; -1 if there are too many.
    """
    program, position = workspace.program, workspace.position
    near, far = problem.near, problem.far
    worst, at = 0.0, -1
    direction = np.empty(3)
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
            for i in range(3):
                direction[i] = side * position[at, i] / max(r, 1e-9)
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
    for _ in range(_ROUNDS):
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
    rounds: int,
) -> tuple[float, int, int]:
    """Improve the sightings and the burns in turn until the fuel no longer decreases.

    Args:
        problem: The episode.
        workspace: Its program contains the last solution afterwards.
        sighting: The sightings, shape (P,); read and written.
        first_cutoff: Velocity change above which the first solution is abandoned [m/s].
        cutoff: Velocity change above which the second solution is abandoned [m/s].
        rounds: Largest number of solutions.

    Returns:
        The velocity change [m/s], infinite if there is no solution; the number of basic columns; the number of solved
            programs.
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
