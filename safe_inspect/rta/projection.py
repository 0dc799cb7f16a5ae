"""Nearest point of a polyhedron in three dimensions, compiled, one row at a time.

Seidel's incremental method adds half-spaces one by one. If the best point so far violates one, the new best point is on
its plane, which is the same problem in two dimensions, and there in one (Seidel, "Small-dimensional linear programming
and convex hulls made easy", Discrete & Computational Geometry 6, 1991). It is exact, needs no initial point, and
detects an empty polyhedron by the empty interval of the last line.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from safe_inspect.compiling import BORROWING, njit
from safe_inspect.types import BoolArray, FloatArray

#: A half-space counts as satisfied within this distance.
_TOLERANCE = 1e-11
#: Planes whose unit normals differ by less than this are parallel.
PARALLEL = 1e-10
#: A row shorter than this does not depend on the control.
SHORTEST = 1e-12
_HALVINGS = 60


class ProjectionWorkspace(NamedTuple):
    """Arrays overwritten by `nearest`: normals (M + 6, 3), offsets (M + 6,), lengths of the rows (M,), a point."""

    a: FloatArray
    c: FloatArray
    size: FloatArray
    point: FloatArray


@njit(error_model="numpy")
def projection_workspace(most: int) -> ProjectionWorkspace:
    """Return a workspace for up to `most` half-spaces in addition to the box."""
    return ProjectionWorkspace(np.empty((most + 6, 3)), np.empty(most + 6), np.empty(most), np.empty(3))


@njit(**BORROWING)
def _on_line(a: FloatArray, c: FloatArray, i: int, j: int, target: FloatArray, out: FloatArray) -> bool:
    """Minimise the distance to `target`, a point of plane i, on the line of planes i and j, within rows before j."""
    dot = a[j, 0] * a[i, 0] + a[j, 1] * a[i, 1] + a[j, 2] * a[i, 2]
    px, py, pz = a[j, 0] - dot * a[i, 0], a[j, 1] - dot * a[i, 1], a[j, 2] - dot * a[i, 2]
    length = math.sqrt(px * px + py * py + pz * pz)
    short = c[j] - (a[j, 0] * target[0] + a[j, 1] * target[1] + a[j, 2] * target[2])
    if length < PARALLEL:
        return False
    px, py, pz = px / length, py / length, pz / length
    shift = short / length
    ox, oy, oz = target[0] + shift * px, target[1] + shift * py, target[2] + shift * pz
    dx, dy, dz = a[i, 1] * pz - a[i, 2] * py, a[i, 2] * px - a[i, 0] * pz, a[i, 0] * py - a[i, 1] * px
    low, high = -np.inf, np.inf
    for k in range(j):
        slope = a[k, 0] * dx + a[k, 1] * dy + a[k, 2] * dz
        spare = a[k, 0] * ox + a[k, 1] * oy + a[k, 2] * oz - c[k]
        if abs(slope) < PARALLEL:
            if spare < -_TOLERANCE:
                return False
        elif slope > 0.0:
            low = max(low, -spare / slope)
        else:
            high = min(high, -spare / slope)
    if low > high + _TOLERANCE:
        return False
    step = min(max(0.0, low), high)
    out[0], out[1], out[2] = ox + step * dx, oy + step * dy, oz + step * dz
    return True


@njit(**BORROWING)
def _on_plane(a: FloatArray, c: FloatArray, i: int, target: FloatArray, out: FloatArray, work: FloatArray) -> bool:
    """Minimise the distance to `target` on plane i, subject to the rows before it."""
    short = c[i] - (a[i, 0] * target[0] + a[i, 1] * target[1] + a[i, 2] * target[2])
    for axis in range(3):
        work[axis] = target[axis] + short * a[i, axis]
        out[axis] = work[axis]
    for j in range(i):
        if a[j, 0] * out[0] + a[j, 1] * out[1] + a[j, 2] * out[2] < c[j] - _TOLERANCE and not _on_line(
            a, c, i, j, work, out
        ):
            return False
    return True


@njit(**BORROWING)
def project(a: FloatArray, c: FloatArray, rows: int, target: FloatArray, out: FloatArray, work: FloatArray) -> bool:
    """Write the point nearest to `target` with a u >= c; return False, with no meaning in `out`, if there is none.

    Args:
        a: Unit normals, shape (K, 3).
        c: Offsets, shape (K,).
        rows: Number of half-spaces to use.
        target: The target point, shape (3,).
        out: Receives the nearest point, shape (3,).
        work: Workspace, shape (3,).
    """
    out[0], out[1], out[2] = target[0], target[1], target[2]
    for i in range(rows):
        if a[i, 0] * out[0] + a[i, 1] * out[1] + a[i, 2] * out[2] < c[i] - _TOLERANCE and not _on_plane(
            a, c, i, target, out, work
        ):
            return False
    return True


@njit(**BORROWING)
def _write_box(a: FloatArray, c: FloatArray, limit: float) -> None:
    """Write |u_i| <= limit to the first six half-spaces."""
    for axis in range(3):
        for side in range(2):
            row = 2 * axis + side
            a[row, 0], a[row, 1], a[row, 2] = 0.0, 0.0, 0.0
            a[row, axis] = 1.0 - 2.0 * side
            c[row] = -limit


@njit(**BORROWING)
def nearest(
    rows: FloatArray, bounds: FloatArray, count: int, limit: float, target: FloatArray, settle: bool,
    out: FloatArray, p: ProjectionWorkspace,
) -> bool:  # fmt: skip
    """Write the control nearest to `target` with rows u >= bounds in the box, or the least-violating one.

    Args:
        rows: Normals, of any length, shape (M, 3).
        bounds: Right-hand sides, shape (M,).
        count: Number of half-spaces to use.
        limit: Bound of each component.
        target: The desired control, shape (3,).
        settle: If not all rows can be satisfied, True: find the least-violating control; False: `out` has no meaning.
        out: Receives the control, shape (3,).
        p: Workspace.

    Returns:
        True if all rows can be satisfied.
    """
    a, c, size = p.a, p.c, p.size
    _write_box(a, c, limit)
    used, met = 6, True
    for i in range(count):
        length = math.sqrt(rows[i, 0] ** 2 + rows[i, 1] ** 2 + rows[i, 2] ** 2)
        if length < SHORTEST:
            met = met and not bounds[i] > _TOLERANCE
            continue
        a[used, 0], a[used, 1], a[used, 2] = rows[i, 0] / length, rows[i, 1] / length, rows[i, 2] / length
        c[used] = bounds[i] / length
        size[used - 6] = length
        used += 1
    if not project(a, c, used, target, out, p.point):
        met = False
        if not settle:
            return False
        _least_violating(used, limit, target, out, p)
    for axis in range(3):
        out[axis] = min(max(out[axis], -limit), limit)
    return met


@njit(**BORROWING)
def _least_violating(
    used: int, limit: float, target: FloatArray, out: FloatArray, p: ProjectionWorkspace
) -> None:  # fmt: skip
    """Find by bisection the smallest violation that all rows allow, and then the control nearest to the target."""
    a, c, size, work = p.a, p.c, p.size, p.point
    high = 0.0
    for i in range(6, used):
        inside = 0.0
        for axis in range(3):
            inside += a[i, axis] * min(max(target[axis], -limit), limit)
        high = max(high, (c[i] - inside) * size[i - 6])
    low, done, span = 0.0, 0.0, high
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        for i in range(6, used):
            c[i] -= (middle - done) / size[i - 6]
        done = middle
        if project(a, c, used, target, out, work):
            high = middle
        else:
            low = middle
        if high - low <= 1e-13 * span:
            break
    for i in range(6, used):
        c[i] -= (high - done) / size[i - 6]
    project(a, c, used, target, out, work)


@njit(error_model="numpy")
def _solve_rows(
    desired: FloatArray, rows: FloatArray, bounds: FloatArray, limit: float, control: FloatArray, feasible: BoolArray
) -> None:
    """Solve one problem for each row of the batch; see `solve_qp`."""
    count = rows.shape[1]
    p = projection_workspace(count)
    for i in range(desired.shape[0]):
        feasible[i] = nearest(rows[i], bounds[i], count, limit, desired[i], True, control[i], p)


def solve_qp(
    desired: FloatArray, rows: FloatArray, bounds: FloatArray, limit: float
) -> tuple[FloatArray, BoolArray]:  # fmt: skip
    """Minimise |u - desired|^2 subject to rows . u >= bounds and |u_i| <= limit, for every problem of a batch.

    If no control satisfies every row, the result is the least-violating admissible control: among the controls of the
    box that minimise the largest violation max_j (bounds_j - rows_j . u), in the units of the given rows, it is the one
    nearest to the desired control. A row shorter than 1e-12 does not depend on the control: it is satisfied or violated
    whatever the control, and does not affect the result.

    The method is exact (Seidel's incremental projection); half-spaces are satisfied within 1e-11 of their distance. The
    result of a problem depends on that problem alone.

    Args:
        desired: Desired controls, shape (R, 3).
        rows: Normals of the half-spaces, shape (R, M, 3).
        bounds: Right-hand sides, shape (R, M).
        limit: Largest magnitude of each component of the control.

    Returns:
        The controls, shape (R, 3), and a mask of the problems in which every row is satisfied, shape (R,).

    Raises:
        ValueError: A number is not finite; the message names the first such problem of the batch.
    """
    finite = np.isfinite(desired).all(axis=1) & np.isfinite(rows).all(axis=(1, 2)) & np.isfinite(bounds).all(axis=1)
    if not finite.all():
        raise ValueError(f"row {int(np.argmin(finite))} of the programme contains a number that is not finite")
    control, feasible = np.zeros((len(desired), 3)), np.zeros(len(desired), np.bool_)
    _solve_rows(desired, rows, bounds, limit, control, feasible)
    return control, feasible
