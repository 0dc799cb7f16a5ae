"""The least fuel for given sightings: a linear program, solved by the dual simplex method. Compiled.

Positions are linear in the burns, and a point is seen from all positions beyond a plane. So when it is given at which
step each point is to be looked at, the burns that need the least sum of abs(dv_x) + abs(dv_y) + abs(dv_z) solve

    minimise sum_j c_j |u_j|   such that   a_r . u >= b_r   for each row r,

u_j a velocity change along one axis at one step. No burn at all is feasible for the dual problem, so that the method
starts there; rows may be added to a solved program, and the cost only grows on the way: it can be broken off.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from safe_inspect.compiling import njit
from safe_inspect.planning.coverage.inverse import invert
from safe_inspect.planning.coverage.problem import CoverageProblem
from safe_inspect.types import BoolArray, FloatArray, IntArray

#: Violations smaller than this are none, as a velocity change [m/s].
_TOLERANCE = 1e-12
#: A coefficient smaller than this share of the largest is no pivot.
_PIVOT = 1e-9
#: Prices differ by this much, so that no two burns are equally good and the method does not run in circles.
_APART = 1e-6


class LinearProgram(NamedTuple):
    """A linear program, and how far it is solved. C rows at most, n columns, K tight rows at most.

    Attributes:
        begin: Steps at which burns may begin, ascending, shape (n / 3,); column ``axis * (n / 3) + i`` is the i-th.
        cost: Price of each column, about 1, shape (n,).
        direction: Of each row: the unit vector along which the position counts, shape (C, 3).
        time: The step after which it counts, shape (C,).
        bound: What the burns have to add along it [m], shape (C,).
        matrix: The rows' coefficients [s], shape (C, n).
        known: Whether a row's coefficients are computed, shape (C,).
        tight: Rows that hold with equality, shape (K,).
        basic: Columns that are used, shape (K,).
        sign: Their signs, shape (K,).
        value: Their sizes [m/s], shape (K,).
        price: What one more metre in a tight row would cost [1/s], shape (K,).
    """

    begin: IntArray
    cost: FloatArray
    direction: FloatArray
    time: IntArray
    bound: FloatArray
    matrix: FloatArray
    known: BoolArray
    tight: IntArray
    basic: IntArray
    sign: FloatArray
    value: FloatArray
    price: FloatArray


class Solution(NamedTuple):
    """How the solution of a program ended.

    Attributes:
        solved: Whether the optimum is found; else the cutoff was passed, or there is no solution.
        cost: Velocity change [m/s], infinite when it is not solved.
        size: Number of tight rows, and of columns that are used.
    """

    solved: bool
    cost: float
    size: int


@njit
def linear_program(begin: IntArray, rows: int, most: int) -> LinearProgram:
    """Return an empty program.

    Args:
        begin: Steps at which burns may begin, ascending.
        rows: Number of rows at most.
        most: Number of tight rows at most.
    """
    columns = 3 * begin.shape[0]
    cost = np.empty(columns)
    for j in range(columns):
        cost[j] = 1.0 + _APART * ((j * 0.6180339887498949) % 1.0)
    return LinearProgram(
        begin,
        cost,
        np.zeros((rows, 3)),
        np.zeros(rows, np.int64),
        np.zeros(rows),
        np.zeros((rows, columns)),
        np.zeros(rows, np.bool_),
        np.zeros(most, np.int64),
        np.zeros(most, np.int64),
        np.zeros(most),
        np.zeros(most),
        np.zeros(most),
    )


@njit
def set_row(
    problem: CoverageProblem, program: LinearProgram, row: int, direction: FloatArray, time: int, least: float
) -> None:
    """Ask that the position after `time` steps, along a unit vector, is at least `least` [m]."""
    before = 0.0
    for i in range(3):
        program.direction[row, i] = direction[i]
        before += direction[i] * problem.coast[time, i]
    program.time[row] = time
    program.bound[row] = least - before
    program.known[row] = False


@njit
def _coefficients(problem: CoverageProblem, program: LinearProgram, row: int) -> FloatArray:
    """Return the coefficients of a row, computed once."""
    a: FloatArray = program.matrix[row]
    if not program.known[row]:
        count, last = a.shape[0] // 3, program.time[row]
        x, y, z = program.direction[row]
        a[:] = 0.0
        for i in range(count):
            m = last - program.begin[i]
            if m <= 0:
                break
            response = problem.impulse_response[m]
            a[i] = x * response[0, 0] + y * response[1, 0]
            a[count + i] = x * response[0, 1] + y * response[1, 1]
            a[2 * count + i] = z * response[2, 2]
        program.known[row] = True
    return a


@njit
def _gain(problem: CoverageProblem, program: LinearProgram, row: int, size: int) -> float:
    """Return what the columns that are used add to a row [m]."""
    count, gain = program.cost.shape[0] // 3, 0.0
    for c in range(size):
        axis, m = program.basic[c] // count, program.time[row] - program.begin[program.basic[c] % count]
        if m > 0:
            response, amount = problem.impulse_response[m], program.sign[c] * program.value[c]
            if axis == 2:
                gain += program.direction[row, 2] * response[2, 2] * amount
            else:
                along = program.direction[row, 0] * response[0, axis] + program.direction[row, 1] * response[1, axis]
                gain += along * amount
    return gain


@njit
def _refresh(
    problem: CoverageProblem, program: LinearProgram, size: int, basis: FloatArray, inverse: FloatArray
) -> bool:
    """Compute values and prices of the present basis; return whether it is sound."""
    for i in range(size):
        a = _coefficients(problem, program, program.tight[i])
        for c in range(size):
            basis[i, c] = a[program.basic[c]] * program.sign[c]
    if not invert(basis, inverse, size):
        return False
    for c in range(size):
        value, price = 0.0, 0.0
        for i in range(size):
            value += inverse[c, i] * program.bound[program.tight[i]]
            price += inverse[i, c] * program.cost[program.basic[i]]
        program.value[c], program.price[c] = value, price
    return True


@njit
def _worst(problem: CoverageProblem, program: LinearProgram, rows: int, size: int) -> tuple[int, int]:
    """Return the row and the column that are violated most, one of them -1; both for none."""
    worst, row, column = _TOLERANCE, -1, -1
    for c in range(size):
        if -program.value[c] > worst:
            worst, column = -program.value[c], c
    for r in range(rows):
        if program.bound[r] == -math.inf:
            continue
        authority = max(problem.control_authority[program.time[r], 0], problem.control_authority[program.time[r], 1])
        violation = (program.bound[r] - _gain(problem, program, r, size)) / max(authority, 1e-3)
        if violation > worst:
            used = False
            for i in range(size):
                used |= program.tight[i] == r
            if not used:
                worst, row, column = violation, r, -1
    return row, column


@njit
def solve(
    problem: CoverageProblem, program: LinearProgram, rows: int, size: int, cutoff: float, pivots: int = 300
) -> Solution:
    """Solve a program by the dual simplex method; `program` then holds the columns that are used.

    Args:
        problem: The episode.
        program: The program; its basis is read and written.
        rows: How many rows there are; one with the bound -inf counts for nothing.
        size: Size of the basis to begin with: 0, or what an earlier solution ended with before rows were added.
        cutoff: Break off when the cost passes this [m/s].
        pivots: Give up after so many exchanges.

    Source:
        Lemke, "The dual method of solving the linear programming problem", 1954.
    """
    most, columns = program.tight.shape[0], program.cost.shape[0]
    basis, inverse = np.empty((most, most)), np.empty((most, most))
    shadow, turn, weight = np.empty(columns), np.empty(columns), np.empty(most)
    for _ in range(pivots):
        if not _refresh(problem, program, size, basis, inverse):
            return Solution(False, math.inf, size)
        spent = 0.0
        for c in range(size):
            spent += program.value[c]
        if spent > cutoff:
            return Solution(False, math.inf, size)
        row, column = _worst(problem, program, rows, size)
        if row < 0 and column < 0:
            return Solution(True, spent, size)
        # The prices of the tight rows move by -t weight, that of the violated row by t.
        if row >= 0:
            if size == most:
                return Solution(False, math.inf, size)
            a = _coefficients(problem, program, row)
            for i in range(size):
                total = 0.0
                for c in range(size):
                    total += inverse[c, i] * a[program.basic[c]] * program.sign[c]
                weight[i] = total
            turn[:] = a
        else:
            for i in range(size):
                weight[i] = inverse[column, i]
            turn[:] = 0.0
        shadow[:] = 0.0
        for i in range(size):
            a, price, share = program.matrix[program.tight[i]], program.price[i], weight[i]
            for j in range(columns):
                shadow[j] += price * a[j]
                turn[j] -= share * a[j]
        for c in range(size):
            if c != column:
                turn[program.basic[c]] = 0.0
        leave, enter, best = -1, -1, math.inf
        for i in range(size):
            if weight[i] > _PIVOT:
                ratio = max(program.price[i], 0.0) / weight[i]
                if ratio < best:
                    best, leave = ratio, i
        largest = 0.0
        for j in range(columns):
            largest = max(largest, abs(turn[j]))
        for j in range(columns):
            if abs(turn[j]) <= _PIVOT * largest:
                continue
            ratio = (
                (program.cost[j] - shadow[j]) / turn[j] if turn[j] > 0.0 else (program.cost[j] + shadow[j]) / -turn[j]
            )
            if ratio < best:
                best, enter, leave = max(ratio, 0.0), j, -1
        if leave < 0 and enter < 0:
            return Solution(False, math.inf, size)
        if row >= 0 and enter >= 0:
            program.tight[size], program.basic[size] = row, enter
            program.sign[size] = 1.0 if turn[enter] > 0.0 else -1.0
            size += 1
        elif row >= 0:
            program.tight[leave] = row
        elif enter >= 0:
            program.basic[column] = enter
            program.sign[column] = 1.0 if turn[enter] > 0.0 else -1.0
        else:
            size -= 1
            program.tight[leave] = program.tight[size]
            program.basic[column], program.sign[column] = program.basic[size], program.sign[size]
    return Solution(False, math.inf, size)
