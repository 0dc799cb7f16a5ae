"""The actions at the transitions between the states of a mission, and the reference that an approach follows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from safe_inspect.dynamics.quaternion import rotate
from safe_inspect.dynamics.tide import largest_tide, tidal_acceleration
from safe_inspect.plugins.results import called, require_type
from safe_inspect.rendezvous.control.bound import Bound, BoundQuery
from safe_inspect.rendezvous.control.design import DesignRequest, TubeDesign
from safe_inspect.rendezvous.control.tube import TrackedReference, remaining
from safe_inspect.rendezvous.coordination.context import Following, MissionContext, Phase
from safe_inspect.rendezvous.coordination.escape import departure_velocity, find_escape, remains_clear
from safe_inspect.rendezvous.coordination.guards import estimate_is_finite, fault_name, out_of_time, sees_target
from safe_inspect.rendezvous.estimate import StateEstimate
from safe_inspect.rendezvous.planner.checks import certify, plan_mistake
from safe_inspect.rendezvous.planner.query import Plan, PlanQuery, PlanStatus
from safe_inspect.types import FloatArray

#: Rounding error of references [m, m/s].
_ROUNDING = 1e-6


def _reference_bound(context: MissionContext, plan: Plan, *, updated: bool) -> Bound:
    """Return the bound of the error of a plan's reference, with or without updates during the approach."""
    estimate, config = context.estimate, context.config
    period = config.mission.update_period if updated else None
    query = BoundQuery(plan, estimate.inertia, estimate.errors, period, estimate.correlation, config.chaser.mass)
    bound: Bound = config.bound(query, context.streams)
    return bound


def _new_reference(context: MissionContext, plan: Plan) -> TrackedReference:
    """Return the reference of a plan, computed with the newest estimate."""
    mission = context.config.mission
    tail = round(mission.hold_limit / mission.step) + 1
    return reference_of(plan, context.estimate, context.target.mating_point, tail, mission.step, mission.mean_motion)


def _about_target(context: MissionContext, reference: TrackedReference) -> TrackedReference:
    """Return a reference with the target's centre of mass as its origin, which is that of plans and keep-in box."""
    return replace(reference, position=reference.position - context.estimate.target.position)


def renew_reference(context: MissionContext) -> None:
    """Update the reference with the newest estimate, and check it.

    A reference outside of the limits leads to a new plan. A reference outside of the bound without updates is only
    logged, because the path keeps its clearance in the target's frame, where an update does not change it.
    """
    following = context.following
    assert following is not None, "the reference can only be updated during an approach"
    plan, design, bound = following.plan, following.design, following.unrenewed
    following.reference = _new_reference(context, plan)
    if context.phase is not Phase.TRACK:
        return
    k = context.step - following.first_step
    reference = _about_target(context, following.reference)
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


#: Shortest duration of a plan for the rest of an approach [s].
_SHORTEST = 30.0


def nothing(context: MissionContext) -> None:
    """Do nothing."""


def start_observing(context: MissionContext) -> None:
    """Observe the target from the chaser's current position, or on a flight around it."""
    context.attempts, context.cause = context.attempts + 1, ""
    context.hold()
    context.plan_failures = context.bound_failures = 0
    context.following, context.on_approach = None, False
    context.forget_tube()


def end_observation(context: MissionContext) -> None:
    """Hold the position at which the observation ends."""
    context.hold_point = context.watch_point(context.time)


def end_observation_coarse(context: MissionContext) -> None:
    """Continue without the required accuracy and report it."""
    end_observation(context)
    context.coarse = True
    errors = context.estimate.errors
    context.report("coarse", {"attitude_sigma": errors.attitude, "rate_sigma": errors.rate})


def make_plan(context: MissionContext) -> None:
    """Plan an approach, with waits, from the position that the chaser holds."""
    mission = context.config.mission
    count = round(mission.wait_limit / mission.wait_step)
    waits = tuple(mission.wait_step * index for index in range(count + 1))
    has_failed = context.plan_failures or context.bound_failures
    durations = mission.durations if has_failed else mission.durations[:1]
    _plan(context, waits, durations)


def make_plan_again(context: MissionContext) -> None:
    """Plan with the requirements of the newest tube; without waits if the chaser has started an approach."""
    if context.on_approach:
        make_plan_now(context)
    else:
        make_plan(context)


