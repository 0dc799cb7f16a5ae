"""The Clohessy-Wiltshire equations as matrices."""

from __future__ import annotations

import numpy as np


def system_matrices(n: float, mass: float) -> tuple[np.ndarray, np.ndarray]:
    """Return A (6, 6) and B (6, 3) of ``d(state)/dt = A state + B thrust`` at the mean motion n, SI."""
    a, b = np.zeros((6, 6)), np.zeros((6, 3))
    a[:3, 3:], b[3:] = np.eye(3), np.eye(3) / mass
    a[3, 0], a[3, 4], a[4, 3], a[5, 2] = 3.0 * n * n, 2.0 * n, -2.0 * n, -n * n
    return a, b
