"""Certificate that a closed natural motion is safe permanently: one orbit is enough, as the sun has the same period.

Without drift, v_y = -2 n x, the position is a constant (0, y_c, 0) plus an oscillation o with the orbit's period, and
every derivative with respect to the angle tau = n t of the orbit is at most rho = sqrt(4 A^2 + B^2) long, where A and B
are the amplitudes in x and z. The orbit is divided into cells of angle D, which are certified from their ends or
halved, with the bounds of `constraints.rows`; they are sharper here, because p'' = -o and |p''''| <= rho.

The cells start at the given state, so they are different one step later. A motion that was certified with full margins
is nevertheless certified with half margins from each of its states: cells are halved until their error is less than
the difference, and motions for which the error of the finest cells would be larger are rejected, based on the centre
and rho, which are properties of the motion and not of its states.
"""

from __future__ import annotations

import math

from safe_inspect.compiling import BORROWING, njit
from safe_inspect.dynamics.cwh import RowState
from safe_inspect.rta.backup.half_spaces import further_closed_motion
from safe_inspect.rta.backup.holds import turned
from safe_inspect.rta.backup.model import FINE_NODES, FINEST, ORBIT_CELLS, FilterModel
from safe_inspect.rta.backup.sequences import SAFE, broken_at_closed, too_fast, uncertain_closed
from safe_inspect.rta.constraints.rows import INLINED, ClosedCell, Margins, Node, SunAngle, sun_axes
from safe_inspect.rta.constraints.sets import COLLISION
from safe_inspect.types import FloatArray, IntArray

