"""Dynamics of one axis of the chaser's translation: a point mass under a force that is constant over each step."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from safe_inspect.dynamics.cwh import transition
from safe_inspect.types import FloatArray


@dataclass(frozen=True)
class Axis:
    """Double integrator ``x+ = A x + B u`` with state (position [m], velocity [m/s]) and force u [N].

    Attributes:
        mass: Mass of the chaser [kg].
        step: Control period [s].
    """

    mass: float
    step: float = 0.2

    @cached_property
    def A(self) -> FloatArray:  # noqa: N802 - the field's name
        """State matrix ``[[1, dt], [0, 1]]``, shape (2, 2)."""
        return transition(0.0, self.mass, self.step)[0][np.ix_((0, 3), (0, 3))]

    @cached_property
    def B(self) -> FloatArray:  # noqa: N802 - the field's name
        """Input vector ``[dt^2/2, dt] / m``, shape (2,)."""
        return transition(0.0, self.mass, self.step)[1][[0, 3], 0]

    def closed_loop(self, gain: FloatArray) -> FloatArray:
        """Return ``A_K = A + B K``, shape (..., 2, 2), for gains K of shape (..., 2)."""
        return self.A + self.B[:, None] * np.asarray(gain)[..., None, :]

    def feed_forward(self, velocity: FloatArray) -> FloatArray:
        """Return the forces ``m (v_{k+1} - v_k) / dt`` [N] that produce velocities (K, ...); the last is repeated."""
        force = self.mass * np.diff(velocity, axis=0) / self.step
        return np.concatenate((force, force[-1:])) if len(force) else np.zeros_like(velocity)
