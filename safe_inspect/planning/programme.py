"""The least fuel for given looks: a linear programme, solved by the dual simplex method. Compiled.

Positions are linear in the burns, and a point is seen from all positions beyond a plane. So when it is given at which
step each point is to be looked at, the burns that need the least sum of abs(dv_x) + abs(dv_y) + abs(dv_z) solve

    minimise sum_j c_j |u_j|   such that   a_r . u >= b_r   for each row r,

u_j a velocity change along one axis at one step. No burn at all is feasible for the dual problem, so that the method
starts there; rows may be added to a solved programme, and the cost only grows on the way: it can be broken off.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from safe_inspect.compiling import njit
from safe_inspect.planning.course import Course
from safe_inspect.planning.inverse import invert
from safe_inspect.types import BoolArray, FloatArray, IntArray

#: Violations smaller than this are none, as a velocity change [m/s].
_TOLERANCE = 1e-12
#: A coefficient smaller than this share of the largest is no pivot.
_PIVOT = 1e-9
#: Prices differ by this much, so that no two burns are equally good and the method does not run in circles.
_APART = 1e-6


class Programme(NamedTuple):
    """A linear programme, and how far it is solved. C rows at most, n columns, K tight rows at most.

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
    """How the solution of a programme ended.

    Attributes:
        solved: Whether the optimum is found; else the bar was passed, or there is no solution.
        cost: Velocity change [m/s], infinite when it is not solved.
        size: Number of tight rows, and of columns that are used.
    """

    solved: bool
    cost: float
    size: int


