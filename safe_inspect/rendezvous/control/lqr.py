"""The linear-quadratic regulator about the reference, with clipped force: a comparison, and the fallback of `mpc`."""

from __future__ import annotations

import enum
from dataclasses import dataclass

import numpy as np

from safe_inspect.rendezvous.control.axis import Axis
from safe_inspect.rendezvous.control.gains import TrackingWeights, lqr_gain
from safe_inspect.rendezvous.control.tightening import TrackedReference
from safe_inspect.types import FloatArray


class AxisStatus(enum.IntEnum):
    """How the force along an axis was found; the larger, the worse."""

    SOLVED = 0
    LONGER_HORIZON = 1  # solved with a longer horizon than asked for
    SHIFTED = 2  # no solution: the rest of the last one
    REGULATOR = 3  # no solution at all: the clipped linear-quadratic regulator, without the tube's guarantee


@dataclass(frozen=True, eq=False)
class TrackerOutput:
    """The force of one step of control, along the axes of W.

    Attributes:
        force: What to apply [N], shape (3,).
        nominal: Nominal error z_0 in position [m] and velocity [m/s], shape (3, 2).
        nominal_force: v_0 [N], shape (3,).
        status: How each axis was found, shape (3,), of `AxisStatus`.
    """

    force: FloatArray
    nominal: FloatArray
    nominal_force: FloatArray
    status: tuple[AxisStatus, ...]

    @property
    def feasible(self) -> bool:
        """Whether every axis has a solution, this one's or the rest of the last one."""
        return max(self.status) < AxisStatus.REGULATOR


class LQRTracker:
    """``u = u_r + K (x_hat - r_hat)``, clipped."""

    def __init__(self, axis: Axis, force: float = 0.30, weights: TrackingWeights | None = None) -> None:
        """Compute the gain.

        Args:
            axis: The axes' model.
            force: Largest force along each axis [N].
            weights: Weights of the cost; by default those of this force.
        """
        self.axis, self.force = axis, force
        self.gain = lqr_gain(axis, weights or TrackingWeights.of_force(force))

    def step(self, estimate: FloatArray, reference: TrackedReference, k: int) -> TrackerOutput:
        """Return the force at step k of the reference, for an estimate (position, velocity) in W, shape (6,)."""
        error = np.asarray(estimate).reshape(2, 3).T - np.stack((reference.position[k], reference.velocity[k]), axis=1)
        tide = None if reference.tide is None else reference.tide[k : k + 2]
        two = TrackedReference(reference.position[k : k + 2], reference.velocity[k : k + 2], tide)
        demand = two.feed_forward(self.axis)[0] + error @ self.gain
        force = np.clip(demand, -self.force, self.force)
        return TrackerOutput(force, error, np.zeros(3), (AxisStatus.SOLVED,) * 3)
