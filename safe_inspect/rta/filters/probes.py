"""States from everywhere, to try a constraint with."""

from __future__ import annotations

import numpy as np

from safe_inspect.rta.constraints.base import Constraint, RelativeState
from safe_inspect.types import FloatArray

#: Smallest and largest range [m] and speed [m/s].
_RANGES, _SPEEDS = (1.0, 2000.0), (1e-3, 10.0)


def probe_states(rows: int = 512) -> RelativeState:
    """Return states in all directions, ranges from 1 m to 2 km and speeds from 1 mm/s to 10 m/s, always the same.

    Args:
        rows: Number of states, R.
    """
    generator = np.random.default_rng(11)

    def vectors(low: float, high: float) -> FloatArray:
        direction = generator.normal(size=(rows, 3))
        length = np.exp(generator.uniform(np.log(low), np.log(high), (rows, 1)))
        return np.asarray(length * direction / np.sqrt((direction**2).sum(axis=1, keepdims=True)))

    position, velocity = vectors(*_RANGES), vectors(*_SPEEDS)
    return RelativeState(position, velocity, generator.uniform(0.0, 2.0 * np.pi, rows))


def responds_to_thrust(constraint: Constraint) -> bool:
    """Return whether the gradient of h has a velocity part anywhere; without one no thrust changes how fast h falls."""
    return bool(np.any(constraint.gradient(probe_states())[:, 3:]))
