"""The reference of an approach, the limits of tracking, and what a reference and its tube leave of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from safe_inspect.rendezvous.control.tube import Axis, Tube
from safe_inspect.types import FloatArray


@dataclass(frozen=True, eq=False)
class TrackedReference:
    """Reference to follow, sampled at the control steps.

    Attributes:
        position: Position in W [m], shape (K, 3).
        velocity: Velocity in W [m/s], shape (K, 3).
        tide: Acceleration that needs no force, on an orbit [m/s^2], shape (K, 3); None in free space.
    """

    position: FloatArray
    velocity: FloatArray
    tide: FloatArray | None = None

    def feed_forward(self, axis: Axis) -> FloatArray:
        """Return the mean force of each step that follows the reference [N], shape (K, 3); the last is repeated."""
        force = axis.feed_forward(self.velocity)
        if self.tide is None:
            return force
        mean = self.tide.copy()
        mean[:-1] = 0.5 * (self.tide[:-1] + self.tide[1:])
        return force - axis.mass * mean

    def force_at(self, axis: Axis, k: int) -> FloatArray:
        """Return the force of `feed_forward` at step k [N], shape (3,)."""
        first = max(min(k, len(self.position) - 2), 0)
        part = slice(first, first + 2)
        two = TrackedReference(self.position[part], self.velocity[part], None if self.tide is None else self.tide[part])
        return np.asarray(two.feed_forward(axis)[k - first])


@dataclass(frozen=True)
class TrackingLimits:
    """Limits that tracking must respect along each axis of W.

    Attributes:
        force: Maximum force [N].
        speed: Maximum speed [m/s]; higher than that of a plan, so that errors can be corrected.
        keep_in: Half sizes of the keep-in box about the origin of W [m]; None for no box.
    """

    force: float = 0.30
    speed: float = 0.20
    keep_in: Sequence[float] | None = (0.8, 3.0, 0.8)


def remaining(axis: Axis, reference: TrackedReference, tube: Tube, limits: TrackingLimits, k: int = 0) -> FloatArray:
    """Return what a reference and its tube leave of the limits from step k on, shape (3, 3).

    The rows are the axes of W, the columns the position [m], the velocity [m/s] and the force [N]. A negative entry
    means that the tube about the reference exceeds the limit.
    """
    steps = np.minimum(np.arange(len(reference.position)), len(tube.position) - 1)
    box = np.full(3, np.inf) if limits.keep_in is None else np.asarray(limits.keep_in, dtype=float)
    most = np.stack((box, np.full(3, limits.speed), np.full(3, limits.force)), axis=1)
    widths = np.stack((tube.position, tube.velocity, tube.force), axis=1)[steps][:, None, :]
    centre = np.stack((reference.position, reference.velocity, reference.feed_forward(axis)), axis=2)
    return np.asarray((most - widths - np.abs(centre))[k:].min(axis=0))
