"""The kernel of the fused step: it calls the row terms of a group by their addresses, and combines their results."""

from __future__ import annotations

import math

import numpy as np
from numba import int64
from numpy.typing import NDArray

from safe_inspect.compiling import njit
from safe_inspect.compiling.addresses import call_at
from safe_inspect.types import AnyArray, BoolArray, FloatArray, IntArray

#: Bits of the result of `evaluate_step`.
NOT_FINITE, ENDED = 1, 2
#: Kinds of result of a call: the first column of `calls`.
READING, REWARD, DONE, STATUS = 0, 1, 2, 3


@njit(error_model="numpy", forceinline=True)
def _address(array: AnyArray) -> int:
    """Return the address of an array's numbers; Numba's own is unsigned, and adding an index would make it a float."""
    return int64(array.ctypes.data)  # type: ignore[return-value]


@njit(error_model="numpy")
def _call(c: int, calls: IntArray, bases: IntArray, out: int, environments: int, agents: int) -> bool:
    """Call the loop of a row term (see `row_terms`) at its address; return whether it raised no exception."""
    given = (calls[c, 3], _address(bases), out, environments, agents)
    return call_at(calls[c, 2], int64, given) != 0  # type: ignore[call-arg]


@njit(error_model="numpy")
def _map(readings: FloatArray, factors: FloatArray, asked: BoolArray, observation: NDArray[np.float32]) -> bool:
    """Write the requested observations from the readings; return whether all readings and observations are finite."""
    finite, size = True, observation.shape[1]
    for row in range(observation.shape[0]):
        if not asked[row]:
            for e in range(size):
                observation[row, e] = np.float32(np.nan)
            continue
        for e in range(size):
            value = (readings[row, e] * factors[0, e] - factors[1, e]) * factors[2, e] / factors[3, e] + factors[4, e]
            finite &= math.isfinite(value)
            observation[row, e] = np.float32(value)
        for e in range(size, readings.shape[1]):
            finite &= math.isfinite(readings[row, e])
    return finite


@njit(error_model="numpy")
def observe(
    calls: IntArray, bases: IntArray, environments: int, factors: FloatArray, readings: FloatArray,
    asked: BoolArray, observation: NDArray[np.float32],
) -> bool:  # fmt: skip
    """Write the observations of a group; return whether all values are finite. Arguments as for `evaluate_step`."""
    agents, sound = observation.shape[0] // max(environments, 1), True
    for c in range(calls.shape[0]):
        if calls[c, 0] == READING:
            out = _address(readings) + 8 * calls[c, 1]
            sound &= _call(c, calls, bases, out, environments, agents)
    return _map(readings, factors, asked, observation) and sound


@njit(error_model="numpy")
def evaluate_step(
    calls: IntArray, bases: IntArray, endings: IntArray, factors: FloatArray, readings: FloatArray,
    observation: NDArray[np.float32], values: FloatArray, flags: BoolArray, status: NDArray[np.int8],
) -> int:  # fmt: skip
    """Write the result of a step for the agents of a group, R = N * G rows.

    Args:
        calls: The row terms: kind of the result, index of the column, reward or done, and the addresses of the loop and
            of its table, shape (C, 4).
        bases: Start addresses of the memory that the terms read, see `MemoryBase`.
        endings: Status of each done, and whether it truncates; the last row contains N and the number of calls at the
            end that only the observations need, shape (K + 1, 2).
        factors: For each element of an observation: its scale, then the numbers that `Affine` subtracts, multiplies by,
            divides by and adds, shape (5, O).
        readings: Output: the readings, those of the observation first, shape (R, S). Readings of plugins that are
            called in Python must already be in it.
        observation: Output: the requested observations, shape (R, O); the others are NaN.
        values: Output: the rewards and the terms, shape (1 + T, R). Terms of plugins that are called in Python must
            already be in it.
        flags: Output: terminated, truncated, and the result of each done, with those of Python plugins already in it.
            The last row is the mask of the requested observations, to which agents that end in this step are added.
            Shape (2 + K + 1, R).
        status: Output: the statuses, shape (R,).

    Returns:
        `NOT_FINITE` when a reading, an observation or a reward is not finite, or a row kernel raised an exception, plus
        `ENDED` when a status is not 0.
    """
    rows, environments, dones = len(status), endings[-1, 0], len(endings) - 1
    agents, sound, first = rows // environments, True, calls.shape[0] - endings[-1, 1]
    asked = flags[2 + dones]
    for c in range(first):
        kind, index = calls[c, 0], calls[c, 1]
        if kind == READING:
            out = _address(readings) + 8 * index
        elif kind == REWARD:
            out = _address(values) + 8 * (1 + index) * rows
        elif kind == DONE:
            out = _address(flags) + (2 + index) * rows
        else:
            out = _address(status)
        sound &= _call(c, calls, bases, out, environments, agents)
    for row in range(rows):
        values[0, row] = 0.0
        flags[0, row] = flags[1, row] = False
    for t in range(1, values.shape[0]):
        for row in range(rows):
            values[0, row] += values[t, row]
    ended = False
    for row in range(rows):
        sound &= math.isfinite(values[0, row])
        if status[row] != 0:  # the agent had ended before the step
            for t in range(values.shape[0]):
                values[t, row] = 0.0
            for k in range(2 + dones):
                flags[k, row] = False
        else:
            for k in range(dones):
                if flags[2 + k, row]:
                    flags[endings[k, 1], row] = True
                    status[row] = endings[k, 0]
            flags[1, row] &= not flags[0, row]
            asked[row] |= status[row] != 0
        ended |= status[row] != 0
    for c in range(first, calls.shape[0]):
        out = _address(readings) + 8 * calls[c, 1]
        sound &= _call(c, calls, bases, out, environments, agents)
    sound &= _map(readings, factors, asked, observation)
    return (0 if sound else NOT_FINITE) + (ENDED if ended else 0)
