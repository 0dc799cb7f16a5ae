"""What a tube is designed for, and from estimates to references."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from safe_inspect.dynamics.quaternion import rotate
from safe_inspect.dynamics.tide import tidal_acceleration
from safe_inspect.rendezvous.bound.conformal import Bound
from safe_inspect.rendezvous.control.axis import Axis
from safe_inspect.rendezvous.control.design import DesignOptions, TubeDesign, axis_bound, design_tube
from safe_inspect.rendezvous.control.gains import candidate_gains, clearance_margin, stiffening_gains
from safe_inspect.rendezvous.control.tightening import TightenedLimits, TrackedReference, TrackingLimits
from safe_inspect.rendezvous.control.tube import Tube, no_tube, truth_tube
from safe_inspect.rendezvous.estimate import StateEstimate
from safe_inspect.rendezvous.planner.query import Plan
from safe_inspect.types import FloatArray


@dataclass(frozen=True, eq=False)
class DesignRequest:
    """A plan that a tracker is to be designed for.

    Attributes:
        plan: The plan, sampled at the steps of control.
        bound: Bound of the error of its reference.
        clearance: Distance of the chaser's sphere to the target along the plan [m], shape (K,).
        axis: The chaser along one axis.
        limits: What tracking must keep.
        force_error: Largest error of a force of the actuators [N].
        length: Length of the scenario [m].
        frequencies: Least and largest natural frequency of the gains that are tried [rad/s].
        gain: Gain of the tube that the plan was made for, shape (2,) or (K, 2), which is kept where the force allows
            it; None for the best.
    """

    plan: Plan
    bound: Bound
    clearance: FloatArray
    axis: Axis
    limits: TrackingLimits
    force_error: float
    length: float = 1.0
    frequencies: tuple[float, float] = (0.15, 1.0)
    gain: FloatArray | None = None


def design_by_clearance(request: DesignRequest) -> TubeDesign:
    """Return the tube that leaves most clearance along a plan, or why there is none.

    The gain that the plan was made for is kept where force, keep-in and speed allow it: its margin is the plan's, but
    for the change of the bound, so that plan and tube agree after a few turns. Else the tube that is narrowest over all
    times is tried first; where it is wider than the plan's clearance, that of each gain which the force allows, and of
    gains that stiffen from the best one.

    Args:
        request: The plan.
    """
    plan, axis = request.plan, request.axis
    grid = tuple(np.geomspace(*request.frequencies, 20))
    reserve = 0.03 * (request.limits.force / 0.30)
    options = DesignOptions(request.force_error, reserve=reserve, length=request.length, frequencies=grid)
    if request.gain is not None:
        gain = _resampled(request.gain, len(plan.times))
        kept = design_tube(plan, request.bound, axis, request.limits, replace(options, gains=(gain,), reserve=0.0))
        if kept.accepted:
            return kept
    first = design_tube(plan, request.bound, axis, request.limits, options)
    if not first.accepted or (first.margin <= request.clearance).all():
        return first
    disturbance = axis_bound(axis, request.bound, options)
    available = first.force_reserve + first.tube.force

    def spare(tube: Tube) -> float:
        if (tube.force > available).any():
            return -np.inf
        return float((request.clearance - clearance_margin(tube, request.length)).min())

    constant = [truth_tube(axis, gain, disturbance) for gain in candidate_gains(axis, grid)]
    best = max([*constant, first.tube], key=spare)
    if best.gain.ndim == 1:
        stiffer = [truth_tube(axis, gain, disturbance) for gain in stiffening_gains(axis, best.gain, len(plan.times))]
        best = max([best, *stiffer], key=spare)
    options = replace(options, gains=(best.gain,), reserve=0.0)
    return design_tube(plan, request.bound, axis, request.limits, options)


def _resampled(gain: FloatArray, steps: int) -> FloatArray:
    """Return a gain for a plan of another number of steps, shape (2,) or (steps, 2)."""
    if gain.ndim == 1 or len(gain) == steps:
        return gain
    old, new = np.linspace(0.0, 1.0, len(gain)), np.linspace(0.0, 1.0, steps)
    return np.stack([np.interp(new, old, column) for column in gain.T], axis=1)


def design_without_tube(request: DesignRequest) -> TubeDesign:
    """Return a tube of no width, for trackers without one."""
    plan, axis, limits = request.plan, request.axis, request.limits
    tube = no_tube(len(plan.times))
    reference = TrackedReference(plan.position, plan.velocity, plan.tide)
    reserve = TightenedLimits(axis, reference, tube, limits).reserve()
    available = limits.force - np.abs(plan.force).max(axis=1)
    margin = clearance_margin(tube, request.length)
    return TubeDesign(axis, limits, tube, plan.times, available, reserve[:, :2], margin)


def reference_of(
    plan: Plan, estimate: StateEstimate, mating_point: FloatArray, tail: int, step: float, mean_motion: float = 0.0
) -> TrackedReference:
    """Return what to follow: the plan's path in the target's frame, moved as the target is estimated to move.

    ``r = p_CoM + R p_T`` and ``v = R (v_T + w x p_T)``; after the plan's end the mating point.

    Args:
        plan: The plan.
        estimate: The newest estimate.
        mating_point: In T [m], shape (3,).
        tail: Steps for which the mating point is held after the plan.
        step: The step of control [s].
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
