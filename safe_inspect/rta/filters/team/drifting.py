"""Certificate that two coasting deputies stay apart, even if the motion of one relative to the other drifts, compiled.

The relative motion is a centre that moves along y at a constant rate, plus an oscillation o with the orbit's period. In
the angle tau = n t of the orbit, its second derivative is -o, and every derivative of o is at most
rho = sqrt(4 A^2 + B^2) long, where A and B are the amplitudes in x and z. A cell of the path is therefore certified by
its ends as in `constraints.rows`, and the speed, at most |drift| + rho, bounds how soon the deputies can be near each
other. When the centre has passed the other deputy by more than the amplitude of the motion along y, the two stay apart
permanently.
"""

from __future__ import annotations

import math

from safe_inspect.compiling import BORROWING, njit
from safe_inspect.dynamics.coasting import coasting_position
from safe_inspect.dynamics.cwh import RowState
from safe_inspect.rta.constraints.rows import lowest

#: Number of orbits for which a pair is certified that neither drifts away nor is without drift.
ORBITS = 4
_CELL = math.pi / 8.0
_FINEST = _CELL / 2.0**16


@njit(**BORROWING)
def apart(n: float, x: RowState, reach: float) -> bool:
    """Return whether the range of a coasting relative motion stays at least `reach`; see `ORBITS` for the duration.

    Args:
        n: Mean motion [rad/s].
        x: The initial relative state.
        reach: Least range [m].
    """
    u, v, w = x[3] / n, x[4] / n, x[5] / n
    level, offset = 4.0 * x[0] + 2.0 * v, 3.0 * x[0] + 2.0 * v
    amplitude, across = math.sqrt(offset * offset + u * u), math.sqrt(x[2] * x[2] + w * w)
    centre, drift = x[1] - 2.0 * u, -1.5 * level
    rho = math.sqrt(4.0 * amplitude * amplitude + across * across)
    fastest = abs(drift) + rho
    a, angle, span = (x[0], x[1], x[2]), 0.0, _CELL
    while True:
        r = math.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])
        if r < reach:
            return False
        middle = centre + drift * angle
        if abs(level) - amplitude >= reach or (middle * drift >= 0.0 and abs(middle) - 2.0 * amplitude >= reach):
            return True
        if angle > ORBITS * 2.0 * math.pi or not fastest > 0.0:
            return True
        clear = (r - reach) / fastest
        if clear >= span:
            angle += clear
            a = coasting_position(n, x, angle, math.cos(angle), math.sin(angle))
            continue
        while True:
            end = angle + span
            b = coasting_position(n, x, end, math.cos(end), math.sin(end))
            ex, ey, ez = a[0] + b[0], a[1] + b[1], a[2] + b[2]
            size = math.sqrt(ex * ex + ey * ey + ez * ez)
            if size <= 0.0:
                return False
            ex, ey, ez = ex / size, ey / size, ez / size
            fa, fb = ex * a[0] + ey * a[1] + ez * a[2], ex * b[0] + ey * b[1] + ez * b[2]
            k = 0.125 * span * span
            bend = max(ex * level + ey * middle - fa, ex * level + ey * (centre + drift * end) - fb)
            if lowest(fa, fb, max(0.0, k * bend + k * k * rho)) >= reach:
                break
            if span <= _FINEST or b[0] * b[0] + b[1] * b[1] + b[2] * b[2] < reach * reach:
                return False
            span *= 0.5
        a, angle, span = b, end, min(2.0 * span, _CELL)
