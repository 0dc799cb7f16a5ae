"""Results of the back end, of the fits of motions and of the checks about them match the record.

A change that is meant to change them has to update the record:

    RECORD_RENDEZVOUS=1 python -m pytest -n 0 tests/rendezvous/estimation/test_recorded_estimates.py
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from safe_inspect.dynamics.quaternion import exp, from_matrix, multiply
from safe_inspect.random.streams import Streams
from safe_inspect.rendezvous.estimation.change import covariance_at
from safe_inspect.rendezvous.estimation.characteriser import (
    KnownBody,
    PolhodeCharacteriser,
    angular_velocities,
    principal_axes_of_motion,
)
from safe_inspect.rendezvous.estimation.factors import BiasJump, ImuBuffer
from safe_inspect.rendezvous.estimation.graph import ISAM2BackEnd, PoseGraph
from safe_inspect.rendezvous.estimation.states import (
    CentrePrior,
    ChaserStart,
    History,
    Motion,
    TargetEstimate,
    inertia_of,
    logits_of,
    ratios_of,
)
from safe_inspect.rendezvous.inertial_unit import ImuNoise
from safe_inspect.rendezvous.measured_poses import PoseSensor, PoseSensorRun
from safe_inspect.rendezvous.poses import MODEL, Edge, inverse, perturbed, pose
from safe_inspect.rendezvous.target.boxes import EnvisatTarget
from safe_inspect.testing.rendezvous import watched_poses
from safe_inspect.types import FloatArray

from ..record import check

RECORD = Path(__file__).with_name("estimates.json")
_TARGET = EnvisatTarget()()
_R_WB = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
_START = ChaserStart(pose(_R_WB, np.array([0.0, -1.5, 0.0])), np.zeros(3))
_STREAMS = Streams(7, np.zeros(1, np.int64), np.zeros(1, np.int64))


def _steps(sensor: PoseSensor, frames: int) -> list[tuple[Edge, ...]]:
    """Return the edges to each frame of a chaser at rest that watches a tumble, one frame a second."""
    run = PoseSensorRun(sensor, _STREAMS)
    return [run.measure(k, at, in_view=k != 6) for k, at in enumerate(watched_poses(_TARGET, frames))]


def _graphs() -> Any:
    """Return what graphs know after every frame: with the older half eliminated, jumps, and silence of the unit."""
    found = {}
    for name, sensor, largest, memory, late in (
        ("model", PoseSensor(), 12, 2.0, 0),
        ("odometry", PoseSensor(model=False), 600, 0.0, 0),
        ("model that comes late", PoseSensor(skips=1), 10, 0.0, 9),
    ):
        random, noise = np.random.default_rng(1), ImuNoise(acceleration=4e-3, rate_walk=1e-5)
        graph = PoseGraph(
            ImuBuffer(noise, 0.1),
            _START,
            CentrePrior(np.full(3, 0.02), 0.3),
            ISAM2BackEnd(largest=largest, memory=memory),
        )
        rows: list[Any] = []
        for k, edges in enumerate(_steps(sensor, 26)[1:], 1):
            if k == 15:
                graph.imu.coast(1.0, np.array([1e-3, 0.0, -1e-3, 0.0, 2e-4, 0.0]))
            for _ in range(0 if k in (15, 21) else 10):
                graph.imu.add(2e-3 * random.normal(size=3), 2e-4 * random.normal(size=3), 0.1)
            if k == 18:
                graph.imu.correct(BiasJump(np.repeat([2e-3, 1e-4], 3), np.array([1e-3, 5e-5]), 0.4))
                graph.imu.add(np.full(3, 2e-3), np.full(3, 1e-4), 0.1)
            now, rotation = graph.now(), graph.imu.rotation
            used = [one for one in edges if k >= late or one.first != MODEL]
            if late and k in (late, late + 1):
                used = [one for one in edges if one.first == MODEL and k == late]
            graph.update(k, used, jumped=k == 20)
            known = graph.estimate()
            if k % 4 and k not in (10, 15, 18, 21):
                continue
            rows.append(
                [
                    *now,
                    rotation,
                    known.frame,
                    known.chaser,
                    known.velocity,
                    known.bias,
                    known.relative,
                    known.centre,
                    known.centre_glued,
                    known.model,
                    known.chaser_covariance,
                    known.velocity_covariance,
                    known.centre_covariance,
                    list(graph.frames),
                ]
            )
        found[name] = [rows, graph.chaser_poses(), graph.chaser_poses(2), *graph.relative_poses().values()]
    return found


def _history(sensor: PoseSensor, frames: int) -> tuple[History, FloatArray]:
    """Return a history of a chaser at rest, G being B at the first frame, and q_GM."""
    poses = watched_poses(_TARGET, frames)
    edges = [edge for step in _steps(sensor, frames) for edge in step]
    random = np.random.default_rng(2)
    glued = [
        from_matrix(perturbed(inverse(poses[0]) @ at, np.r_[2e-3 * random.normal(size=3), 0, 0, 0])[:3, :3])
        for at in poses
    ]
    chaser = np.tile(from_matrix(_R_WB), (frames, 1))
    history = History.of(np.arange(float(frames)), chaser, np.array(glued), edges, range(frames))
    return history, from_matrix(inverse(poses[0])[:3, :3])


def _between(self: History, start: float, end: float) -> History:
    """Return the history of the frames from a start to an end [s], both included, with the edges between them."""
    kept = np.flatnonzero((self.times >= start - 1e-9) & (self.times <= end + 1e-9))
    place = np.full(len(self.times) + 1, -2)
    place[kept], place[MODEL] = np.arange(len(kept)), MODEL
    first, second = place[self.first], place[self.second]
    used = (first > -2) & (second > -2)
    return History(
        self.times[kept], self.chaser[kept], self.glued[kept],
        first[used], second[used], self.rotation[used], self.covariance[used],
    )  # fmt: skip


def _estimate(found: TargetEstimate | None) -> Any:
    if found is None:
        return None
    return [
        found.time,
        found.orientation,
        found.angular_velocity,
        found.ratios,
        found.q_GT,
        found.covariance,
        found.axes_sigma,
        found.observable,
        found.aligned,
        found.misfit,
        found.recent_misfit,
        found.singular,
        *found.predict(np.array([found.time + 3.0, 0.0])),
    ]


def _motions() -> Any:
    characteriser, found = PolhodeCharacteriser(), {}
    for name, sensor, frames in (("model", PoseSensor(), 36), ("odometry", PoseSensor(model=False), 28)):
        history, model = _history(sensor, frames)
        known = KnownBody.of(_TARGET)
        first = characteriser(history, known, model=model if name == "model" else None)
        assert first is not None
        before = Motion(
            first.time,
            multiply(first.orientation, exp(np.full(3, 0.01))),
            first.angular_velocity,
            logits_of(first.ratios) + 0.1,
        )
        plain = PolhodeCharacteriser(span=2.0, window=8.0, telescoping=0.0, memory=0.0, drift=0.0)
        found[name] = [
            _estimate(first),
            _estimate(characteriser(history, known, before, model)),
            _estimate((plain if name == "model" else characteriser)(_between(history, 4.0, 26.0), KnownBody())),
            _estimate(characteriser(_between(history, 0.0, 6.0), known)),
            covariance_at(first, 80.0),
        ]
        middle, rates = angular_velocities(*history.in_inertial, 1.0, 6.0)
        shown = principal_axes_of_motion(middle, rates)
        found[f"rates, {name}"] = [
            middle,
            rates,
            shown.axes,
            shown.ratios,
            shown.singular,
            shown.observable,
            *angular_velocities(*history.in_inertial, 2.5, 0.0),
            history.first,
            history.second,
            history.rotation,
            history.covariance,
            _between(history, 3.0, 9.0).first,
            history.without(history.second > 20).second,
        ]
    logits = np.array([[-30.0, 2.0], [0.3, -0.7], [9.0, 40.0]])
    return found | {
        "logits": [
            ratios_of(logits),
            inertia_of(logits),
            logits_of(ratios_of(logits)),
            logits_of(np.array([[0.2, 0.9], [0.7, 0.6], [0.4, 0.4]])),
        ]
    }


PIECES: dict[str, Callable[[], Any]] = {"graphs": _graphs, "motions": _motions}


@pytest.mark.parametrize("name", PIECES)
def test_estimates_match_the_record(name: str) -> None:
    with threadpool_limits(limits=1, user_api="blas"):
        check(RECORD, name, PIECES[name]())
