"""The kernels of the fused step that read a state: vectors and single numbers, for all rows of a group at a time."""

from __future__ import annotations

import math

import numpy as np

from safe_inspect.compiling import njit
from safe_inspect.environments.fused import codes
from safe_inspect.geometry.nearest import direction_to_nearest
from safe_inspect.geometry.neighbours import nearest_to, outwards
from safe_inspect.types import FloatArray, IntArray

_TURN = 2.0 * math.pi


@njit
def _wrapped(angle: float) -> float:
    """Return an angle within [0, 2 pi), as NumPy's `mod` does."""
    if 0.0 < angle < _TURN:
        return angle
    rest = np.fmod(angle, _TURN)
    if rest == 0.0:
        return 0.0
    if rest < 0.0:
        rest += _TURN
    return 0.0 if rest >= _TURN else rest


@njit
def read(
    floats: FloatArray,
    wholes: IntArray,
    room: FloatArray,
    places: IntArray,
    size: int,
    code: int,
    index: int,
    column: FloatArray,
) -> None:
    """Write the reading of one element of an observation, shape (R,)."""
    rows = len(column)
    if code == codes.ROOM:
        column[:] = room[index]
        return
    start, per_env, per_agent = places[index, 0], places[index, 1], places[index, 2]
    for n in range(rows // size):
        for g in range(size):
            at = start + n * per_env + g * per_agent
            column[n * size + g] = float(wholes[at]) if code == codes.WHOLE else floats[at]
    if code == codes.ANGLE:
        for row in range(rows):
            column[row] = _wrapped(column[row])


@njit
def _ranges(
    floats: FloatArray, own: IntArray, reference: IntArray, related: bool, size: int, distance: FloatArray
) -> bool:
    """Write the distance of each row to a reference; return whether all are finite."""
    finite = True
    for n in range(len(distance) // size):
        for g in range(size):
            a = own[0] + n * own[1] + g * own[2]
            x, y, z = floats[a], floats[a + 1], floats[a + 2]
            if related:
                b = reference[0] + n * reference[1]
                x, y, z = x - floats[b], y - floats[b + 1], z - floats[b + 2]
            distance[n * size + g] = math.sqrt(x * x + y * y + z * z)
            finite &= math.isfinite(distance[n * size + g])
    return finite


@njit
def _directions(
    floats: FloatArray,
    wholes: IntArray,
    viewer: IntArray,
    body: IntArray,
    centres: IntArray,
    count: IntArray,
    size: int,
    room: FloatArray,
) -> None:
    """Write the direction from each row's body to its nearest cluster, shape (3, R)."""
    for n in range(room.shape[1] // size):
        for g in range(size):
            a, b = viewer[0] + n * viewer[1] + g * viewer[2], body[0] + n * body[1]
            room[0, n * size + g], room[1, n * size + g], room[2, n * size + g] = direction_to_nearest(
                floats[a] - floats[b],
                floats[a + 1] - floats[b + 1],
                floats[a + 2] - floats[b + 2],
                floats,
                centres[0] + n * centres[1] + g * centres[2],
                wholes[count[0] + n * count[1] + g * count[2]],
            )


@njit
def _others(
    position: FloatArray,
    velocity: FloatArray,
    deputies: int,
    first: int,
    size: int,
    code: int,
    count: int,
    max_range: float,
    room: FloatArray,
) -> None:
    """Write what concerns the nearest other deputies of each row, shape (3 k, R), or (k, R) for their presence."""
    found, least = np.empty(count, dtype=np.int64), np.empty(count)
    values = position if code == codes.NEAREST_POSITIONS else velocity
    for row in range(room.shape[1]):
        n, own = row // size, first + row % size
        nearest_to(position, deputies, n, own, max_range, found, least)
        if code == codes.NEAREST_PRESENCE:
            for k in range(count):
                room[k, row] = 1.0 if found[k] >= 0 else 0.0
            continue
        x, y, z = 0.0, 0.0, 0.0
        if code == codes.NEAREST_POSITIONS and found[count - 1] < 0:
            x, y, z = outwards(position[n, own], max_range)
        for k in range(count):
            if found[k] >= 0:
                for axis in range(3):
                    room[3 * k + axis, row] = values[n, found[k], axis] - values[n, own, axis]
            else:
                room[3 * k, row], room[3 * k + 1, row], room[3 * k + 2, row] = x, y, z


@njit
def fill_room(
    floats: FloatArray,
    wholes: IntArray,
    position: FloatArray,
    velocity: FloatArray,
    deputies: int,
    first: int,
    size: int,
    places: IntArray,
    vectors: IntArray,
    limits: FloatArray,
    room: FloatArray,
) -> bool:
    """Work out the vectors of all rows, shape (S, R); return whether every range is finite."""
    finite = True
    for v in range(vectors.shape[0]):
        code, to, count = vectors[v, 0], vectors[v, 1], vectors[v, 2]
        a, b, c, d = vectors[v, 3], vectors[v, 4], vectors[v, 5], vectors[v, 6]
        if code == codes.RANGE:
            finite &= _ranges(floats, places[a], places[max(b, 0)], b >= 0, size, room[to])
        elif code == codes.NEAREST_CENTRE:
            _directions(floats, wholes, places[a], places[b], places[c], places[d], size, room[to : to + count])
        else:
            _others(position, velocity, deputies, first, size, code, a, limits[v], room[to : to + count])
    return finite
