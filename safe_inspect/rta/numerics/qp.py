"""Quadratic programme of the filters: the admissible control nearest to the desired one."""

from __future__ import annotations

import importlib
from dataclasses import dataclass

import numpy as np

from safe_inspect.types import BoolArray, FloatArray


@dataclass(frozen=True, eq=False)
class QPSolution:
    """Solutions of `solve_qp` for R problems.

    Attributes:
        control: The control, shape (R, 3).
        feasible: True where every row is satisfied, shape (R,).
        violated: The rows that the control violates, shape (R, M); all False where feasible.
    """

    control: FloatArray
    feasible: BoolArray
    violated: BoolArray


def solve_qp(desired: FloatArray, rows: FloatArray, bounds: FloatArray, limit: float) -> QPSolution:
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

    Raises:
        ValueError: The shapes do not match, the limit is not positive, or a number is not finite; the message names the
            first such problem of the batch.
    """
    desired, rows, bounds = (np.ascontiguousarray(array, dtype=np.float64) for array in (desired, rows, bounds))
    count = len(desired)
    if desired.shape != (count, 3) or rows.shape != (count, *rows.shape[1:2], 3) or bounds.shape != rows.shape[:2]:
        raise ValueError(
            f"the shapes of desired (R, 3), rows (R, M, 3) and bounds (R, M) do not match: "
            f"{desired.shape}, {rows.shape}, {bounds.shape}"
        )
    if not (np.isfinite(limit) and limit > 0.0):
        raise ValueError(f"the limit of the control must be positive and finite, got {limit}")
    finite = np.isfinite(desired).all(axis=1) & np.isfinite(rows).all(axis=(1, 2)) & np.isfinite(bounds).all(axis=1)
    if not finite.all():
        raise ValueError(f"row {int(np.argmin(finite))} of the programme contains a number that is not finite")
    solution = QPSolution(np.zeros((count, 3)), np.zeros(count, np.bool_), np.zeros(bounds.shape, np.bool_))
    kernel = importlib.import_module("safe_inspect.rta.numerics.projection")
    kernel.solve_rows(desired, rows, bounds, float(limit), solution.control, solution.violated, solution.feasible)
    return solution
