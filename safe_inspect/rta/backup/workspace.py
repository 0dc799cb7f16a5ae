"""Arrays for the intermediate results of one row, created once per batch so that compiled rows allocate nothing."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from safe_inspect.compiling import BORROWING, njit
from safe_inspect.rta.backup.closed_motion import NODE_STACK
from safe_inspect.rta.backup.model import PLANS
from safe_inspect.rta.projection import ProjectionWorkspace, projection_workspace
from safe_inspect.types import AnyArray, FloatArray, IntArray

#: Largest number of half-spaces of one row's quadratic programme.
MAX_HALF_SPACES = 48


class Workspace(NamedTuple):
    """Arrays that a row overwrites.

    Attributes:
        work: For `closed_motion`, shape `NODE_STACK`.
        weak: Nodes at which the closed motion of each plan was last rejected, and of a pair, shape (PLANS + 1, 2).
        cells: For `hold`, shape (64, 4).
        where: Where a hold was rejected, shape (2,).
        at: Where the hold of a plan was rejected, shape (2,).
        rows: Normals of the half-spaces, shape (M, 3).
        bounds: Right-hand sides of the half-spaces, shape (M,).
        projection: For `nearest`.
        d: A direction of states, shape (6,).
        w: A control or point, shape (3,), as are the following arrays; `lead` and `then` are those of `plans`.
    """

    work: FloatArray
    weak: IntArray
    cells: IntArray
    where: IntArray
    at: IntArray
    rows: FloatArray
    bounds: FloatArray
    projection: ProjectionWorkspace
    d: FloatArray
    w: FloatArray
    desired: FloatArray
    backup: FloatArray
    proposal: FloatArray
    trial: FloatArray
    best: FloatArray
    plan: FloatArray
    lead: FloatArray
    then: FloatArray


@njit(error_model="numpy")
def workspace(most: int) -> Workspace:
    """Return a workspace for programmes of up to `most` half-spaces."""
    return Workspace(
        np.empty(NODE_STACK), np.zeros((PLANS + 1, 2), np.int64),
        np.empty((64, 4), np.int64), np.empty(2, np.int64), np.empty(2, np.int64),
        np.empty((most, 3)), np.empty(most), projection_workspace(most),
        np.empty(6), np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3),
        np.empty(3), np.empty(3),
    )  # fmt: skip


@njit(**BORROWING)
def copy(source: AnyArray, target: AnyArray) -> None:
    """Copy the elements of an array to another one of that size."""
    for k in range(source.shape[0]):
        target[k] = source[k]


@njit(error_model="numpy")
def as_int(value: int) -> int:
    """Return a constant as an integer of type int64.

    If a function is called with a literal, Numba compiles a separate copy of it for that literal.
    """
    return int(np.int64(value))


@njit(error_model="numpy")
def as_bool(value: bool) -> bool:
    """Return a constant as a value of type bool; see `as_int`."""
    return bool(np.bool_(value))
