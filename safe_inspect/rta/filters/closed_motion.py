"""Is a closed natural motion safe for ever? One orbit decides, for the motion and the sun have the same period."""

from __future__ import annotations

import math

from numba import njit

from safe_inspect.rta.filters.arcs import SAFE, State, broken_at, closed, turned, uncertain
from safe_inspect.rta.filters.model import ORBIT_CELLS, Model
from safe_inspect.types import FloatArray

#: Cells of an orbit after the last halving; what they leave uncertain is far less than the margins.
FINEST = ORBIT_CELLS * 2**10


@njit(cache=True)  # type: ignore[misc,untyped-decorator]
def closed_motion(
    m: Model, x: State, sun: tuple[float, float], length: float, speed: float, work: FloatArray
) -> int:  # fmt: skip
    """Return a constraint that the drift-free motion from x breaks within an orbit, or SAFE.

    Args:
        m: The task.
        x: The state at the beginning; its along-track speed is taken as -2 n x.
        sun: Cosine and sine of the sun angle there.
        length: Margin of the ranges and the sun cone [m].
        speed: Margin of the speeds [m/s].
        work: Room, shape (16, 9).
    """
    near = max(m.near, m.near_psm)
    for first in range(4):
        for node in range((0, 2, 1, 3)[first], ORBIT_CELLS, 4):
            cos, sin = m.orbit[node, 0], m.orbit[node, 1]
            code = broken_at(m, near, closed(m.n, x, cos, sin), turned(sun, cos, sin), length, speed)
            if code != SAFE:
                return code
    a, sun_a, rest = closed(m.n, x, 1.0, 0.0), sun, (0.0, 0.0, 0.0)
    time = 0  # in the finest cells
    for node in range(ORBIT_CELLS):
        end = (node + 1) * (FINEST // ORBIT_CELLS)
        cos, sin = m.orbit[node + 1, 0], m.orbit[node + 1, 1]
        b, sun_b = closed(m.n, x, cos, sin), turned(sun, cos, sin)
        top = 0
        while True:
            span = (end - time) * (2.0 * math.pi / FINEST)
            code = uncertain(m, near, a, b, sun_a, sun_b, rest, span / m.n, length, speed)
            if code == SAFE:
                a, sun_a, time = b, sun_b, end
                if top == 0:
                    break
                top -= 1
                end = int(work[top, 0])
                b = (work[top, 1], work[top, 2], work[top, 3], work[top, 4], work[top, 5], work[top, 6])
                sun_b = (work[top, 7], work[top, 8])
                continue
            if end - time <= 1:
                return code
            work[top, 0] = end
            for j in range(6):
                work[top, 1 + j] = b[j]
            work[top, 7], work[top, 8] = sun_b
            top += 1
            end = time + (end - time) // 2
            angle = end * (2.0 * math.pi / FINEST)
            cos, sin = math.cos(angle), math.sin(angle)
            b, sun_b = closed(m.n, x, cos, sin), turned(sun, cos, sin)
            code = broken_at(m, near, b, sun_b, length, speed)
            if code != SAFE:
                return code
    return SAFE
