"""Sampled states for testing constraints."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, cast

import numpy as np

from safe_inspect.rta.constraints.base import Constraint, RelativeState
from safe_inspect.rta.constraints.parameters import ConstraintParameters
from safe_inspect.types import FloatArray

#: Smallest and largest range [m] and speed [m/s].
_RANGES, _SPEEDS = (1.0, 2000.0), (1e-3, 10.0)
#: Number of states that are sampled to estimate the share of safe states that are recoverable.
SAFE_DRAWS = 4096


def probe_states(rows: int = 512) -> RelativeState:
    """Return states in all directions, with ranges of 1 m to 2 km and speeds of 1 mm/s to 10 m/s, always the same.

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
    """Sample states over all ranges and speeds, always the same, and return those that are safe.

    Args:
        constraints: The constraints.
        parameters: Their parameters, which give the limits for which there is no constraint.
        rows: Number of states to sample.
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
    """Return whether the gradient of h has a velocity part anywhere; if not, thrust does not affect the rate of h."""
    return bool(np.any(constraint.gradient(probe_states())[:, 3:]))
