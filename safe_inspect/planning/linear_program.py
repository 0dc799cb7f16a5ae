"""The least fuel for given sightings: a linear program, solved by the dual simplex method. Compiled.

Positions are linear in the burns, and a point is seen from all positions beyond a plane. If the step at which each
point is to be seen is given, the burns with the least sum of abs(dv_x) + abs(dv_y) + abs(dv_z) therefore solve

    minimise sum_j c_j |u_j|   such that   a_r . u >= b_r   for each row r,

where u_j is a velocity change along one axis at one step. The absence of burns is feasible for the dual problem, so the
method starts there. Rows may be added to a solved program, and the cost only increases during the solution, so that it
can be stopped at a cutoff.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from safe_inspect.compiling import njit
from safe_inspect.planning.coverage_problem import CoverageProblem
from safe_inspect.types import BoolArray, FloatArray, IntArray

#: Largest violation that is tolerated, as a velocity change [m/s].
_TOLERANCE = 1e-12
#: Smallest pivot as a share of the largest coefficient.
_PIVOT = 1e-9
#: Range of the differences between costs, so that no two burns are equally good and the method does not cycle.
_APART = 1e-6
#: Smallest allowed pivot of an inverse.
_SINGULAR = 1e-9
#: Largest number of pivots.
_PIVOTS = 300


class LinearProgram(NamedTuple):
    """A linear program and the state of its solution, with at most C rows, n columns and at most K tight rows.

    Attributes:
        begin: Steps at which burns may start, ascending, shape (n / 3,); column ``axis * (n / 3) + i`` belongs to the
            i-th.
        cost: Cost of each column, about 1, shape (n,).
        direction: For each row the unit vector along which the position counts, shape (C, 3).
        time: For each row the step after which the position counts, shape (C,).
        bound: Least contribution of the burns along the direction [m], shape (C,).
        matrix: Coefficients of the rows [s], shape (C, n).
        known: Whether the coefficients of a row have been computed, shape (C,).
        tight: Rows that hold with equality, shape (K,).
        basic: Columns of the basis, shape (K,).
        sign: Their signs, shape (K,).
        value: Their sizes [m/s], shape (K,).
        price: Dual value of each tight row: the cost of one more metre [1/s], shape (K,).
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


