"""Models and workspace of the compiled rows of the team's filter."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from safe_inspect.compiling import njit
from safe_inspect.rta.active_set import QPWorkspace, qp_workspace
from safe_inspect.rta.backup.model import PLANS, FilterModel
from safe_inspect.types import AnyArray, BoolArray, FloatArray, IntArray

#: Most half-spaces of a quadratic programme, for each deputy and for each pair.
_ROWS, _PAIR_ROWS = 32, 16


class TeamModel(NamedTuple):
    """Numbers and tables of a team's task.

    Attributes:
        one: Task of each deputy relative to the chief.
        pair: Task of a deputy relative to another: only range and passive safety, with twice the deputies' radius.
        pairs: Whether deputies are kept apart at all.
    """

    one: FilterModel
    pair: FilterModel
    pairs: bool


class TeamWorkspace(NamedTuple):
    """Workspace for one environment of D deputies in the order of the filter, where V = 3 D and P = D (D - 1) / 2.

    Attributes:
        order: Indices of the deputies in the environment, shape (D,).
        fixed: Deputies that coast unconditionally, shape (D,).
        effort: Size of each deputy's thrust in the hold, `NO_HOLD` if the plans begin now, shape (D,).
        x: States before the hold, shape (D, 6).
        after: States at the end of the hold, shape (D, 6).
        desired: Desired thrusts, shape (V,), as are control (the last proposal), backup, trial and best.
        hint: Plans to try first, or NO_PLAN, shape (D,).
        plan: The joint plan that was found, shape (D,).
        kept: The joint plan of `best`, shape (D,).
        line: The order in which plans are chosen, shape (D,).
        known: Status of each plan of a deputy alone: 0 unknown, 1 safe, 2 not safe, shape (D, PLANS).
        met: Status of two plans of a pair: 0 unknown, 1 apart, 2 not apart, int8, shape (P, PLANS, PLANS).
        thrust: Thrusts of the plans, shape (D, PLANS, 3).
        end: States after the holds of the plans, shape (D, PLANS, 6).
        first: The deputy of each hold that is tested: those of the deputies, then of the pairs 0-1, 0-2, ..., (D + P,).
        second: The other deputy of the pair, or -1, shape (D + P,).
        code: Constraint that rejected each hold, or SAFE, shape (D + P,).
        at: Where it did, shape (D + P,).
        bits: Bits of the constraints that rejected the desired thrust, shape (D,).
        u: Thrust of one deputy, shape (3,).
        rows: Unit normals of the half-spaces of the quadratic programme, shape (K, V).
        bounds: Right-hand sides, shape (K,).
        qp: Workspace of the quadratic programme.
    """

    order: IntArray
    fixed: BoolArray
    effort: FloatArray
    x: FloatArray
    after: FloatArray
    desired: FloatArray
    control: FloatArray
    backup: FloatArray
    trial: FloatArray
    best: FloatArray
    hint: IntArray
    plan: IntArray
    kept: IntArray
    line: IntArray
    known: IntArray
    met: AnyArray
    thrust: FloatArray
    end: FloatArray
    first: IntArray
    second: IntArray
    code: IntArray
    at: IntArray
    bits: IntArray
    u: FloatArray
    rows: FloatArray
    bounds: FloatArray
    qp: QPWorkspace


@njit(error_model="numpy")
def team_workspace(deputies: int) -> TeamWorkspace:
    """Return a workspace for environments with the given number of deputies."""
    d, v, p = deputies, 3 * deputies, deputies * (deputies - 1) // 2
    most = _ROWS * d + _PAIR_ROWS * p
    first, second = np.arange(d + p), np.full(d + p, -1)
    k = d
    for i in range(d):
        for j in range(i + 1, d):
            first[k], second[k] = i, j
            k += 1
    return TeamWorkspace(
        np.zeros(d, np.int64), np.zeros(d, np.bool_), np.zeros(d), np.zeros((d, 6)), np.zeros((d, 6)),
        np.zeros(v), np.zeros(v), np.zeros(v), np.zeros(v), np.zeros(v),
        np.zeros(d, np.int64), np.zeros(d, np.int64), np.zeros(d, np.int64), np.zeros(d, np.int64),
        np.zeros((d, PLANS), np.int64), np.zeros((p, PLANS, PLANS), np.int8),
        np.zeros((d, PLANS, 3)), np.zeros((d, PLANS, 6)),
        first, second, np.zeros(d + p, np.int64), np.zeros(d + p, np.int64),
        np.zeros(d, np.int64), np.zeros(3), np.zeros((most, v)), np.zeros(most), qp_workspace(v),
    )  # fmt: skip
