"""The linear-quadratic regulator of deviations, on the map of one hold."""

from __future__ import annotations

import numpy as np

from safe_inspect.dynamics.cwh import regulator_gain, transition
from safe_inspect.rta.constraints.parameters import ConstraintParameters
from safe_inspect.types import FloatArray


def regulator(p: ConstraintParameters, position_weight: float, velocity_weight: float) -> FloatArray:
    """Return the gain K of u = -K e that minimises the sum of e'Qe + u'u over steps of one hold, shape (3, 6)."""
    phi, gamma = transition(float(p.n), float(p.m), float(p.step_size))
    weights = np.diag([position_weight] * 3 + [velocity_weight] * 3)
    return regulator_gain(phi, gamma, weights, np.eye(3))
