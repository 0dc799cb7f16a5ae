"""States from everywhere, to try a constraint with."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, cast

import numpy as np

from safe_inspect.rta.constraints.base import Constraint, RelativeState
from safe_inspect.rta.constraints.parameters import ConstraintParameters
from safe_inspect.types import FloatArray

#: Smallest and largest range [m] and speed [m/s].
_RANGES, _SPEEDS = (1.0, 2000.0), (1e-3, 10.0)
#: States that are drawn to tell how many of the safe ones are recoverable.
SAFE_DRAWS = 4096


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


def safe_states(constraints: Mapping[str, Constraint], parameters: ConstraintParameters, rows: int) -> RelativeState:
    """Return the safe ones of a number of states from all of the range and all speeds, always the same.

    Args:
        constraints: The constraints.
        parameters: Their parameters, for the limits where a constraint is missing.
        rows: Number of states that are drawn.
    """
    generator, kept, p = np.random.default_rng(12), cast("Mapping[str, Any]", constraints), parameters
    near, far = (kept.get(name, p) for name in ("chief_collision", "r_max"))
    fastest = np.linalg.norm([kept.get(name, p).vel_limit for name in ("x_vel", "y_vel", "z_vel")])
    direction = generator.normal(size=(2, rows, 3))
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    distance = generator.uniform(near.collision_radius, far.r_max, rows)
    speed = np.full(rows, fastest)
    if "rel_vel" in kept:
        line = kept["rel_vel"]
        speed = np.clip(line.v0 + line.v1 * (distance - line.v0_distance), 0.0, fastest)
    speed *= generator.uniform(0.0, 1.0, rows)
    drawn = RelativeState(
        direction[0] * distance[:, None], direction[1] * speed[:, None], generator.uniform(0.0, 2.0 * np.pi, rows)
    )
    return drawn[np.all([constraint.phi(drawn) >= 0.0 for constraint in constraints.values()], axis=0)]


def responds_to_thrust(constraint: Constraint) -> bool:
    """Return whether the gradient of h has a velocity part anywhere; without one no thrust changes how fast h falls."""
    return bool(np.any(constraint.gradient(probe_states())[:, 3:]))