@njit
def programme(begin: IntArray, rows: int, most: int) -> Programme:
    """Return an empty programme.

    Args:
        begin: Steps at which burns may begin, ascending.
        rows: Number of rows at most.
        most: Number of tight rows at most.
    """
    columns = 3 * begin.shape[0]
    cost = np.empty(columns)
    for j in range(columns):
        cost[j] = 1.0 + _APART * ((j * 0.6180339887498949) % 1.0)
    return Programme(
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
def set_row(course: Course, work: Programme, row: int, direction: FloatArray, time: int, least: float) -> None:
    """Ask that the position after `time` steps, along a unit vector, is at least `least` [m]."""
    before = 0.0
    for i in range(3):
        work.direction[row, i] = direction[i]
        before += direction[i] * course.coast[time, i]
    work.time[row] = time
    work.bound[row] = least - before
    work.known[row] = False


@njit
def _coefficients(course: Course, work: Programme, row: int) -> FloatArray:
    """Return the coefficients of a row, computed once."""
    a: FloatArray = work.matrix[row]
    if not work.known[row]:
        count, last = a.shape[0] // 3, work.time[row]
        x, y, z = work.direction[row]
        a[:] = 0.0
        for i in range(count):
            m = last - work.begin[i]
            if m <= 0:
                break
            answer = course.answer[m]
            a[i] = x * answer[0, 0] + y * answer[1, 0]
            a[count + i] = x * answer[0, 1] + y * answer[1, 1]
            a[2 * count + i] = z * answer[2, 2]
        work.known[row] = True
    return a


@njit
def _gain(course: Course, work: Programme, row: int, size: int) -> float:
    """Return what the columns that are used add to a row [m]."""
    count, gain = work.cost.shape[0] // 3, 0.0
    for c in range(size):
        axis, m = work.basic[c] // count, work.time[row] - work.begin[work.basic[c] % count]
        if m > 0:
            answer, amount = course.answer[m], work.sign[c] * work.value[c]
            if axis == 2:
                gain += work.direction[row, 2] * answer[2, 2] * amount
            else:
                along = work.direction[row, 0] * answer[0, axis] + work.direction[row, 1] * answer[1, axis]
                gain += along * amount
    return gain


@njit
def _refresh(course: Course, work: Programme, size: int, room: FloatArray, inverse: FloatArray) -> bool:
    """Compute values and prices of the present basis; return whether it is sound."""
    for i in range(size):
        a = _coefficients(course, work, work.tight[i])
        for c in range(size):
            room[i, c] = a[work.basic[c]] * work.sign[c]
    if not invert(room, inverse, size):
        return False
    for c in range(size):
        value, price = 0.0, 0.0
        for i in range(size):
            value += inverse[c, i] * work.bound[work.tight[i]]
            price += inverse[i, c] * work.cost[work.basic[i]]
        work.value[c], work.price[c] = value, price
    return True


@njit
def _worst(course: Course, work: Programme, rows: int, size: int) -> tuple[int, int]:
    """Return the row and the column that are violated most, one of them -1; both for none."""
    worst, row, column = _TOLERANCE, -1, -1
    for c in range(size):
        if -work.value[c] > worst:
            worst, column = -work.value[c], c
    for r in range(rows):
        if work.bound[r] == -math.inf:
            continue
        lever = max(course.lever[work.time[r], 0], course.lever[work.time[r], 1])
        violation = (work.bound[r] - _gain(course, work, r, size)) / max(lever, 1e-3)
        if violation > worst:
            used = False
            for i in range(size):
                used |= work.tight[i] == r
            if not used:
                worst, row, column = violation, r, -1
    return row, column


@njit
def solve(course: Course, work: Programme, rows: int, size: int, bar: float, pivots: int = 300) -> Solution:
    """Solve a programme by the dual simplex method; `work` then holds the columns that are used.

    Args:
        course: The episode.
        work: The programme; its basis is read and written.
        rows: How many rows there are; one with the bound -inf counts for nothing.
        size: Size of the basis to begin with: 0, or what an earlier solution ended with before rows were added.
        bar: Break off when the cost passes this [m/s].
        pivots: Give up after so many exchanges.

    Source:
        Lemke, "The dual method of solving the linear programming problem", 1954.
    """
    most, columns = work.tight.shape[0], work.cost.shape[0]
    room, inverse = np.empty((most, most)), np.empty((most, most))
    shadow, turn, weight = np.empty(columns), np.empty(columns), np.empty(most)
    for _ in range(pivots):
        if not _refresh(course, work, size, room, inverse):
            return Solution(False, math.inf, size)
        spent = 0.0
        for c in range(size):
            spent += work.value[c]
        if spent > bar:
            return Solution(False, math.inf, size)
        row, column = _worst(course, work, rows, size)
        if row < 0 and column < 0:
            return Solution(True, spent, size)
        # The prices of the tight rows move by -t weight, that of the violated row by t.
        if row >= 0:
            if size == most:
                return Solution(False, math.inf, size)
            a = _coefficients(course, work, row)
            for i in range(size):
                total = 0.0
                for c in range(size):
                    total += inverse[c, i] * a[work.basic[c]] * work.sign[c]
                weight[i] = total
            turn[:] = a
        else:
            for i in range(size):
                weight[i] = inverse[column, i]
            turn[:] = 0.0
        shadow[:] = 0.0
        for i in range(size):
            a, price, share = work.matrix[work.tight[i]], work.price[i], weight[i]
            for j in range(columns):
                shadow[j] += price * a[j]
                turn[j] -= share * a[j]
        for c in range(size):
            if c != column:
                turn[work.basic[c]] = 0.0
        leave, enter, best = -1, -1, math.inf
        for i in range(size):
            if weight[i] > _PIVOT:
                ratio = max(work.price[i], 0.0) / weight[i]
                if ratio < best:
                    best, leave = ratio, i
        largest = 0.0
        for j in range(columns):
            largest = max(largest, abs(turn[j]))
        for j in range(columns):
            if abs(turn[j]) <= _PIVOT * largest:
                continue
            ratio = (work.cost[j] - shadow[j]) / turn[j] if turn[j] > 0.0 else (work.cost[j] + shadow[j]) / -turn[j]
            if ratio < best:
                best, enter, leave = max(ratio, 0.0), j, -1
        if leave < 0 and enter < 0:
            return Solution(False, math.inf, size)
        if row >= 0 and enter >= 0:
            work.tight[size], work.basic[size] = row, enter
            work.sign[size] = 1.0 if turn[enter] > 0.0 else -1.0
            size += 1
        elif row >= 0:
            work.tight[leave] = row
        elif enter >= 0:
            work.basic[column] = enter
            work.sign[column] = 1.0 if turn[enter] > 0.0 else -1.0
        else:
            size -= 1
            work.tight[leave] = work.tight[size]
            work.basic[column], work.sign[column] = work.basic[size], work.sign[size]
    return Solution(False, math.inf, size)
