"""Arcs under constant thrust, and the bounds with which their cells are certified, compiled; see `constraints.rows`.

The derivatives satisfy the Clohessy-Wiltshire equations: if S is a bound on |v| + |a| / n over the cell, the jerk is at
most 3 n^2 S and the fourth derivative of the position at most 6 n^3 S. For k = (n D)^2 / 8, the values at the ends
bound S by (largest |v| + largest |a| / n) / (1 - 9 k).
"""

from __future__ import annotations

import math

from safe_inspect.compiling import BORROWING, njit
from safe_inspect.dynamics.cwh import RowState, cwh_row
from safe_inspect.rta.constraints.rows import INLINED, ArcCell, Node, SunAngle, Triple
from safe_inspect.rta.filters.backup.model import FilterModel
from safe_inspect.types import FloatArray


@njit(**BORROWING)
def held(m: FilterModel, x: RowState, u: FloatArray, k: int) -> RowState:
    """Return the state k / 256 of a hold after x, under the thrust u; at k = 256 bit-identical to the simulator's."""
    return cwh_row(m.hold_phi[k], m.hold_gamma[k], x, u[0], u[1], u[2])


@njit(**BORROWING)
def turned(sun: SunAngle, cos: float, sin: float) -> SunAngle:
    """Return the cosine and sine of the sun angle after a rotation."""
    return sun[0] * cos - sun[1] * sin, sun[1] * cos + sun[0] * sin


@njit(**BORROWING)
def acceleration_at(n: float, x: RowState, w: Triple) -> Triple:
    """Return the acceleration at a state, including the acceleration w of the thrust [m/s^2]."""
    return 3.0 * n * n * x[0] + 2.0 * n * x[4] + w[0], w[1] - 2.0 * n * x[3], w[2] - n * n * x[2]


@njit(**INLINED)
def arc_cell(n: float, a: Node, b: Node, w: Triple, span: float) -> ArcCell:
    """Return a cell with the bounds that its ends give.

    Args:
        n: Mean motion [rad/s].
        a: Start of the cell.
        b: End of the cell.
        w: Constant acceleration of the thrust [m/s^2].
        span: Length of the cell [s].
    """
    ax, ay, az = acceleration_at(n, a.state, w)
    bx, by, bz = acceleration_at(n, b.state, w)
    acceleration = math.sqrt(max(ax * ax + ay * ay + az * az, bx * bx + by * by + bz * bz))
    eighth = 0.125 * span * span
    k = n * n * eighth
    reach = (max(a.speed, b.speed) + acceleration / n) / (1.0 - 9.0 * k)
    bend = eighth * acceleration + 6.0 * k * k * reach / n
    p, q = a.state, b.state
    ex, ey, ez = p[0] + q[0], p[1] + q[1], p[2] + q[2]
    size = math.sqrt(ex * ex + ey * ey + ez * ez)
    ex, ey, ez = ex / size, ey / size, ez / size
    curve = max(ex * ax + ey * ay + ez * az, ex * bx + ey * by + ez * bz)
    return ArcCell(
        a, b, (ax, ay, az), (bx, by, bz), eighth, k, reach, bend, 3.0 * k * reach, max(a.range, b.range) + bend, size,
        ex * p[0] + ey * p[1] + ez * p[2], ex * q[0] + ey * q[1] + ez * q[2],
        max(0.0, eighth * curve + 6.0 * k * k * reach / n),
    )  # fmt: skip
