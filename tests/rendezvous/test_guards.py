"""What each guard says on both sides of its limit."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from safe_inspect.rendezvous.coordination import guards
from safe_inspect.rendezvous.coordination.context import Phase

_MISSION = {
    "checkout": 2.0, "checkout_limit": 10.0, "observe": 20.0, "observe_limit": 50.0, "attitude_sigma": 0.05,
    "rate_sigma": 0.002, "attempts": 2, "plan_attempts": 3, "bound_attempts": 6, "hold": 5.0, "hold_limit": 20.0,
    "hold_position": 0.03, "camera_silence": 5.0, "imu_silence": 0.2, "retreat_limit": 120.0, "departure_limit": 60.0,
    "time_limit": 900.0, "update_period": 1.0, "length": 2.0, "planning_time": 2.0,
}  # fmt: skip
_CONTEXT = {
    "time": 100.0, "elapsed": 5.0, "phase": Phase.TRACK, "camera_time": 100.0, "imu_time": 100.0, "planned_at": 90.0,
    "plan_failures": 0, "bound_failures": 0, "on_approach": False, "attempts": 1, "outside": 0.0,
    "reference_problem": "", "replans": 0, "settled_since": 90.0, "poses": 9,
    "awaits_poses": True, "push": np.zeros(3),
    "plan": SimpleNamespace(solved=True, t_start=99.0, duration=60.0), "design": SimpleNamespace(accepted=True),
    "clearance": 0.5,
}  # fmt: skip
_ESTIMATE = {
    "updated": 99.0, "alarm": "", "problem": "", "mismatch": 0.01, "attitude": 0.01, "rate": 0.001,
    "position": np.array([0.0, -2.9, 0.0]), "velocity": np.zeros(3), "angular_velocity": np.full(3, 0.1),
    "orientation": np.array([0.0, 0.0, 0.0, 1.0]),
}  # fmt: skip


def _context(**changes: Any) -> Any:
    """Return the memory of a mission in which nothing fails, with changes of it, its configuration or its estimate."""
    own, estimate, mission = dict(_CONTEXT), dict(_ESTIMATE), dict(_MISSION)
    silent, keep_in = changes.pop("silent", frozenset()), changes.pop("keep_in", np.array([0.8, 3.0, 0.8]))
    for name, value in changes.items():
        next(place for place in (own, estimate, mission) if name in place)[name] = value
    clearance, state = own.pop("clearance"), np.concatenate([estimate["position"], estimate["velocity"]])
    seen = SimpleNamespace(
        **estimate, errors=SimpleNamespace(attitude=estimate["attitude"], rate=estimate["rate"]), translation=state,
        relative=state, chaser=SimpleNamespace(velocity=estimate["velocity"]),
        target=SimpleNamespace(orientation=estimate["orientation"], angular_velocity=estimate["angular_velocity"]),
    )  # fmt: skip
    return SimpleNamespace(
        **own, config=SimpleNamespace(mission=SimpleNamespace(**mission)), estimate=seen, clearance=lambda: clearance,
        readings=SimpleNamespace(silent=silent), limits=SimpleNamespace(keep_in=keep_in, radius=0.25),
        target=SimpleNamespace(swept_radius=1.0),
    )  # fmt: skip


_FAST = np.array([0.0, 0.0101, 0.0])
#: The safe radius is 1 + 0.25 + 0.3 * 2 m; an escape ends 0.02 * 2 m within it, a place is outside 0.1 * 2 m beyond.
_ESCAPED, _OUTSIDE = 1.85 - 0.04, 1.45


def _at(distance: float) -> np.ndarray:
    return np.array([0.0, -distance, 0.0])


CASES: list[tuple[str, dict[str, Any], bool]] = [
    ("always", {}, True),
    ("checked_out", {"elapsed": 2.0}, True), ("checked_out", {"elapsed": 1.99}, False),
    ("checked_out", {"camera_time": 99.0}, True), ("checked_out", {"camera_time": 98.9}, False),
    ("checked_out", {"imu_time": 99.8}, False),
    ("checkout_too_long", {"elapsed": 10.0}, True), ("checkout_too_long", {"elapsed": 9.9}, False),
    ("fault", {}, False), ("fault", {"clearance": -0.001}, True), ("fault", {"clearance": 0.0}, False),
    ("unseen", {"updated": 94.0}, False), ("unseen", {"updated": 93.9}, True),
    ("unseen", {"camera_time": 95.0}, False), ("unseen", {"camera_time": 94.9}, True),
    ("unseen", {"camera_time": -np.inf, "time": 5.0, "updated": 0.0}, False),
    ("unseen", {"camera_time": -np.inf, "time": 5.1, "updated": 5.0}, True),
    ("out_of_time", {"time": 900.0}, True), ("out_of_time", {"time": 899.9}, False),
    ("observed", {"elapsed": 20.0}, True), ("observed", {"elapsed": 19.9}, False),
    ("observed", {"elapsed": 20.0, "attitude": 0.05, "rate": 0.002}, True),
    ("observed", {"elapsed": 20.0, "attitude": 0.0501}, False), ("observed", {"elapsed": 20.0, "rate": 0.0021}, False),
    ("observed", {"elapsed": 20.0, "alarm": "changed"}, False),
    ("observed_at_most", {"elapsed": 50.0}, True), ("observed_at_most", {"elapsed": 49.9}, False),
    ("characterised", {}, True), ("characterised", {"problem": "unknown"}, False),
    ("characterised", {"angular_velocity": np.array([0.1, np.nan, 0.0])}, False),
    ("may_observe_again", {}, True), ("may_observe_again", {"attempts": 2}, False),
    ("may_observe_again", {"on_approach": True}, False),
    ("may_observe_again", {"time": 900.0}, False),
    ("plan_found", {}, True), ("plan_found", {"plan": None}, False),
    ("plan_found", {"plan": SimpleNamespace(solved=False)}, False), ("plan_found", {"planned_at": 100.1}, False),
    ("plan_found", {"planned_at": 100.0}, True), ("plans_exhausted", {"on_approach": True, "planned_at": 100.1}, False),
    ("plans_exhausted", {"plan_failures": 2}, False), ("plans_exhausted", {"plan_failures": 3}, True),
    ("plans_exhausted", {"on_approach": True}, True),
    ("estimate_is_new", {}, True), ("estimate_is_new", {"planned_at": 99.0}, False),
    ("tube_fits", {}, True), ("tube_fits", {"design": None}, False),
    ("tube_fits", {"design": SimpleNamespace(accepted=False)}, False),
    ("may_bound_again", {"bound_failures": 5}, True), ("may_bound_again", {"bound_failures": 6}, False),
    ("start_is_near", {}, True), ("start_is_near", {"plan": None}, False), ("start_is_near", {"time": 97.0}, True),
    ("start_is_near", {"time": 96.9}, False),
    ("start_is_planned", {}, False), ("start_is_planned", {"planned_at": 100.0}, True),
    ("start_is_planned", {"planned_at": 98.9, "time": 98.9}, False),
    ("arrived", {"time": 159.0}, True), ("arrived", {"time": 158.9}, False), ("arrived", {"plan": None}, False),
    ("off_plan", {}, False), ("off_plan", {"outside": 0.0199}, False), ("off_plan", {"outside": 0.0201}, True),
    ("off_plan", {"reference_problem": "beyond"}, True),
    ("may_replan", {"outside": 0.03, "replans": 9}, True), ("may_replan", {"outside": 0.03, "replans": 10}, False),
    ("may_replan", {}, False),
    ("settled", {"settled_since": 95.0}, True), ("settled", {"settled_since": 95.1}, False),
    ("settled", {"settled_since": None}, False), ("settled", {"mismatch": 0.03}, True),
    ("settled", {"mismatch": 0.031}, False),
    ("hold_too_long", {"elapsed": 20.0}, True), ("hold_too_long", {"elapsed": 19.9}, False),
    ("escaped", {}, True), ("escaped", {"position": _at(_ESCAPED + 1e-6)}, True),
    ("escaped", {"position": _at(_ESCAPED - 1e-6)}, False), ("escaped", {"velocity": _FAST}, False),
    ("escaped", {"velocity": 0.99 * _FAST}, True), ("escaped", {"position": _at(3.01)}, False),
    ("escaped", {"position": _at(3.01), "keep_in": np.full(3, np.inf)}, True),
    ("escaped", {"position": _at(3.0)}, True),
    ("unseen_outside", {"updated": 90.0, "position": _at(_OUTSIDE)}, True),
    ("unseen_outside", {"updated": 90.0, "position": _at(_OUTSIDE - 1e-6)}, False), ("unseen_outside", {}, False),
    ("may_return", {}, True), ("may_return", {"velocity": _FAST}, False),
    ("may_return", {"attempts": 2}, False),
    ("may_return", {"time": 900.0, "updated": 900.0}, False), ("may_return", {"silent": frozenset({"imu"})}, False),
    ("retreat_too_long", {"elapsed": 120.0}, True), ("retreat_too_long", {"elapsed": 119.9}, False),
    ("may_resume", {}, True), ("may_resume", {"position": _at(3.1)}, False), ("may_resume", {"poses": 4}, False),
    ("may_resume", {"awaits_poses": False}, False), ("may_resume", {"attempts": 2}, False),
    ("may_resume", {"time": 900.0, "updated": 900.0}, False),
    ("departed", {"elapsed": 60.0}, True), ("departed", {"elapsed": 59.9}, False),
    ("departed", {"awaits_poses": False}, True), ("departed", {"awaits_poses": False, "push": np.full(3, 1e-8)}, False),
    ("departed", {"awaits_poses": False, "push": np.full(3, 5e-10)}, True),
    ("departed", {"elapsed": 60.0, "push": np.full(3, np.nan)}, True),
    ("departed", {"elapsed": 60.0, "push": np.full(3, np.inf)}, True),
    ("sees_target", {"poses": 5}, True), ("sees_target", {"poses": 4}, False), ("sees_target", {"updated": 98.0}, True),
    ("sees_target", {"updated": 97.9}, False), ("sees_target", {"silent": frozenset({"camera"})}, False),
]  # fmt: skip


@pytest.mark.parametrize(("guard", "changes", "holds"), CASES)
def test_a_guard_holds_from_its_limit_on(guard: str, changes: dict[str, Any], holds: bool) -> None:
    assert getattr(guards, guard)(_context(**changes)) is holds


@pytest.mark.parametrize(
    ("changes", "fault"),
    [
        ({}, ""),
        ({"position": np.array([np.nan, 0.0, 0.0])}, "estimate not finite"),
        ({"orientation": np.full(4, np.inf)}, "estimate not finite"),
        ({"imu_time": 99.8}, ""),
        ({"imu_time": 99.7}, "inertial unit silent"),
        ({"imu_time": 90.0, "phase": Phase.CHECKOUT}, ""),
        ({"imu_time": 90.0, "phase": Phase.OBSERVE}, "inertial unit silent"),
        ({"updated": 90.0}, "target not seen"),
        ({"updated": 90.0, "camera_time": 90.0}, "camera silent"),
        ({"alarm": "changed"}, "changed"),
        ({"alarm": "changed", "phase": Phase.OBSERVE}, ""),
        ({"clearance": -0.01}, "no clearance"),
        ({"position": np.array([0.81, -2.0, 0.0])}, "outside of the keep-in box"),
        ({"position": np.array([0.8, -3.0, -0.8])}, ""),
    ],
)
def test_the_first_thing_that_fails_is_named(changes: dict[str, Any], fault: str) -> None:
    context = _context(**changes)
    assert guards.fault_name(context) == fault
    assert guards.fault(context) is bool(fault)
