"""The guards of the coordinator's table: conditions on a mission, without side effects."""

from __future__ import annotations

import numpy as np

from safe_inspect.rendezvous.coordination.context import MissionContext, Phase
from safe_inspect.rendezvous.coordination.escape import safe_radius

#: Distance from the tube above which an approach is planned again, as a fraction of the scenario's length; the margin
#: of clearance allows for it.
_OUTSIDE = 0.01
#: Largest number of new plans during an approach.
_MOST_REPLANS = 10
#: Speed below which the chaser counts as at rest [m/s].
_REST = 0.01
#: Clearance from the sphere that the target sweeps above which a chaser without poses departs, as a fraction of the
#: scenario's length.
_CLEAR = 0.1
#: Number of consecutive poses after which the target is observed again, and largest age of the last, in update periods.
_RESUMED, _NEWEST = 5, 2.0
#: Remaining change of velocity below which a push is over [m/s].
_LEAST_PUSH = 1e-9
#: Rounding error of times [s].
_ROUNDING = 1e-9


def always(context: MissionContext) -> bool:
    """Return True."""
    return True


def checked_out(context: MissionContext) -> bool:
    """Return whether all sensors have worked for long enough."""
    return bool(context.elapsed >= context.config.mission.checkout - _ROUNDING and _sensors_work(context))


def checkout_too_long(context: MissionContext) -> bool:
    """Return whether the time for all sensors to work is over."""
    return bool(context.elapsed >= context.config.mission.checkout_limit - _ROUNDING)


def estimate_is_finite(context: MissionContext) -> bool:
    """Return whether the estimate has a position, a velocity and an attitude of the target."""
    estimate = context.estimate
    return bool(np.isfinite(estimate.translation).all() and np.isfinite(estimate.target.orientation).all())


def fault(context: MissionContext) -> bool:
    """Return whether there is a fault with which it is unsafe to continue."""
    return bool(fault_name(context))


def fault_name(context: MissionContext) -> str:
    """Return the name of the current fault of a sensor, the estimate or the clearance; empty without a fault."""
    mission = context.config.mission
    if not estimate_is_finite(context):
        return "estimate not finite"
    is_awaited = context.phase is Phase.CHECKOUT  # The inertial unit may be silent until `checkout_limit`.
    if context.time - context.imu_time > mission.imu_silence + _ROUNDING and not is_awaited:
        return "inertial unit silent"
    if unseen(context):
        return "camera silent" if _camera_is_silent(context) else "target not seen"
    decided = context.phase in (Phase.PLAN, Phase.WAIT, Phase.TRACK, Phase.MP_HOLD)
    if decided and context.estimate.alarm:
        return context.estimate.alarm
    if context.clearance() < 0.0:
        return "no clearance"
    if not _is_kept_in(context):
        return "outside of the keep-in box"
    return ""


def unseen(context: MissionContext) -> bool:
    """Return whether the camera has been silent, or no frame has shown the target, for longer than is tolerated."""
    mission = context.config.mission
    longest = mission.camera_silence + mission.update_period + _ROUNDING
    return _camera_is_silent(context) or bool(context.time - context.estimate.updated > longest)


def out_of_time(context: MissionContext) -> bool:
    """Return whether the mission has reached its time limit."""
    return bool(context.time >= context.config.mission.time_limit - _ROUNDING)


def observed(context: MissionContext) -> bool:
    """Return whether the target was observed long enough and its estimate is accurate enough."""
    mission, estimate = context.config.mission, context.estimate
    errors = estimate.errors
    accurate = errors.attitude <= mission.attitude_sigma and errors.rate <= mission.rate_sigma
    return bool(context.elapsed >= mission.observe - _ROUNDING and accurate and not estimate.alarm)


def observed_at_most(context: MissionContext) -> bool:
    """Return whether the observation of the target has reached its longest duration."""
    return bool(context.elapsed >= context.config.mission.observe_limit - _ROUNDING)


def characterised(context: MissionContext) -> bool:
    """Return whether the target's axes and motion are known."""
    return bool(np.isfinite(context.estimate.target.angular_velocity).all()) and not context.estimate.problem


def may_observe_again(context: MissionContext) -> bool:
    """Return whether another attempt is left, and the chaser has not started an approach."""
    return _has_attempts(context) and not context.on_approach


def plan_found(context: MissionContext) -> bool:
    """Return whether the newest plan may be flown."""
    return _planning_has_ended(context) and context.plan is not None and context.plan.solved


def plans_exhausted(context: MissionContext) -> bool:
    """Return whether no further plan may be tried: after too many failures, or during an approach."""
    is_last = context.plan_failures >= context.config.mission.plan_attempts or context.on_approach
    return is_last and _planning_has_ended(context)


def estimate_is_new(context: MissionContext) -> bool:
    """Return whether the target was seen again since the last plan."""
    return context.estimate.updated > context.planned_at


def tube_fits(context: MissionContext) -> bool:
    """Return whether the plan leaves enough force and clearance for its tube."""
    return context.design is not None and context.design.accepted


