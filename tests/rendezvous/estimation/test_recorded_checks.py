"""Jumps of biases, expected motions and checks of estimates on fixed inputs match the record.

A change that is meant to change them has to update the record:

    RECORD_RENDEZVOUS=1 python -m pytest -n 0 tests/rendezvous/estimation/test_recorded_checks.py
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from safe_inspect.dynamics.quaternion import conjugate, exp, multiply
from safe_inspect.missions.summary import attitude_error, normalised_error
from safe_inspect.random.streams import Streams
from safe_inspect.rendezvous.estimate import BodyState, EstimateErrors, JointErrors, StateEstimate, unknown_estimate
from safe_inspect.rendezvous.estimation.change import (
    ActuatorResponse,
    BiasJumps,
    ExpectedMotion,
    centre_innovation,
    departs,
)
from safe_inspect.rendezvous.estimation.factors import ImuBuffer
from safe_inspect.rendezvous.estimation.graph import ISAM2BackEnd, PoseGraph
from safe_inspect.rendezvous.estimation.states import CentrePrior, ChaserStart, TargetEstimate
from safe_inspect.rendezvous.inertial_unit import ImuNoise, InertialSample
from safe_inspect.rendezvous.measured_poses import PoseSensor, PoseSensorRun
from safe_inspect.rendezvous.models import ActuatorConfig, ChaserConfig
from safe_inspect.rendezvous.poses import perturbed, pose
from safe_inspect.rendezvous.readings import Command
from safe_inspect.rendezvous.target.boxes import EnvisatTarget
from safe_inspect.testing.rendezvous import watched_poses

from ..record import check

RECORD = Path(__file__).with_name("checks.json")
_R_WB = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
_START = ChaserStart(pose(_R_WB, np.array([0.0, -1.5, 0.0])), np.zeros(3))
_STREAMS = Streams(7, np.zeros(1, np.int64), np.zeros(1, np.int64))
_SIGMAS = np.repeat([2e-3, 2e-4, 1e-2], [3, 3, 2])


def _jumps() -> Any:
    jumps, random, found = BiasJumps(ImuNoise()), np.random.default_rng(3), []
    rate = np.zeros(3)
    for k in range(24):
        expected = ExpectedMotion(random.normal(size=6) * np.repeat([0.01, 0.05], 3), np.array([2e-4, 1e-4]))
        jumped = np.repeat([0.02, 6e-4], 3) * (8 <= k < 18)
        rate = rate + 0.2 * expected.mean[3:]
        samples = [
            InertialSample(
                0.016 * n, expected.mean[:3] + jumped[:3], rate - (0.2 - 0.016 * n) * expected.mean[3:] + jumped[3:]
            )
            for n in range(1, 12 + k % 2)
        ]
        one = jumps.check(() if k == 12 else samples, expected, np.full(3, 1e-4), 0.2)
        found.append(None if one is None else [one.offset, one.sigma, one.within])
        if k == 15:
            jumps.settle()
    return found


def _responses() -> Any:
    found = []
    for own in (
        ActuatorConfig(),
        ActuatorConfig(scale_error=-0.05, lag=0.3),
        ActuatorConfig(force_noise=2e-3, torque_noise=3e-4),
    ):
        response = ActuatorResponse(ChaserConfig(actuator=own), 0.2)
        for k in range(3):
            command = Command(np.array([0.1, -0.02, 0.05 * k]), np.array([0.01, 0.0, -0.004 * k]))
            found.append([*response.step(np.array([0.02, 0.1, -0.05]), command)])
    return found


def _checks() -> Any:
    level = np.array([0.0, 0.0, 0.0, 1.0])
    known = TargetEstimate(
        0.0,
        level,
        np.array([0.07, 0.03, 0.05]),
        np.array([0.13, 0.97]),
        level,
        np.diag(_SIGMAS**2),
        2e-3,
        True,
        True,
        1.0,
        1.0,
        (0.0, 1.0),
    )
    times = np.arange(20.0, 25.0)
    predicted = known.predict(times)[0]
    axis, departures = np.array([0.6, 0.0, 0.8]), []
    for scale in np.geomspace(0.02, 0.4, 12):
        turned = multiply(predicted, np.tile(exp(scale * axis), (5, 1)))
        faster = multiply(predicted, exp(0.4 * scale * (times - 19.0)[:, None] * axis))
        late = multiply(predicted, exp(scale * np.array([0.0, 1.0, 1.0, 1.0, 0.2])[:, None] * axis))
        loose = replace(known, recent_misfit=2.5)
        departures.append(
            [departs(known, times, one, 0.004) for one in (turned, faster, late)]
            + [departs(loose, times, turned, 0.01), departs(known, times[:2], turned[:2], 0.004)]
        )
    root = np.random.default_rng(6).normal(size=(14, 14))
    joint = JointErrors(0.1, 0.1, joint=1e-3 * root @ root.T)
    chaser = BodyState(np.array([0.1, -1.5, 0.2]), np.zeros(3), exp(np.array([0.1, 0.4, -0.2])), np.zeros(3))
    body = BodyState(np.zeros(3), np.zeros(3), exp(np.array([-0.3, 0.1, 0.2])), np.array([0.05, 0.02, -0.03]))
    seen = body._replace(orientation=multiply(body.orientation, exp(np.array([0.02, -0.01, 0.03]))))
    estimate = StateEstimate(
        1.0,
        1.0,
        chaser._replace(orientation=conjugate(chaser.orientation)),
        seen,
        np.array([0.1, 0.9, 1.0]),
        joint,
        0.9,
    )
    graph = PoseGraph(
        ImuBuffer(ImuNoise(), 0.1), _START, CentrePrior(np.zeros(3), 0.3), ISAM2BackEnd(largest=50, memory=1.0)
    )
    run = PoseSensorRun(PoseSensor(), _STREAMS)
    steps = [run.measure(k, at, in_view=True) for k, at in enumerate(watched_poses(EnvisatTarget()(), 5))]
    for k, edges in enumerate(steps[:4]):
        if k:
            graph.imu.add(np.full(3, 1e-3), np.zeros(3), 1.0)
            graph.update(k, edges)
    moved, unknown = perturbed(_START.pose, np.full(6, 0.02)), unknown_estimate(2.0, 1.0, chaser, np.ones(3), 0.5)
    return {
        "departures": departures,
        "errors": [
            attitude_error(estimate, chaser, body),
            normalised_error(estimate, chaser, body),
            normalised_error(replace(estimate, errors=EstimateErrors(0.1, 0.1)), chaser, body),
        ],
        "innovations": [
            [centre_innovation(graph.estimate(), at, one) for one in steps[4]] for at in (_START.pose, moved)
        ],
        "unknown": [
            *unknown.target,
            *vars(unknown.errors).values(),
            unknown.problem,
            unknown.alarm,
            unknown.updated,
            unknown.translation,
            unknown.relative,
            unknown.correlation,
            unknown.mismatch,
        ],
    }


PIECES: dict[str, Callable[[], Any]] = {"jumps": _jumps, "responses": _responses, "checks": _checks}


@pytest.mark.parametrize("name", PIECES)
def test_checks_match_the_record(name: str) -> None:
    check(RECORD, name, PIECES[name](), tolerance=1e-3)