def make_plan_now(context: MissionContext) -> None:
    """Plan an approach that starts immediately, with the newest estimate."""
    durations = context.config.mission.durations
    _plan(context, (0.0,), durations[:1] if context.plan is None else (context.plan.duration,))


def replan_on_the_way(context: MissionContext) -> None:
    """Plan the rest of the approach again from the chaser's current state."""
    context.replans += 1
    context.on_approach = True
    mission, plan = context.config.mission, context.plan
    start = context.time + mission.planning_time
    elapsed = 0.0 if plan is None else start - plan.t_start
    context.demands = context.demands.later(elapsed)
    remaining = 0.0 if plan is None else plan.t_start + plan.duration - start
    shortest = mission.step * round(max(remaining, _SHORTEST) / mission.step)
    _plan(context, (0.0,), tuple(dict.fromkeys((shortest, *mission.durations))))


def _plan(context: MissionContext, waits: tuple[float, ...], durations: tuple[float, ...]) -> None:
    estimate, mission = context.estimate, context.config.mission
    start = context.time + mission.planning_time
    context.plan, context.planned_at = None, start
    if mission.fails("planner", context.time):
        context.plan_failures += 1
        context.report("plan", {"status": "fault"})
        return
    state = _state_after(context, round(mission.planning_time / mission.step))
    orientation, angular_velocity = (values[0] for values in estimate.predict(np.array([start])))
    query = PlanQuery(
        t0=start,
        state=state,
        orientation=orientation,
        angular_velocity=angular_velocity,
        inertia=estimate.inertia,
        mating_point=context.target.mating_point,
        solid=context.target.solid,
        R_MT=context.target.R_MT,
        limits=context.demands.limits(context.limits, state[:3]),
        margin=context.demands.margin,
        durations=durations,
        waits=waits,
        mean_motion=mission.mean_motion,
        length=mission.length,
        step=mission.step,
        hold=mission.hold_limit,
    )
    plan: Plan = context.config.planner(query)
    require_type(called(context.config.planner), plan, Plan)
    mistake = plan_mistake(query, plan) if plan.solved else ""
    if mistake:
        plan = Plan(PlanStatus.REFUSED, plan.t_start, plan.duration, report=replace(plan.report, message=mistake))
    context.plan, context.query = plan, query
    context.plan_failures = 0 if plan.solved else context.plan_failures + 1
    if not plan.solved and not context.on_approach:
        context.forget_tube()  # the tube of a newer estimate may be narrower
    report = plan.report
    context.report(
        "plan",
        {
            "status": plan.status.value,
            "message": report.message,
            "t_start": plan.t_start,
            "duration": plan.duration,
            "cost": report.cost,
            "starts": report.starts,
            "clearance": report.clearance,
            "seconds": report.seconds,
        },
    )


def _state_after(context: MissionContext, steps: int) -> FloatArray:
    """Return the chaser's position and velocity in W relative to the target after control steps, shape (6,).

    A chaser that follows a reference continues to do so; another one holds its position.
    """
    estimate, following, axis = context.estimate, context.following, context.axis
    x = estimate.translation
    if following is not None:
        tracker, reference = context.config.tracker(following.design), following.reference
        for step in range(context.step, context.step + steps):
            k = min(step - following.first_step, len(reference.position) - 1)
            tide = 0.0 if reference.tide is None else axis.mass * reference.tide[k]
            acting = tracker.step(x, reference, k).force + tide
            x = (axis.A @ x.reshape(2, 3) + np.outer(axis.B, acting)).ravel()
    return np.concatenate([x[:3] - estimate.target.position, x[3:]])


