"""The linear-quadratic regulator of a discrete linear system."""

from __future__ import annotations

import numpy as np

from safe_inspect.types import FloatArray


def regulator(phi: FloatArray, gamma: FloatArray, state_weights: FloatArray, control_weights: FloatArray) -> FloatArray:
    """Return the gain K of ``u = -K x`` that minimises the sum of ``x'Qx + u'Ru`` along ``x' = phi x + gamma u``.

    With the solution P of the discrete algebraic Riccati equation, ``K = (R + gamma' P gamma)^-1 gamma' P phi``.

    Args:
        phi: Map of the state over one step, shape (n, n).
        gamma: Effect of the control, shape (n, m).
        state_weights: Q, shape (n, n).
        control_weights: R, shape (m, m).

    Returns:
        K, shape (m, n).
    """
    from scipy.linalg import solve_discrete_are

    cost = solve_discrete_are(phi, gamma, state_weights, control_weights)
    gain = np.linalg.solve(control_weights + gamma.T @ cost @ gamma, gamma.T @ cost @ phi)
    return np.asarray(gain, dtype=np.float64)
