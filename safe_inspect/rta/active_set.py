"""Joint control nearest to the desired one within half-spaces: one quadratic programme over all deputies, compiled.

The dual active-set method of Goldfarb and Idnani ("A numerically stable dual method for solving strictly convex
quadratic programs", Mathematical Programming 27, 1983) for an identity Hessian: starting from the desired control, the
half-space that is violated most is added, and those whose multipliers become zero are dropped. The active normals are
stored as an orthonormal basis and a triangular matrix, rebuilt when one is dropped: there are at most 3 D of them.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from safe_inspect.compiling import BORROWING, njit
from safe_inspect.types import FloatArray

#: A half-space counts as satisfied within this distance.
_TOLERANCE = 1e-10
#: A normal depends on the active ones if the squared length of its part outside them is less than this.
_DEPENDENT = 1e-14
_STEPS = 20


class QPWorkspace(NamedTuple):
    """Arrays of one problem of V variables, which are overwritten.

    Attributes:
        normal: Normal of the half-space that is being added, shape (V,).
        step: Part of that normal outside the active ones, shape (V,), as are the following three.
        part: Coefficients of that normal in the active ones.
        coefficient: Coefficients of that normal in the basis.
        multiplier: Multipliers of the active normals.
        normals: Active normals, shape (V, V), one per row.
        basis: Orthonormal basis of the active normals, shape (V, V), one vector per row.
        upper: Coefficients of the active normals in the basis, shape (V, V), one normal per column.
    """

    normal: FloatArray
    step: FloatArray
    part: FloatArray
    coefficient: FloatArray
    multiplier: FloatArray
    normals: FloatArray
    basis: FloatArray
    upper: FloatArray


@njit(error_model="numpy")
def qp_workspace(variables: int) -> QPWorkspace:
    """Return the arrays for problems with the given number of variables."""
    return QPWorkspace(
        np.empty(variables), np.empty(variables), np.empty(variables), np.empty(variables), np.empty(variables),
        np.empty((variables, variables)), np.empty((variables, variables)), np.empty((variables, variables)),
    )  # fmt: skip


@njit(**BORROWING)
def _product(a: FloatArray, b: FloatArray) -> float:
    total = 0.0
    for k in range(a.shape[0]):
        total += a[k] * b[k]
    return total


@njit(**BORROWING)
def _take_out(p: QPWorkspace, i: int) -> float:
    """Remove from the step its part along a vector of the basis; return the size of that part."""
    total = _product(p.basis[i], p.step)
    for k in range(p.step.shape[0]):
        p.step[k] -= total * p.basis[i, k]
    return total


@njit(**BORROWING)
def _extend(p: QPWorkspace, i: int, square: float) -> None:
    """Write the direction of the step, whose squared length is given, as a vector of the basis."""
    length = math.sqrt(square)
    p.upper[i, i] = length
    for k in range(p.step.shape[0]):
        p.basis[i, k] = p.step[k] / length


@njit(**BORROWING)
def _split(p: QPWorkspace, active: int) -> float:
    """Write the part of the normal outside the active ones, and its coefficients; return the square of that part."""
    for k in range(p.normal.shape[0]):
        p.step[k] = p.normal[k]
    p.coefficient[:active] = 0.0
    for _ in range(2):  # Two passes are enough for orthogonality up to rounding.
        for j in range(active):
            p.coefficient[j] += _take_out(p, j)
    for j in range(active - 1, -1, -1):
        total = p.coefficient[j]
        for k in range(j + 1, active):
            total -= p.upper[j, k] * p.part[k]
        p.part[j] = total / p.upper[j, j]
    return _product(p.step, p.step)


@njit(**BORROWING)
def _append(p: QPWorkspace, active: int, square: float) -> None:
    """Make the normal active, after `_split`."""
    for k in range(p.normal.shape[0]):
        p.normals[active, k] = p.normal[k]
    for j in range(active):
        p.upper[j, active] = p.coefficient[j]
    _extend(p, active, square)


@njit(**BORROWING)
def _remove(p: QPWorkspace, active: int, which: int) -> None:
    """Drop an active normal and rebuild the basis; the normal that is being added is not changed."""
    size = p.normal.shape[0]
    for j in range(which, active - 1):
        p.multiplier[j] = p.multiplier[j + 1]
        for k in range(size):
            p.normals[j, k] = p.normals[j + 1, k]
    for j in range(which, active - 1):
        for k in range(size):
            p.step[k] = p.normals[j, k]
        for i in range(j):
            p.upper[i, j] = _take_out(p, i)
        _extend(p, j, _product(p.step, p.step))


@njit(**BORROWING)
def nearest_joint(
    rows: FloatArray, bounds: FloatArray, count: int, limit: float, target: FloatArray, out: FloatArray, p: QPWorkspace
) -> bool:  # fmt: skip
    """Write the point nearest to `target` with rows . out >= bounds and |out_k| <= limit.

    Args:
        rows: Unit normals, shape (K, V).
        bounds: Right-hand sides, shape (K,).
        count: Number of half-spaces to use.
        limit: Bound of each component.
        target: The target point, shape (V,).
        out: Receives the point, shape (V,).
        p: Workspace.

    Returns:
        False if there is no such point; `out` then has no meaning.
    """
    size = target.shape[0]
    for k in range(size):
        out[k] = target[k]
    active = 0
    for _ in range(_STEPS * size):
        short, pick = -_TOLERANCE, -1
        for k in range(size):
            spare = limit - abs(out[k])
            if spare < short:
                short, pick = spare, 2 * k + (1 if out[k] > 0.0 else 0)
        for i in range(count):
            spare = -bounds[i]
            for k in range(size):
                spare += rows[i, k] * out[k]
            if spare < short:
                short, pick = spare, 2 * size + i
        if pick < 0:
            for k in range(size):
                out[k] = min(max(out[k], -limit), limit)
            return True
        for k in range(size):
            p.normal[k] = rows[pick - 2 * size, k] if pick >= 2 * size else 0.0
        if pick < 2 * size:
            p.normal[pick // 2] = 1.0 - 2.0 * (pick % 2)
        gained = 0.0
        while True:
            square = _split(p, active)
            full = -short / square if square > _DEPENDENT else np.inf
            partial, drop = np.inf, -1
            for j in range(active):
                if p.part[j] > 1e-12 and p.multiplier[j] / p.part[j] < partial:
                    partial, drop = p.multiplier[j] / p.part[j], j
            length = min(full, partial)
            if length == np.inf:
                return False
            if full < np.inf:
                for k in range(size):
                    out[k] += length * p.step[k]
                short += length * square
            for j in range(active):
                p.multiplier[j] -= length * p.part[j]
            gained += length
            if full <= partial:
                _append(p, active, square)
                p.multiplier[active] = gained
                active += 1
                break
            _remove(p, active, drop)
            active -= 1
    return False
