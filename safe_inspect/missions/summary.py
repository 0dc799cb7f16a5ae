"""The summary of a mission's log: success, clearance, errors, effort; and a table of it."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np

from safe_inspect.dynamics.quaternion import conjugate, exp, log, multiply, rotate
from safe_inspect.dynamics.tumble import classify
from safe_inspect.missions.record import MissionLog
from safe_inspect.rendezvous.coordination.context import Phase
from safe_inspect.rendezvous.estimate import BodyState, JointErrors, StateEstimate
from safe_inspect.rendezvous.experiment import RendezvousConfig
from safe_inspect.rendezvous.target.model import Target
from safe_inspect.types import AnyArray, FloatArray

#: Label and unit of the metrics of a summary, by key, without delta-v [m/s], a metric of every episode.
MISSION_FIGURES: Mapping[str, tuple[str, str]] = MappingProxyType(
    {
        "time": ("time", "s"),
        "time_on_approach": ("time on the approach", "s"),
        "tumble_rate": ("rate of the tumble at the start", "rad/s"),
        "tumble_axis": ("axis of the tumble", "-"),
        "least_clearance": ("least clearance", "m"),
        "contact_speed": ("speed at contact", "m/s"),
        "mating_position_error": ("position error at the mating point", "m"),
        "mating_speed_error": ("velocity error at the mating point", "m/s"),
        "attitude_error": ("error of the target's attitude", "rad"),
        "nees": ("NEES of the target's attitude and rate", "-"),
        "largest_force": ("largest force", "N"),
        "largest_gauge": ("largest gauge of the tube", "-"),
        "plans": ("plans", "-"),
        "planning_time": ("planning time", "s"),
        "escape_missing": ("steps without an escape", "-"),
        "given_up": ("given up", "-"),
        "keep_in_excursion": ("excursion from the keep-in box", "m"),
        "final_speed": ("speed at the end", "m/s"),
        "final_range": ("range at the end", "m"),
        "final_range_rate": ("range rate at the end", "m/s"),
    }
)
#: Half width of a tube below which its gauge consists of rounding errors [m].
_LEAST_TUBE = 1e-9


def attitude_error(estimate: StateEstimate, chaser: BodyState, target: BodyState) -> FloatArray:
    """Return the error of the target's attitude relative to the chaser, R_BT, as a tangent in T [rad], shape (3,).

    A rotation of the estimated frame W cannot be measured and does not count: it moves chaser and target equally.

    Args:
        estimate: The estimate.
        chaser: The chaser's true state.
        target: The target's true state.
    """
    return _relative_error(
        (estimate.chaser.orientation, estimate.target.orientation), (chaser.orientation, target.orientation)
    )


def _relative_error(estimated: tuple[FloatArray, FloatArray], true: tuple[FloatArray, FloatArray]) -> FloatArray:
    """Return the error of `attitude_error` from estimated and true quaternions q_WB and q_WT, shape (..., 4)."""
    seen, real = (multiply(conjugate(chaser), target) for chaser, target in (estimated, true))
    return log(multiply(conjugate(real), seen))


def normalised_error(estimate: StateEstimate, chaser: BodyState, target: BodyState) -> float:
    """Return the normalised squared error of attitude and angular velocity (NEES).

    It is NaN without a covariance, or if this is singular.

    It is 6 on average if the covariance is right; nothing is aligned to the truth. The error is the tangent of the
    estimate: the truth is ``q Exp(a)`` and ``Exp(-a) w + r``, see `JointErrors`.
    """
    if not isinstance(estimate.errors, JointErrors):
        return float("nan")
    joint = estimate.errors.joint
    turn = attitude_error(estimate, chaser, target)  # the estimate as seen from the truth: -a
    rate = target.angular_velocity - rotate(exp(turn), estimate.target.angular_velocity)
    error = np.concatenate([-turn, rate])
    try:
        return float(error @ np.linalg.solve(joint[2:8, 2:8], error))
    except np.linalg.LinAlgError:  # of a motion of which nothing is known, such as that of a shape not recognised
        return float("nan")


def mission_table(summary: Mapping[str, Any]) -> str:
    """Return the table of one mission: its result, why the last plan or tube was refused, and its metrics."""
    detail = f" ({summary['detail']})" if summary.get("detail") else ""
    lines = ["success" if summary["success"] else f"failed: {summary['cause']}{detail}"]
    for key, (label, unit) in {**MISSION_FIGURES, "delta_v": ("delta-v", "m/s")}.items():
        value = summary.get(key)
        lines.append(f"  {label:<42}{'-' if value is None else f'{value:.3g} {unit}'.removesuffix(' -')}")
    return "\n".join(lines)


def summarise_mission(
    config: RendezvousConfig, target: Target, mission_log: MissionLog, success: bool, cause: str
) -> dict[str, Any]:
    """Return the summary of a mission.

    Args:
        config: The experiment.
        target: The target.
        mission_log: The log of the mission.
        success: Whether the chaser has stayed at the mating point according to its estimate.
        cause: Why the mission has failed.

    Returns:
        A dictionary with the following values; null means None.

        - ``success``: whether the chaser has truly stayed at the mating point, touched nothing, and never left the
          keep-in box; ``cause``: why it failed.
        - ``time`` [s] and ``time_on_approach`` [s].
        - ``least_clearance``: between the chaser's sphere and the target's boxes at all ticks [m].
        - ``mating_position_error`` [m] and ``mating_speed_error`` [m/s]: at the end.
        - ``delta_v`` [m/s] and ``largest_force`` along an axis of B [N], as commanded, without errors of the actuators.
        - ``largest_gauge``: distance from the true reference along an axis relative to the tube's half width.
        - ``plans``: number of plans that were made; ``planning_time`` [s].
        - ``attitude_error``: of the target as the chaser sees it [rad], and ``nees``: of the target's attitude and
          rate (squared error over covariance, 6 expected), both when the target's motion is first characterised; null
          if it never is, and for ``nees`` without a covariance.
        - ``tumble_axis``: axis about which the target rotates (0: at a constant rate); ``tumble_rate``: at the start
          [rad/s].
        - ``detail``: why the last plan or tube was refused; empty without a refusal.
        - ``escape_missing``: number of control steps without an escape.
        - ``keep_in_excursion``: largest distance of the chaser from the keep-in box, outside of it [m]; null without
          a box.
        - ``contact_speed``: relative to the target's surface at the first contact [m/s]; null without a contact.
        - ``given_up``: whether the mission ended with a departure from the target.
        - ``final_speed`` [m/s], ``final_range``: distance from the target's centre of mass [m], and
          ``final_range_rate`` [m/s], positive if the chaser moves away; all at the end.
    """
    arrays = mission_log.arrays()
    mission = config.mission
    moves = np.isin(arrays["state"], [Phase.TRACK.number, Phase.MP_HOLD.number])
    plans = [event["data"] for event in mission_log.events if event["event"] == "plan"]
    answers = [event["data"] for event in mission_log.events if event["event"] in ("plan", "tube")]
    position, speed = _mating_error(arrays, target.mating_point)
    # The axes of a map are not those of the true inertia, so that errors of the attitude mean nothing.
    is_known = config.estimator.known(target) is target
    gauge = _gauge(arrays, moves) if is_known else None
    clearance = float(arrays["clearance"].min())
    if clearance <= 0.0:
        success, cause = False, f"contact with the target{f' ({cause})' if cause else ''}"
    elif success and not (position[-1] <= mission.hold_position and speed[-1] <= mission.hold_speed):
        success, cause = False, "the estimate was at the mating point, and the chaser was not"
    excursion = _excursion(arrays, config)
    if success and excursion:
        success, cause = False, f"outside of the keep-in box by {excursion:.2g} m"
    return {
        "success": success,
        "cause": cause,
        "time": float(arrays["t"][-1] + mission.step),
        "time_on_approach": float(moves.sum() * mission.step),
        "least_clearance": clearance,
        "mating_position_error": float(position[-1]),
        "mating_speed_error": float(speed[-1]),
        "delta_v": float(np.linalg.norm(arrays["force"], axis=1).sum() * mission.step / config.chaser.mass),
        "largest_force": float(np.abs(arrays["force"]).max()),
        "largest_gauge": gauge,
        "plans": len(plans),
        "planning_time": float(sum(plan.get("seconds") or 0.0 for plan in plans)),
        **(_consistency(arrays) if is_known else {"attitude_error": None, "nees": None}),
        "tumble_axis": int(classify(target.principal, arrays["target_w"][:1]).axis[0]),
        "tumble_rate": float(np.linalg.norm(arrays["target_w"][0])),
        "detail": "" if success or not answers else answers[-1].get("message") or answers[-1].get("refusal") or "",
        "escape_missing": sum(event["event"] == "no_escape" for event in mission_log.events),
        "keep_in_excursion": excursion,
        "contact_speed": _contact_speed(arrays),
        "given_up": bool(arrays["state"][-1] == Phase.DEPART.number),
        **_final_motion(arrays["x"][-1]),
    }


def _excursion(arrays: dict[str, AnyArray], config: RendezvousConfig) -> float | None:
    """Return the largest distance by which the chaser was outside of the keep-in box [m]; None without a box."""
    keep_in = config.chaser.limits.keep_in
    if keep_in is None:
        return None
    return max(float((np.abs(arrays["x"][:, :3]) - np.array(keep_in)).max()), 0.0)


def _contact_speed(arrays: dict[str, AnyArray]) -> float | None:
    """Return the chaser's speed relative to the target's body at the first contact [m/s]; None without a contact."""
    touching = np.flatnonzero(arrays["clearance"] <= 0.0)
    if not len(touching):
        return None
    x, w = arrays["x"][touching[0]], rotate(arrays["target_q"][touching[0]], arrays["target_w"][touching[0]])
    return float(np.linalg.norm(x[3:] - np.cross(w, x[:3])))


def _final_motion(x: FloatArray) -> dict[str, float]:
    """Return the speed [m/s], range [m] and range rate [m/s] of a state in W."""
    distance = float(np.linalg.norm(x[:3]))
    return {
        "final_speed": float(np.linalg.norm(x[3:])),
        "final_range": distance,
        "final_range_rate": float(x[:3] @ x[3:]) / distance,
    }


def _consistency(arrays: dict[str, AnyArray]) -> dict[str, float | None]:
    """Return the attitude error [rad] and the NEES at the first step after the target was characterised."""
    known = np.isin(arrays["state"], [one.number for one in (Phase.PLAN, Phase.BOUND, Phase.WAIT, Phase.TRACK)])
    if not known.any():
        return {"attitude_error": None, "nees": None}
    k = int(np.argmax(known))
    error = _relative_error(
        (arrays["estimated_q"][k], arrays["estimated_target_q"][k]), (arrays["q"][k], arrays["target_q"][k])
    )
    nees = float(arrays["nees"][k])  # NaN if the estimator states no covariance
    return {"attitude_error": float(np.linalg.norm(error)), "nees": nees if np.isfinite(nees) else None}


def _mating_error(arrays: dict[str, AnyArray], mating_point: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the errors of position [m] and velocity [m/s] relative to the true mating point at every step."""
    q, w, x = arrays["target_q"], arrays["target_w"], arrays["x"]
    point = np.broadcast_to(mating_point, w.shape)
    return (
        np.linalg.norm(x[:, :3] - rotate(q, point), axis=1),
        np.linalg.norm(x[:, 3:] - rotate(q, np.cross(w, point)), axis=1),
    )


def _gauge(arrays: dict[str, AnyArray], moves: AnyArray) -> float | None:
    """Return the largest distance from the true reference, relative to the tube's half width; None without a tube."""
    tube = arrays["tube"][moves]
    if not len(tube) or not np.isfinite(tube).all():
        return None
    distance = np.abs(arrays["x"][moves, :3] - true_reference(arrays)[moves]).max(axis=1)
    wide = tube > _LEAST_TUBE
    return float((distance[wide] / tube[wide]).max()) if wide.any() else None


def true_reference(arrays: dict[str, AnyArray]) -> FloatArray:
    """Return the true reference, the centre of the tube, in W [m], shape (K, 3).

    The reference in the log follows the estimated attitude. This function takes it into the estimated T, where it is
    the plan, and from there into W with the true attitude.

    Args:
        arrays: The arrays of a log.
    """
    relative = arrays["reference"][:, :3] - arrays.get("estimated_target_p", np.zeros(3))
    in_target = rotate(conjugate(arrays["estimated_target_q"]), relative)
    return np.asarray(rotate(arrays["target_q"], in_target))
