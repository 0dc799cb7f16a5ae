"""What a mission's log says of it: success, clearance, errors at the mating point, effort."""

from __future__ import annotations

from typing import Any

import numpy as np

from safe_inspect.dynamics.quaternion import conjugate, log, multiply, rotate
from safe_inspect.dynamics.tumble import classify
from safe_inspect.rendezvous.coordination.coordinator import Phase
from safe_inspect.rendezvous.log import MissionLog
from safe_inspect.rendezvous.models import RendezvousConfig
from safe_inspect.rendezvous.target.model import Target
from safe_inspect.types import AnyArray, FloatArray

#: Half width of a tube below which its gauge is rounding [m].
_LEAST_TUBE = 1e-9


def summarise_mission(
    config: RendezvousConfig, target: Target, mission_log: MissionLog, success: bool, cause: str
) -> dict[str, Any]:
    """Return the summary of a mission.

    Args:
        config: The experiment.
        target: The target.
        mission_log: What was logged.
        success: Whether the chaser has stayed at the mating point, as far as it knows.
        cause: Why the mission has failed.

    Returns:
        ``success``: it has stayed there in truth, and touched nothing; ``cause``, ``time`` [s], ``time_on_approach``
        [s], ``least_clearance`` between the chaser's sphere
        and the target's boxes at all ticks [m], ``mating_position_error`` [m] and ``mating_speed_error`` [m/s] at the
        end, ``delta_v`` [m/s], ``largest_force`` along an axis [N], ``largest_gauge``: the distance from the true
        reference along an axis relative to the tube's half width, ``plans`` that were made, ``planning_time`` [s],
        ``worst_status`` of the tracker, ``attitude_error`` of the target's estimate, its largest [rad],
        ``tumble_axis`` that the target turns about (0: at a constant rate), ``tumble_rate`` at the start [rad/s],
        ``detail``: why the last plan or tube was refused; null without.
    """
    arrays = mission_log.arrays()
    mission = config.mission
    moves = (arrays["state"] == list(Phase).index(Phase.TRACK)) | (arrays["state"] == list(Phase).index(Phase.MP_HOLD))
    plans = [event["data"] for event in mission_log.events if event["event"] == "plan"]
    position, speed = _mating_error(arrays, target.mating_point)
    gauge = _gauge(arrays, moves)
    clearance = float(arrays["clearance"].min())
    if clearance <= 0.0:
        success, cause = False, f"contact with the target{f' ({cause})' if cause else ''}"
    elif success and not (position[-1] <= mission.hold_position and speed[-1] <= mission.hold_speed):
        success, cause = False, "the estimate was at the mating point, and the chaser was not"
    difference = log(multiply(conjugate(arrays["target_q"]), arrays["estimated_target_q"]))
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
        "worst_status": int(arrays["status"][moves].max()) if moves.any() else None,
        "attitude_error": float(np.linalg.norm(difference, axis=1).max()),
        "tumble_axis": int(classify(target.principal, arrays["target_w"][:1]).axis[0]),
        "tumble_rate": float(np.linalg.norm(arrays["target_w"][0])),
        "detail": "" if success else _last_refusal(mission_log),
        "escape_missing": sum(event["event"] == "no_escape" for event in mission_log.events),
    }


def _last_refusal(mission_log: MissionLog) -> str:
    """Return why the last plan or tube was refused; empty where it was not."""
    for event in reversed(mission_log.events):
        if event["event"] in ("plan", "tube"):
            data = event["data"]
            return str(data.get("message") or data.get("refusal") or "")
    return ""


def _mating_error(arrays: dict[str, AnyArray], mating_point: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the errors of position [m] and velocity [m/s] relative to the true mating point, at every step."""
    q, w, x = arrays["target_q"], arrays["target_w"], arrays["x"]
    point = np.broadcast_to(mating_point, w.shape)
    return (
        np.linalg.norm(x[:, :3] - rotate(q, point), axis=1),
        np.linalg.norm(x[:, 3:] - rotate(q, np.cross(w, point)), axis=1),
    )


def _gauge(arrays: dict[str, AnyArray], moves: AnyArray) -> float | None:
    """Return the largest distance to nominal motion about the true reference, relative to the tube's half width."""
    tube = arrays["tube"][moves]
    if not len(tube) or not np.isfinite(tube).all():
        return None
    distance = np.abs(arrays["x"][moves, :3] - nominal_path(arrays)[moves]).max(axis=1)
    wide = tube > _LEAST_TUBE
    return float((distance[wide] / tube[wide]).max()) if wide.any() else None


def nominal_path(arrays: dict[str, AnyArray]) -> FloatArray:
    """Return the true reference plus the nominal error z: what the tube is about, in W [m], shape (K, 3).

    The reference of the log follows the estimate; in T it is the plan, which the true attitude moves.

    Args:
        arrays: The arrays of a log.
    """
    relative = arrays["reference"][:, :3] - arrays.get("estimated_target_p", np.zeros(3))
    in_target = rotate(conjugate(arrays["estimated_target_q"]), relative)
    return np.asarray(rotate(arrays["target_q"], in_target) + arrays["z"][:, :, 0])
