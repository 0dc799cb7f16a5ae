"""Room for one row's intermediate results, made once for a batch: compiled rows then allocate nothing."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from safe_inspect.compiling import njit
from safe_inspect.rta.filters.backup.closed_motion import ROOM
from safe_inspect.types import BoolArray, FloatArray, IntArray


class Scratch(NamedTuple):
    """Arrays that a row overwrites.

    Attributes:
        work: For `closed_motion`, shape `ROOM`.
        cells: For `hold`, shape (64, 4).
        where: Where a hold was refused, shape (2,).
        at: The same, of a plan's hold.
        rows: Half-spaces' normals, shape (M, 3).
        bounds: Half-spaces' right-hand sides, shape (M,).
        missed: Half-spaces that were broken, shape (M,).
        a: Unit normals with the box, shape (M + 6, 3).
        c: Offsets with the box, shape (M + 6,).
        size: Lengths of the rows, shape (M,).
        d: A direction of states, shape (6,).
        w: A control or point, shape (3,), as are the rest.
    """

    work: FloatArray
    cells: IntArray
    where: IntArray
    at: IntArray
    rows: FloatArray
    bounds: FloatArray
    missed: BoolArray
    a: FloatArray
    c: FloatArray
    size: FloatArray
    d: FloatArray
    w: FloatArray
    desired: FloatArray
    backup: FloatArray
    proposal: FloatArray
    trial: FloatArray
    best: FloatArray


@njit(error_model="numpy")
def scratch(most: int) -> Scratch:
    """Return room for programmes of up to `most` half-spaces."""
    return Scratch(
        np.empty(ROOM), np.empty((64, 4), np.int64), np.empty(2, np.int64), np.empty(2, np.int64),
        np.empty((most, 3)), np.empty(most), np.empty(most, np.bool_),
        np.empty((most + 6, 3)), np.empty(most + 6), np.empty(most),
        np.empty(6), np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3),
    )  # fmt: skip


@njit(error_model="numpy")
def plain(value: int) -> int:
    """Return a constant as a number: passed as a literal, the compiler would make a copy of the callee for it."""
    return int(np.int64(value))
