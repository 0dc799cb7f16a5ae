"""The kernel of the fused step: observations, rewards and ends of a group, one operation after the other."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from safe_inspect.compiling import njit
from safe_inspect.environments.fused import codes
from safe_inspect.environments.fused.reading import fill_room, read
from safe_inspect.types import BoolArray, FloatArray, IntArray

#: Bits of what `judge` returns.
NOT_FINITE, ENDED = 1, 2


@njit
def _observe(
    floats: FloatArray,
    wholes: IntArray,
    room: FloatArray,
    places: IntArray,
    size: int,
    elements: IntArray,
    factors: FloatArray,
    observation: NDArray[np.float32],
) -> bool:
    """Write the observations; return whether they are finite."""
    finite, column = True, np.empty(room.shape[1])
    for e in range(elements.shape[0]):
        if elements[e, 0] == codes.FOREIGN:
            continue
        read(floats, wholes, room, places, size, elements[e, 0], elements[e, 1], column)
        scale, a, b, c = factors[e, 0], factors[e, 1], factors[e, 2], factors[e, 3]
        if elements[e, 2]:
            for row in range(len(column)):
                column[row] = c + (column[row] * scale - a) * b
        else:
            for row in range(len(column)):
                column[row] = (column[row] * scale - a) / b
        for row in range(len(column)):
            finite &= math.isfinite(column[row])
            observation[row, e] = np.float32(column[row])
    return finite


@njit
def observe(
    floats: FloatArray,
    wholes: IntArray,
    position: FloatArray,
    velocity: FloatArray,
    deputies: int,
    first: int,
    size: int,
    places: IntArray,
    vectors: IntArray,
    vector_limits: FloatArray,
    room_size: int,
    elements: IntArray,
    factors: FloatArray,
    observation: NDArray[np.float32],
) -> bool:
    """Write the observations of a group; the arguments are those of `judge`. Return whether all is finite."""
    room = np.empty((room_size, position.shape[0] * size))
    finite = fill_room(
        floats, wholes, position, velocity, deputies, first, size, places, vectors, vector_limits, room
    )  # fmt: skip
    return _observe(floats, wholes, room, places, size, elements, factors, observation) and finite


@njit
def _term(
    wholes: IntArray,
    old_floats: FloatArray,
    old_wholes: IntArray,
    room: FloatArray,
    control: FloatArray,
    step_place: int,
    first: int,
    intervening: BoolArray,
    places: IntArray,
    code: int,
    index: int,
    count: int,
    scale: float,
    burn: FloatArray,
    value: FloatArray,
) -> None:
    """Write one term of the reward, shape (R,)."""
    size = len(burn)
    for n in range(control.shape[0]):
        for g in range(size):
            row = n * size + g
            if code == codes.NEW_POINTS:
                at = places[index, 0] + n * places[index, 1]
                known = 0 if old_wholes[step_place + n] == 0 else old_wholes[at]
                value[row] = scale * float(wholes[at] - known)
            elif code == codes.ALL_POINTS:
                value[row] = scale if wholes[places[index, 0] + n * places[index, 1]] >= count else 0.0
            elif code == codes.NEAR:
                value[row] = scale if room[index, row] < burn[g] else 0.0
            elif code == codes.FUEL:
                price = scale if index < 0 else old_floats[places[index, 0] + n * places[index, 1]]
                d = first + g
                value[row] = price * ((abs(control[n, d, 0]) + abs(control[n, d, 1]) + abs(control[n, d, 2])) * burn[g])
            else:
                value[row] = scale if intervening[row] else 0.0


@njit
def judge(
    floats: FloatArray,
    wholes: IntArray,
    old_floats: FloatArray,
    old_wholes: IntArray,
    position: FloatArray,
    velocity: FloatArray,
    control: FloatArray,
    finished: NDArray[np.int8],
    step_place: int,
    first: int,
    size: int,
    intervening: BoolArray,
    places: IntArray,
    vectors: IntArray,
    vector_limits: FloatArray,
    room_size: int,
    elements: IntArray,
    factors: FloatArray,
    terms: IntArray,
    scales: FloatArray,
    burns: FloatArray,
    dones: IntArray,
    limits: FloatArray,
    observation: NDArray[np.float32],
    values: FloatArray,
    flags: BoolArray,
    status: NDArray[np.int8],
) -> int:
    """Write what a step gives for the agents of a group, R = N * G rows.

    Args:
        floats: The memory of the state after the step as float64.
        wholes: The same memory as int64.
        old_floats: The memory of the state before the step as float64.
        old_wholes: The same memory as int64.
        position: Positions of the bodies, the deputies first [m], shape (N, B, 3).
        velocity: Velocities [m/s], shape (N, B, 3).
        control: Thrusts held over the step [N], shape (N, D, 3).
        finished: How the agents had ended before the step, 0 for those that take part, shape (N, D).
        step_place: Index of the first environment's number of steps in the memory.
        first: Index of the group's first deputy.
        size: Number of the group's deputies, G.
        intervening: Rows in which a safety filter changed the thrust, shape (R,).
        places: Of each source its index in the memory, and the distances of environments and agents, shape (S, 3).
        vectors: Operations that fill the row's room: code, place in the room, size, four numbers, shape (V, 7).
        vector_limits: Their ranges [m], shape (V,).
        room_size: Numbers in the room.
        elements: Of each element of an observation code, index, and whether it is mapped linearly, shape (O, 3).
        factors: Scale, mean, deviation, or scale, low, slope, minimum, shape (O, 4).
        terms: Of each term code, place and count, shape (T, 3).
        scales: Scale of each term, shape (T,).
        burns: The other factor of each term: a radius [m], or dt / m [s/kg], shape (T, G).
        dones: Of each end code, place, count, status, and whether it truncates, shape (K, 5).
        limits: Limit of each end [m], shape (K,).
        observation: Takes the observations, shape (R, O); what is foreign stands there.
        values: Takes the rewards and the terms, shape (1 + T, R); what is foreign stands there.
        flags: Takes who is terminated and who truncated, and what each end said, shape (2 + K, R); likewise.
        status: Takes the statuses, shape (R,).

    Returns:
        `NOT_FINITE` when an observation, a reward or a range is not finite, plus `ENDED` when a status is not 0.
    """
    rows, environments, deputies = len(status), control.shape[0], control.shape[1]
    room = np.empty((room_size, rows))
    finite = fill_room(
        floats, wholes, position, velocity, deputies, first, size, places, vectors, vector_limits, room
    )  # fmt: skip
    finite &= _observe(floats, wholes, room, places, size, elements, factors, observation)
    values[0] = 0.0
    for t in range(terms.shape[0]):
        if terms[t, 0] != codes.FOREIGN:
            _term(
                wholes, old_floats, old_wholes, room, control, step_place, first, intervening, places,
                terms[t, 0], terms[t, 1], terms[t, 2], scales[t], burns[t], values[1 + t],
            )  # fmt: skip
        for row in range(rows):
            values[0, row] += values[1 + t, row]
    for row in range(rows):
        finite &= math.isfinite(values[0, row])
    flags[:2], status[:] = False, 0
    for k in range(dones.shape[0]):
        code, index, count = dones[k, 0], dones[k, 1], dones[k, 2]
        if code == codes.COUNT:
            for row in range(rows):
                flags[2 + k, row] = wholes[places[index, 0] + (row // size) * places[index, 1]] >= count
        elif code != codes.FOREIGN:
            for row in range(rows):
                distance = room[index, row]
                flags[2 + k, row] = distance > limits[k] if code == codes.FAR else distance < limits[k]
        kind = 1 if dones[k, 4] else 0
        for row in range(rows):
            if flags[2 + k, row]:
                flags[kind, row] = True
                status[row] = dones[k, 3]
    ended = False
    for n in range(environments):
        for g in range(size):
            row = n * size + g
            flags[1, row] &= not flags[0, row]
            if finished[n, first + g] != 0:
                values[:, row] = 0.0
                flags[:, row] = False
                status[row] = finished[n, first + g]
            ended |= status[row] != 0
    return (0 if finite else NOT_FINITE) + (ENDED if ended else 0)
