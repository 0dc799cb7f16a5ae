"""The linear-quadratic regulator of deviations, on the map of one hold."""

from __future__ import annotations

import numpy as np

from safe_inspect.dynamics.cwh import transition
from safe_inspect.rta.constraints.parameters import ConstraintParameters
from safe_inspect.types import FloatArray


def regulator(p: ConstraintParameters, position_weight: float, velocity_weight: float) -> FloatArray:
    """Return the gain K of u = -K e that minimises the sum of e'Qe + u'u over steps of one hold, shape (3, 6)."""
    from scipy.linalg import solve_discrete_are

    phi, gamma = transition(float(p.n), float(p.m), float(p.step_size))
    weights = np.diag([position_weight] * 3 + [velocity_weight] * 3)
    cost = solve_discrete_are(phi, gamma, weights, np.eye(3))
    gain = np.linalg.solve(np.eye(3) + gamma.T @ cost @ gamma, gamma.T @ cost @ phi)
    return np.asarray(gain, dtype=np.float64)
