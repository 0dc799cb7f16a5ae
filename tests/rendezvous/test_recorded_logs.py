"""Whole logs of short missions match the record: every array, event and figure of the summary.

A change that is meant to change missions has to update the record:

    RECORD_RENDEZVOUS=1 python -m pytest -n 0 tests/rendezvous/test_recorded_logs.py
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from threadpoolctl import threadpool_limits

from safe_inspect.config.data import configs_root
from safe_inspect.missions.mission import Mission
from safe_inspect.rendezvous.experiment import load_rendezvous

from .record import check

RECORD = Path(__file__).with_name("logs.json")
_QUICK = ("mission.observe=1 s", "mission.checkout=0.4 s", "mission.wait_limit=0 s", "mission.hold=1 s")
_ERRORS = ("sensors.state={attitude_sigma: 0.5 deg, rate_sigma: 0.05 deg/s, correlation: 0.7}",)
_ACTUATOR = "chaser.actuator={scale_error: 0.04, lag: 0.3 s, force_noise: 2 mN, torque_noise: 0.0002 N m}"
_POSES = (
    "seed=5", "estimator.config.front_end=MeasuredPoses", "mission.wait_limit=5 s", "mission.observe=28 s",
    "sensors.poses={model_rotation: 0.25 deg, model_translation: 2 mm}",
)  # fmt: skip
#: Each mission: its experiment, its overrides and its number.
MISSIONS: dict[str, tuple[str, tuple[str, ...], int]] = {
    "a planner that fails at first": (
        "experiment-truth.yml",
        (*_QUICK, *_ERRORS, "mission.durations=[45 s, 60 s]",
         "mission.faults=[{kind: planner, start: 1 s, duration: 1.5 s}]"),
        2,
    ),
    "a camera that fails on the way": (
        "experiment-truth.yml",
        (*_QUICK, *_ERRORS, _ACTUATOR, "mission.departure_limit=8 s",
         "mission.faults=[{kind: camera, start: 15 s, duration: 900 s}]"),
        2,
    ),
    "a camera that fails for a while": (
        "experiment-truth.yml",
        (*_QUICK, *_ERRORS, "mission.durations=[45 s, 60 s]", "mission.time_limit=50 s",
         "mission.faults=[{kind: camera, start: 10 s, duration: 8 s}]"),
        2,
    ),
    "an orbit": ("experiment-orbit.yml", (*_QUICK, "mission.time_limit=30 s"), 1),
    "other plugins": (
        "experiment-truth.yml",
        (*_QUICK, "tracker={functor: LQRTracker}", "tumble={functor: RandomTumble}", "chaser.limits.cone=60 deg",
         "mission.time_limit=25 s"),
        3,
    ),
    "a target that is struck": (
        "experiment.yml",
        (*_POSES, "mission.time_limit=62 s", "mission.faults=[{kind: tumble, start: 40 s, duration: 1 s}]"),
        1,
    ),
    "sensors that fail": (
        "experiment.yml",
        (*_POSES, _ACTUATOR, "mission.time_limit=34 s",
         "mission.faults=[{kind: imu_bias, start: 12 s, duration: 30 s}, {kind: imu, start: 20 s, duration: 0.4 s}, "
         "{kind: camera, start: 24 s, duration: 4 s}]"),
        1,
    ),
}  # fmt: skip


def _flown(name: str) -> dict[str, Any]:
    file, overrides, number = MISSIONS[name]
    mission = Mission(load_rendezvous(configs_root() / "tumbling-rendezvous" / file, overrides).config, number)
    result = mission.run()
    events = [
        [event["t"], event["state"], event["event"], {k: v for k, v in event["data"].items() if k != "seconds"}]
        for event in result.log.events
    ]
    summary = {key: value for key, value in result.summary.items() if key != "planning_time"}
    return {"summary": summary, "events": events, "arrays": result.log.arrays()}


@pytest.mark.parametrize("name", MISSIONS)
def test_the_log_of_a_mission_matches_the_record(name: str) -> None:
    with threadpool_limits(limits=1, user_api="blas"):
        check(RECORD, name, _flown(name))
