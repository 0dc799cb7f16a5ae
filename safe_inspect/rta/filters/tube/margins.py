"""Margins that a tube adds to those of the constraints, compiled; they are in `FilterModel.tube`."""

from __future__ import annotations

from safe_inspect.compiling import njit
from safe_inspect.rta.constraints.rows import INLINED, Margins
from safe_inspect.rta.filters.backup.model import FilterModel

_LENGTH, _SPEED, _COASTING, _THRUST = range(4)


@njit(**INLINED)
def _width(m: FilterModel, part: int, which: int, effort: float, thrust: float) -> float:
    return float(m.tube[part, which, 0] + max(effort, 0.0) * m.tube[part, which, 1] + thrust * m.tube[part, which, 2])


@njit(**INLINED)
def widened(m: FilterModel, margins: Margins, part: int, effort: float, thrust: float) -> Margins:
    """Return the margins for the motion of the model that leave `margins` for the real motion.

    Args:
        m: The task.
        margins: Margins of the constraints.
        part: The part of the motion, such as `HOLD`.
        effort: Size of the thrust that is held before the plan, or now [N]; negative if there is none.
        thrust: Size of the thrust of the plan [N].
    """
    return Margins(
        margins.length + _width(m, part, _LENGTH, effort, thrust),
        margins.speed + _width(m, part, _SPEED, effort, thrust),
        margins.coasting + _width(m, part, _COASTING, effort, thrust),
    )


@njit(**INLINED)
def tracking_thrust(m: FilterModel, part: int, effort: float) -> float:
    """Return the largest component by which tracking a plan changes its thrust [N]."""
    return _width(m, part, _THRUST, effort, 0.0)