#: One eighth of the squared angle of the finest cell [rad^2].
_EIGHTH = 0.5 * (math.pi / FINEST) ** 2
#: Largest error of a distance from the finest cells [m], with a quarter of the margin: half of the margin of a plan,
#: and more for a plan that is checked again with half margins.
_MOST_MISSED = 7.5e-4
#: Margin of a plan [m], if there is no tube about it.
_WHOLE = 1e-3
#: Columns of a node: angle in finest cells, position, cosine and sine of the sun angle, and the rest of a `Node`.
_COLUMNS = 10
#: Shape of the stack of nodes used by `closed_motion`.
NODE_STACK = (ORBIT_CELLS + 2 + round(math.log2(FINEST // ORBIT_CELLS)), _COLUMNS)


@njit(**INLINED)
def _node(n: float, x: RowState, sun: SunAngle, cos: float, sin: float) -> Node:
    """Return the node at the angle with the given cosine and sine."""
    u, w = x[3] / n, x[5] / n
    px, pz = cos * x[0] + sin * u, cos * x[2] + sin * w
    py = x[1] - 2.0 * (1.0 - cos) * u - 2.0 * sin * x[0]
    vx, vz = cos * u - sin * x[0], cos * w - sin * x[2]
    later = turned(sun, cos, sin)
    along, across = sun_axes(later, px, py)
    return Node(
        (px, py, pz), later, math.sqrt(px * px + py * py + pz * pz),
        n * math.sqrt(vx * vx + 4.0 * px * px + vz * vz), along, across,
    )  # fmt: skip


@njit(**INLINED)
def _store(work: FloatArray, i: int, at: Node) -> None:
    work[i, 1], work[i, 2], work[i, 3] = at.state
    work[i, 4], work[i, 5] = at.sun
    work[i, 6], work[i, 7], work[i, 8], work[i, 9] = at.range, at.speed, at.along, at.across


@njit(**INLINED)
def _stored(work: FloatArray, i: int) -> Node:
    return Node(
        (work[i, 1], work[i, 2], work[i, 3]), (work[i, 4], work[i, 5]), work[i, 6], work[i, 7], work[i, 8], work[i, 9]
    )  # fmt: skip


@njit(**INLINED)
def _copy(work: FloatArray, source: int, target: int) -> None:
    for column in range(_COLUMNS):
        work[target, column] = work[source, column]


@njit(**INLINED)
def _cell(n: float, a: Node, b: Node, centre: float, rho: float, span: float) -> ClosedCell:
    """Return the cell of the given angle between two nodes, with the bounds that they give."""
    k = 0.125 * span * span
    p, q = a.state, b.state
    ex, ey, ez = p[0] + q[0], p[1] + q[1], p[2] + q[2]
    size = math.sqrt(ex * ex + ey * ey + ez * ez)
    scale = 1.0 / size
    ex, ey, ez = ex * scale, ey * scale, ez * scale
    fa, fb = ex * p[0] + ey * p[1] + ez * p[2], ex * q[0] + ey * q[1] + ez * q[2]
    return ClosedCell(
        a, b, k, centre, rho, k * rho, n * k * rho, max(a.range, b.range) + k * rho, size, fa, fb,
        max(0.0, k * (ey * centre - min(fa, fb)) + k * k * rho),
    )  # fmt: skip


@njit(**INLINED)
def _remember(weak: IntArray, angle: int) -> None:
    """Store the node nearest to an angle, in finest cells, before the last one that was stored."""
    nearest = (angle + FINEST // FINE_NODES // 2) // (FINEST // FINE_NODES) % FINE_NODES
    if nearest != weak[0]:
        weak[0], weak[1] = nearest, weak[0]


@njit(**INLINED)
def refuted(m: FilterModel, x: RowState, sun: SunAngle, margins: Margins, weak: IntArray) -> bool:
    """Return whether the drift-free motion from x violates a constraint at one of two of the `FINE_NODES`.

    If similar motions were rejected, this is a fast test to run before `closed_motion`.
    """
    for place in weak:
        node = _node(m.n, x, sun, m.fine[place, 0], m.fine[place, 1])
        if broken_at_closed(m.constraints, node, margins) != SAFE:
            return True
    return False


@njit(**BORROWING)
def closed_motion(
    m: FilterModel, x: RowState, sun: SunAngle, margins: Margins, work: FloatArray, weak: IntArray
) -> int:  # fmt: skip
    """Return a constraint that the drift-free motion from x violates within an orbit, or SAFE.

    Args:
        m: The task.
        x: The initial state; its along-track speed is taken as -2 n x.
        sun: Cosine and sine of the sun angle there.
        margins: Margins of the constraints.
        work: Workspace, shape `NODE_STACK`.
        weak: Receives the index of the `FINE_NODES` nearest to the rejection, for `refuted`, shape (2,).
    """
    u, w = x[3] / m.n, x[5] / m.n
    in_plane, across = math.sqrt(x[0] * x[0] + u * u), math.sqrt(x[2] * x[2] + w * w)
    code = too_fast(m.constraints, (m.n * in_plane, 2.0 * m.n * in_plane, m.n * across), margins)
    if code != SAFE:
        return int(code)
    centre, rho = x[1] - 2.0 * u, math.sqrt(4.0 * in_plane * in_plane + across * across)
    size = abs(centre) + rho
    # The first part is the error of the chord's direction at the ends of a cell, the second that of the bound between.
    if _EIGHTH * size * (size * m.turning + 4.0) > _MOST_MISSED - 0.25 * min(margins.length, _WHOLE):
        return COLLISION
    for first in range(4):
        for place in range((0, 2, 1, 3)[first], ORBIT_CELLS, 4):
            node = _node(m.n, x, sun, m.orbit[place, 0], m.orbit[place, 1])
            code = broken_at_closed(m.constraints, node, margins)
            if code != SAFE:
                _remember(weak, place * (FINEST // ORBIT_CELLS))
                return int(code)
            _store(work, place, node)
    _copy(work, 0, ORBIT_CELLS)
    for place in range(ORBIT_CELLS):
        a, b, top = place, place + 1, ORBIT_CELLS
        work[a, 0], work[b, 0] = place * (FINEST // ORBIT_CELLS), (place + 1) * (FINEST // ORBIT_CELLS)
        while True:
            cells = work[b, 0] - work[a, 0]
            cell = _cell(m.n, _stored(work, a), _stored(work, b), centre, rho, cells * (2.0 * math.pi / FINEST))
            code = uncertain_closed(m.constraints, cell, margins)
            if code == SAFE:
                if b == place + 1:
                    break
                # The right end of this cell is the left end of the next, whose right end is the next on the stack.
                _copy(work, b, place)
                a, top = place, top - 1
                b = top if top > ORBIT_CELLS else place + 1
                continue
            if cells <= 1.0:
                return int(code)
            top += 1
            middle = math.floor(0.5 * (work[a, 0] + work[b, 0]))
            angle = middle * (2.0 * math.pi / FINEST)
            node = _node(m.n, x, sun, math.cos(angle), math.sin(angle))
            code = broken_at_closed(m.constraints, node, margins)
            if code != SAFE:
                _remember(weak, middle)
                return int(code)
            _store(work, top, node)
            work[top, 0], b = middle, top
    return int(further_closed_motion(m, x, margins)) if m.further else SAFE
