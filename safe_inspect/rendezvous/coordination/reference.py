"""The reference that the tracker follows, from a plan and the newest estimate."""

from __future__ import annotations

import numpy as np

from safe_inspect.dynamics.quaternion import rotate
from safe_inspect.dynamics.tide import tidal_acceleration
from safe_inspect.rendezvous.control.tightening import TrackedReference
from safe_inspect.rendezvous.estimate import StateEstimate
from safe_inspect.rendezvous.planner.query import Plan
from safe_inspect.types import FloatArray


def reference_of(
    plan: Plan, estimate: StateEstimate, mating_point: FloatArray, tail: int, step: float, mean_motion: float
) -> TrackedReference:
    """Return the reference to follow: the plan's path in the target's frame, moved with the estimated target.

    The reference is ``r = p_CoM + R p_T`` and ``v = R (v_T + w x p_T)``; after the plan's end it is the mating point.

    Args:
        plan: The plan.
        estimate: The newest estimate.
        mating_point: The mating point in T [m], shape (3,).
        tail: Number of control steps for which the mating point is held after the plan.
        step: The control step [s].
        mean_motion: Mean motion of the target's orbit [rad/s].
    """
    times = np.concatenate([plan.times, plan.times[-1] + step * np.arange(1, tail + 1)])
    p = np.concatenate([plan.position_target, np.broadcast_to(mating_point, (tail, 3))])
    v = np.concatenate([plan.velocity_target, np.zeros((tail, 3))])
    q, w = estimate.predict(times)
    away = rotate(q, p)
    tide = tide_of(mean_motion, times, away)
    return TrackedReference(estimate.target.position + away, rotate(q, v + np.cross(w, p)), tide)


def tide_of(mean_motion: float, times: FloatArray, position: FloatArray) -> FloatArray | None:
    """Return the tide at positions relative to the target [m/s^2], shape (K, 3); None in free space."""
    return tidal_acceleration(mean_motion, times, position) if mean_motion else None