def may_bound_again(context: MissionContext) -> bool:
    """Return whether another plan may be tried with the margin of the newest tube."""
    return context.bound_failures < context.config.mission.bound_attempts


def start_is_planned(context: MissionContext) -> bool:
    """Return whether it is time to start, and the newest plan has only now been made."""
    is_new = abs(context.planned_at - context.time) <= _ROUNDING
    return is_new and context.plan is not None and context.time >= context.plan.t_start - _ROUNDING


def start_is_near(context: MissionContext) -> bool:
    """Return whether it is time to plan the start with the newest estimate."""
    planning = context.config.mission.planning_time
    return context.plan is not None and context.time >= context.plan.t_start - planning - _ROUNDING


def arrived(context: MissionContext) -> bool:
    """Return whether the plan has ended."""
    plan = context.plan
    return plan is not None and context.time >= plan.t_start + plan.duration - _ROUNDING


def off_plan(context: MissionContext) -> bool:
    """Return whether the chaser's distance from the tube or the reference requires a new plan."""
    return context.outside > _OUTSIDE * context.config.mission.length or bool(context.reference_problem)


def may_replan(context: MissionContext) -> bool:
    """Return whether the approach requires a new plan and another one is allowed."""
    return off_plan(context) and context.replans < _MOST_REPLANS


def settled(context: MissionContext) -> bool:
    """Return whether the chaser has stayed at the mating point, and each of the newest frames alone confirms it."""
    since, mission = context.settled_since, context.config.mission
    if since is None or context.time - since < mission.hold - _ROUNDING:
        return False
    return bool(context.estimate.mismatch <= mission.hold_position)


def hold_too_long(context: MissionContext) -> bool:
    """Return whether the time to settle at the mating point is over."""
    return bool(context.elapsed >= context.config.mission.hold_limit - _ROUNDING)


def escaped(context: MissionContext) -> bool:
    """Return whether the chaser is at rest in the keep-in box, outside of the sphere that the target sweeps."""
    length = context.config.mission.length
    is_far = _distance(context) >= safe_radius(context.target, context.limits, length) - 0.02 * length
    return is_far and _is_kept_in(context) and float(np.linalg.norm(context.estimate.chaser.velocity)) <= _REST


def unseen_outside(context: MissionContext) -> bool:
    """Return whether the chaser has no poses and is outside of the swept sphere, where it need not manoeuvre."""
    swept = context.target.swept_radius + context.limits.radius + _CLEAR * context.config.mission.length
    return unseen(context) and _distance(context) >= swept


def may_return(context: MissionContext) -> bool:
    """Return whether the chaser has escaped, sees the target, and has an attempt and time for another approach."""
    return escaped(context) and sees_target(context) and _has_attempts(context)


def retreat_too_long(context: MissionContext) -> bool:
    """Return whether the time for a retreat is over."""
    return bool(context.elapsed >= context.config.mission.retreat_limit - _ROUNDING)


def may_resume(context: MissionContext) -> bool:
    """Return whether a departing chaser that waits for poses sees the target again."""
    return _may_wait(context) and sees_target(context) and _is_kept_in(context)


def departed(context: MissionContext) -> bool:
    """Return whether the push of a departure is over and the chaser need not wait longer for poses."""
    is_over = context.elapsed >= context.config.mission.departure_limit - _ROUNDING
    is_pushed = not _LEAST_PUSH <= float(np.linalg.norm(context.push)) < np.inf  # NaN without a finite estimate
    return is_pushed and (is_over or not _may_wait(context))


def sees_target(context: MissionContext) -> bool:
    """Return whether the sensors work, and the target was seen recently and in enough consecutive frames."""
    age = context.time - context.estimate.updated
    is_fresh = age <= _NEWEST * context.config.mission.update_period + _ROUNDING
    return bool(not context.readings.silent and is_fresh and context.poses >= _RESUMED)


def _planning_has_ended(context: MissionContext) -> bool:
    return bool(context.time >= context.planned_at - _ROUNDING)


def _may_wait(context: MissionContext) -> bool:
    """Return whether the chaser has departed without seeing the target, and has an attempt and time left."""
    return context.awaits_poses and _has_attempts(context)


def _has_attempts(context: MissionContext) -> bool:
    return context.attempts < context.config.mission.attempts and not out_of_time(context)


def _camera_is_silent(context: MissionContext) -> bool:
    return bool(context.time - max(context.camera_time, 0.0) > context.config.mission.camera_silence + _ROUNDING)


def _is_kept_in(context: MissionContext) -> bool:
    """Return whether the chaser's estimated position is in the keep-in box."""
    return bool((np.abs(context.estimate.relative[:3]) <= context.limits.keep_in).all())


def _distance(context: MissionContext) -> float:
    """Return the estimated distance of the chaser from the target's centre of mass [m]."""
    return float(np.linalg.norm(context.estimate.relative[:3]))


def _sensors_work(context: MissionContext) -> bool:
    period = context.config.mission.update_period
    return context.time - context.camera_time <= period + _ROUNDING and context.time - context.imu_time <= _ROUNDING