@njit
def linear_program(begin: IntArray, rows: int, most: int) -> LinearProgram:
    """Return an empty program.

    Args:
        begin: Steps at which burns may start, ascending.
        rows: Largest number of rows.
        most: Largest number of tight rows.
    """
    columns = 3 * begin.shape[0]
    return LinearProgram(
        begin,
        1.0 + _APART * ((np.arange(columns) * 0.6180339887498949) % 1.0),
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
    """Set a row: the position after `time` steps, along a unit vector, must be at least `least` [m]."""
    x, y, z = problem.coast[time]
    program.direction[row] = direction
    program.time[row] = time
    program.bound[row] = least - (direction[0] * x + direction[1] * y + direction[2] * z)
    program.known[row] = False


@njit
def _coefficients(problem: CoverageProblem, program: LinearProgram, row: int) -> FloatArray:
    """Return the coefficients of a row, which are computed once."""
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
    """Return the contribution of the basic columns to a row [m]."""
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
def _invert(matrix: FloatArray, inverse: FloatArray, size: int) -> bool:
    """Write the inverse of a matrix by Gauss-Jordan elimination with partial pivoting; return whether it exists.

    It does not use BLAS, so that its bits are the same on every machine.

    Args:
        matrix: The matrix, in the first `size` rows and columns; it is overwritten.
        inverse: Output: the inverse, in the same rows and columns.
        size: Number of rows.
    """
    inverse[:size, :size] = np.eye(size)
    for i in range(size):
        best = i
        for k in range(i + 1, size):
            if abs(matrix[k, i]) > abs(matrix[best, i]):
                best = k
        if abs(matrix[best, i]) < _SINGULAR:
            return False
        if best != i:
            for j in range(size):
                matrix[i, j], matrix[best, j] = matrix[best, j], matrix[i, j]
                inverse[i, j], inverse[best, j] = inverse[best, j], inverse[i, j]
        pivot = 1.0 / matrix[i, i]
        for j in range(size):
            matrix[i, j] *= pivot
            inverse[i, j] *= pivot
        for k in range(size):
            factor = matrix[k, i]
            if k != i and factor != 0.0:
                for j in range(size):
                    matrix[k, j] -= factor * matrix[i, j]
                    inverse[k, j] -= factor * inverse[i, j]
    return True


@njit
def _refresh(
    problem: CoverageProblem, program: LinearProgram, size: int, basis: FloatArray, inverse: FloatArray
) -> bool:
    """Compute values and prices of the current basis; return whether it is regular."""
    for i in range(size):
        a = _coefficients(problem, program, program.tight[i])
        for c in range(size):
            basis[i, c] = a[program.basic[c]] * program.sign[c]
    if not _invert(basis, inverse, size):
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
    """Return the row or the basic column that is violated most, and -1 for the other; -1 for both if none is."""
    worst, row, column = _TOLERANCE, -1, -1
    for c in range(size):
        if -program.value[c] > worst:
            worst, column = -program.value[c], c
    for r in range(rows):
        authority = max(problem.control_authority[program.time[r], 0], problem.control_authority[program.time[r], 1])
        violation = (program.bound[r] - _gain(problem, program, r, size)) / max(authority, 1e-3)
        if violation > worst and not (program.tight[:size] == r).any():
            worst, row, column = violation, r, -1
    return row, column


@njit
def solve(problem: CoverageProblem, program: LinearProgram, rows: int, size: int, cutoff: float) -> tuple[float, int]:
    """Solve a program by the dual simplex method; the basis of `program` is the solution afterwards.

    Args:
        problem: The episode.
        program: The program; its basis is read and written.
        rows: Number of rows.
        size: Size of the initial basis: 0, or that of an earlier solution before rows were added.
        cutoff: Cost above which the solution is abandoned [m/s].

    Returns:
        The velocity change [m/s], infinite if the cutoff was exceeded or no solution was found; and the number of tight
            rows, which is also that of basic columns.

    Source:
        Lemke, "The dual method of solving the linear programming problem", 1954.
    """
    most, columns = program.tight.shape[0], program.cost.shape[0]
    basis, inverse = np.empty((most, most)), np.empty((most, most))
    shadow, turn, weight = np.empty(columns), np.empty(columns), np.empty(most)
    for _ in range(_PIVOTS):
        if not _refresh(problem, program, size, basis, inverse):
            return math.inf, size
        spent = program.value[:size].sum()
        if spent > cutoff:
            return math.inf, size
        row, column = _worst(problem, program, rows, size)
        if row < 0 and column < 0:
            return spent, size
        # With a step t, the prices of the tight rows change by -t weight and that of the violated row by t.
        if row >= 0:
            if size == most:
                return math.inf, size
            a = _coefficients(problem, program, row)
            for i in range(size):
                total = 0.0
                for c in range(size):
                    total += inverse[c, i] * a[program.basic[c]] * program.sign[c]
                weight[i] = total
            turn[:] = a
        else:
            weight[:size] = inverse[column, :size]
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
        largest = np.abs(turn).max()
        for j in range(columns):
            if abs(turn[j]) <= _PIVOT * largest:
                continue
            ratio = (
                (program.cost[j] - shadow[j]) / turn[j] if turn[j] > 0.0 else (program.cost[j] + shadow[j]) / -turn[j]
            )
            if ratio < best:
                best, enter, leave = max(ratio, 0.0), j, -1
        if leave < 0 and enter < 0:
            return math.inf, size
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
    return math.inf, size