def make_tube(context: MissionContext) -> None:
    """Bound the reference's error along the plan, design its tube, and set the requirements on the next plan."""
    plan, config = context.plan, context.config
    assert plan is not None, "a tube must only be made for a plan that was found"
    mission, actuator = config.mission, config.chaser.actuator
    bound = _reference_bound(context, plan, updated=True)
    in_model = plan.position_target @ context.target.R_MT.T
    # The tide at a distance of the scenario's length from the reference; the tube must be narrower than that.
    tide = config.chaser.mass * largest_tide(mission.mean_motion, mission.length)
    request = DesignRequest(
        plan=plan,
        bound=bound,
        clearance=context.target.solid.distance(in_model) - context.limits.radius,
        axis=context.axis,
        limits=context.tracking_limits,
        # The noise acts along the axes of the body, which may have any attitude.
        force_error=np.sqrt(3.0) * actuator.force_noise + abs(actuator.scale_error) * context.limits.force + tide,
        length=mission.length,
        gain=context.demands.gain,
    )
    design = config.tracker.design(request)
    require_type(called(config.tracker, "design"), design, TubeDesign)
    if design.accepted and not _is_certified(context, plan, design):
        design = replace(design, refusal="the plan does not keep the tube's clearance")
    if design.accepted and mission.mean_motion and np.sqrt(3.0) * design.tube.position.max() > 0.9 * mission.length:
        design = replace(design, refusal="tube: it is as wide as the scenario, so that the tide in it is not bounded")
    if design.accepted:  # Of the plan only; the approach also needs room to hold the mating point after it.
        reference = _about_target(context, _new_reference(context, plan))
        problem = reference_problem(design, plan, None, reference)
        room = remaining(design.axis, reference, design.tube, design.limits)[:, :2]
        design = replace(design, refusal=problem, state_reserve=room)
    context.design = design
    context.bound_failures = 0 if design.accepted else context.bound_failures + 1
    context.demands = context.demands.after(design)
    context.report(
        "tube",
        {
            "accepted": design.accepted,
            "refusal": design.refusal,
            "least_reserve": float(design.force_reserve.min()),
            "margin": [float(design.margin[0]), float(design.margin.max()), float(design.margin[-1])],
            "bound": [float(bound.position[0]), float(bound.position[-1])],
            "gain": np.atleast_2d(design.tube.gain)[[0, -1]].tolist(),
        },
    )


def start_approach(context: MissionContext) -> None:
    """Start to follow the plan."""
    plan, design = context.plan, context.design
    assert plan is not None, "an approach must only start with a plan"
    assert design is not None, "an approach must only start with a tube"
    context.on_approach = True
    context.outside = 0.0
    unrenewed = _reference_bound(context, plan, updated=False)
    reference, tracker = _new_reference(context, plan), context.config.tracker(design)
    context.following = Following(plan, design, unrenewed, reference, context.step, tracker)
    context.reference_problem, context.has_left_bound = "", False
    renew_escape(context)


def renew_escape(context: MissionContext) -> None:
    """Search for an escape; if there is none, keep the last one and log it. There is none without an estimate."""
    if not estimate_is_finite(context):
        return
    mission = context.config.mission
    found = find_escape(context.estimate, context.target, context.limits, mission.escapes, mission.length)
    if found is None:
        context.report("no_escape", {"clearance": context.clearance()})
    else:
        context.escape = found


def keep_escape(context: MissionContext) -> None:
    """Search for another escape only if there is none or the target is found to rotate into the current one."""
    escape, estimate = context.escape, context.estimate
    if escape is None or (estimate.alarm and not remains_clear(escape, estimate, context.target, context.limits)):
        renew_escape(context)


def retreat(context: MissionContext) -> None:
    """Retreat to a position outside of the sphere that the target sweeps."""
    late = f"out of time in {context.phase.value}" if out_of_time(context) else ""
    context.cause = fault_name(context) or late or f"retreat from {context.phase.value}"
    renew_escape(context)
    context.following = None
    context.hold_point = context.estimate.chaser.position.copy()


def finish(context: MissionContext) -> None:
    """End the mission at the mating point."""
    context.cause = ""


def give_up(context: MissionContext) -> None:
    """Leave the target and give up the mission."""
    context.cause = f"given up in {context.phase.value}"
    depart(context)


def depart(context: MissionContext) -> None:
    """Depart from the target: one push to a small velocity away from it, then coasting.

    The push is computed from the velocity at the last pose and the commands since then. No sensor controls it.
    """
    mission, motion = context.config.mission, context.motion
    away = motion.position - context.estimate.target.position
    orbit = (mission.mean_motion, context.time)
    velocity = departure_velocity(away, mission.departure_speed, mission.departure_limit, context.limits.keep_in, orbit)
    context.following, context.push = None, velocity - motion.velocity
    context.awaits_poses = not sees_target(context)
    context.report("departure", {"position": away.tolist(), "velocity": velocity.tolist()})


def _is_certified(context: MissionContext, plan: Plan, design: TubeDesign) -> bool:
    """Return whether a plan keeps the clearance of its tube at all times, including those between its samples."""
    assert context.query is not None, "a plan that was found must have a query"
    assert plan.path is not None, "a plan that was found must have a path"
    query = replace(context.query, margin=design.margin_at)
    return certify(query, plan.path, plan.t_start - query.t0).certified
