"""The reference that the tracker follows, from a plan and the newest estimate, and its check."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from safe_inspect.dynamics.quaternion import rotate
from safe_inspect.dynamics.tide import tidal_acceleration
from safe_inspect.rendezvous.control.bound import Bound
from safe_inspect.rendezvous.control.design import TubeDesign
from safe_inspect.rendezvous.control.tracked import TrackedReference, remaining
from safe_inspect.rendezvous.control.trials import BoundQuery, Updates
from safe_inspect.rendezvous.coordination.context import MissionContext, Phase
from safe_inspect.rendezvous.estimate import StateEstimate
from safe_inspect.rendezvous.planner.query import Plan
from safe_inspect.types import FloatArray

#: Rounding error of references [m, m/s].
_ROUNDING = 1e-6


def reference_bound(context: MissionContext, plan: Plan, *, updated: bool) -> Bound:
    """Return the bound of the error of a plan's reference, with or without updates during the approach."""
    estimate, config = context.estimate, context.config
    updates = Updates(config.mission.update_period, estimate.correlation) if updated else None
    query = BoundQuery(plan, estimate.inertia, estimate.errors, updates, config.chaser.mass)
    bound: Bound = config.bound(query, context.streams)
    return bound


def new_reference(context: MissionContext) -> TrackedReference:
    """Return the reference of the plan, computed with the newest estimate."""
    mission, plan = context.config.mission, context.plan
    assert plan is not None, "a reference must only be followed with a plan"
    tail = round(mission.hold_limit / mission.step) + 1
    return reference_of(plan, context.estimate, context.target.mating_point, tail, mission.step, mission.mean_motion)


def renew_reference(context: MissionContext) -> None:
    """Update the reference with the newest estimate, and check it.

    A reference outside of the limits leads to a new plan. A reference outside of the bound without updates is only
    logged, because the path keeps its clearance in the target's frame, where an update does not change it.
    """
    following, plan, design, bound = context.following, context.plan, context.design, context.unrenewed
    assert following is not None, "the reference can only be updated during an approach"
    following.reference = reference = new_reference(context)
    if context.phase is not Phase.TRACK or plan is None or design is None or bound is None:
        return
    k = context.step - following.first_step
    # The origin of the plan is the target's centre of mass.
    reference = replace(reference, position=reference.position - context.estimate.target.position)
    rounded = replace(bound, position=bound.position + _ROUNDING, velocity=bound.velocity + _ROUNDING)
    problem = reference_problem(design, plan, rounded, reference, k)
    if problem:
        if not context.has_left_bound:
            context.report("reference", {"problem": problem})
        context.has_left_bound = True
        context.reference_problem = reference_problem(design, plan, None, reference, k)


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


def reference_problem(
    design: TubeDesign, plan: Plan, unrenewed: Bound | None, reference: TrackedReference, k: int = 0
) -> str:
    """Return what is wrong with a reference from step k on; empty if nothing is.

    The reference must stay within the bound that holds for a propagated estimate without updates, and it must leave
    the force, speed and part of the keep-in box that the tube needs. Otherwise bound, tube and certificate have to be
    computed again, or a new plan made. Errors of attitude do not affect the clearance, which is defined in the target's
    axes.

    Args:
        design: The tube of the plan.
        plan: The plan that is being flown.
        unrenewed: The bound of the plan's reference without updates; None to check the limits only.
        reference: The new reference, at the samples of the plan and possibly after them.
        k: The first step to check.
    """
    last = len(plan.times)
    for name, unit in (("position", "m"), ("velocity", "m/s")) if unrenewed is not None else ():
        found, planned, allowed = (getattr(one, name) for one in (reference, plan, unrenewed))
        difference = np.abs(found[k:last] - planned[k:]).max(axis=1, initial=0.0)
        excess = difference - allowed[k:]
        if excess.size and excess.max() > 0.0:
            worst = int(excess.argmax())
            return (
                f"reference: its {name} differs from the plan's by {difference[worst]:.3f} {unit} at "
                f"{plan.times[k + worst] - plan.t_start:.1f} s, more than the bound of {allowed[k + worst]:.3f} {unit}"
            )
    reserve = remaining(design.axis, reference, design.tube, design.limits, k).min(axis=0)
    for name, unit, value in zip(("keep-in box", "speed", "force"), ("m", "m/s", "N"), reserve, strict=True):
        if value < 0.0:
            return f"reference: together with its tube it exceeds the {name} limit by {-value:.3f} {unit}"
    return ""
