"""Estimation from a sensor log with the pipeline of a mission, but without a simulator."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from threadpoolctl import threadpool_limits

from safe_inspect.dynamics.quaternion import conjugate, log, multiply
from safe_inspect.errors import ConfigError
from safe_inspect.random.streams import Streams
from safe_inspect.rendezvous.back_end.isam2 import ISAM2BackEnd
from safe_inspect.rendezvous.back_end.states import ChaserStart, GraphEstimate
from safe_inspect.rendezvous.characterise.history import History, TargetEstimate
from safe_inspect.rendezvous.characterise.motion import PolhodeCharacteriser
from safe_inspect.rendezvous.edges import Edge
from safe_inspect.rendezvous.estimation.pipeline import EstimationPipeline, PipelineParts
from safe_inspect.rendezvous.front_end.context import FrontEnd, FrontEndContext, FrontEndRun
from safe_inspect.rendezvous.recording.reader import SensorLog
from safe_inspect.rendezvous.sensors.tof import DepthFrame
from safe_inspect.rendezvous.target.model import Target
from safe_inspect.types import FloatArray

#: Columns of `LogEstimate.online`: the estimate after each frame.
ONLINE_COLUMNS = (
    "time", "points", "edges", "q_WT_x", "q_WT_y", "q_WT_z", "q_WT_w", "rate_x", "rate_y", "rate_z",
    "attitude_sigma", "rate_sigma", "k1", "k2", "centre_x", "centre_y", "centre_z", "centre_sigma",
)  # fmt: skip


@dataclass(frozen=True)
class Estimators:
    """The plugins of the estimation pipeline.

    Attributes:
        front_end: Computes relative poses from frames.
        back_end: Estimates states from relative poses and inertial samples.
        characteriser: Estimates the target's motion from the history.
    """

    front_end: FrontEnd
    back_end: ISAM2BackEnd
    characteriser: PolhodeCharacteriser


@dataclass(frozen=True, eq=False)
class LogEstimate:
    """The estimate from a log.

    Attributes:
        online: The estimate after each frame, in the columns `ONLINE_COLUMNS`, NaN if unknown, shape (n, 18).
        target: The target's motion, estimated from all frames.
        graph: The states of the factor graph after the last frame.
        chaser_positions: Positions of the chaser in W, as estimated after each frame [m], shape (n, 3).
        history: Attitudes of the frames, and the edges.
        edges: All edges.
        target_model: The known target; None if its shape is unknown.
    """

    online: FloatArray
    target: TargetEstimate
    graph: GraphEstimate
    chaser_positions: FloatArray
    history: History
    edges: tuple[Edge, ...]
    target_model: Target | None

    def attitudes(self, times: FloatArray) -> FloatArray:
        """Return q_WT of the estimated motion at times [s], shape (n, 4)."""
        return self.target.predict(times)[0]

    def attitude_error(self, times: FloatArray, truth: FloatArray) -> FloatArray:
        """Return the angle between the estimated and the true q_WT [rad], shape (n,).

        If no pose to the model determines the directions of the axes, there are four choices that differ by half a turn
        about an axis. The choice with the smallest median error is used for all times.

        Args:
            times: Times [s], shape (n,).
            truth: True q_WT, shape (n, 4).
        """
        found = self.attitudes(times)
        choices = np.eye(4)[3:] if self.target.aligned else np.eye(4)
        errors = [
            np.linalg.norm(
                log(multiply(conjugate(truth), multiply(found, np.broadcast_to(choice, found.shape)))), axis=1
            )
            for choice in choices
        ]
        return min(errors, key=lambda error: float(np.median(error)))


class _Recorder:
    """A front end that stores all of its edges and the number of the newest ones."""

    def __init__(self, run: FrontEndRun) -> None:
        self._run = run
        self.edges: list[Edge] = []
        self.newest = 0

    def step(self, frame: DepthFrame, predicted: FloatArray | None, rotation: FloatArray) -> list[Edge]:
        edges = self._run.step(frame, predicted, rotation)
        self.edges += edges
        self.newest = len(edges)
        return edges


def estimate_log(
    log_: SensorLog, estimators: Estimators, target: Target | None, progress: Callable[[int, int], None] | None = None
) -> LogEstimate:
    """Estimate the motion of chaser and target from a log. The linear algebra runs in one thread, as in a mission.

    Args:
        log_: The log.
        estimators: The plugins of the estimation pipeline.
        target: The target if its shape and inertia are known, else None.
        progress: Called after each frame with the number of frames that are done and the number of all frames.

    Raises:
        ConfigError: The motion of the target cannot be determined from the log.
    """
    with threadpool_limits(limits=1, user_api="blas"):
        return _estimate(log_, estimators, target, progress)


def _estimate(
    log_: SensorLog, estimators: Estimators, target: Target | None, progress: Callable[[int, int], None] | None
) -> LogEstimate:
    streams = Streams(0, np.zeros(1, np.int64), np.zeros(1, np.int64))
    camera, T_BC = log_.description.camera.geometry, log_.T_BC  # noqa: N806
    recorder = _Recorder(estimators.front_end(FrontEndContext(camera, T_BC, target, streams)))
    period = float(np.median(np.diff(log_.imu[:, 0]))) if len(log_.imu) > 1 else 1.0
    parts = PipelineParts(
        front_end=recorder,
        back_end=lambda start, centre: estimators.back_end(log_.description.imu, period, start, centre),
        characterise=estimators.characteriser,
        target=target,
        T_BC=T_BC,
        imu=log_.description.imu,
    )
    pipeline = EstimationPipeline(parts, ChaserStart(*log_.start))
    online, positions, before = [], [], float(log_.times[0])
    for done, (frame, samples) in enumerate(log_.steps()):
        for row in samples:
            pipeline.measure(row[1:4], row[4:7], float(row[0]) - before)
            before = float(row[0])
        pipeline.see(frame)
        positions.append(pipeline.now()[0][:3, 3].copy())
        online.append(_row(pipeline, frame, recorder.newest))
        if progress is not None:
            progress(done + 1, len(log_))
    if pipeline.graph is None or pipeline.target is None:
        seen = sum(row[2] > 0 for row in online)
        raise ConfigError(
            f"{log_.folder}: the motion of the target could not be determined; {seen} of {len(log_)} frames gave a "
            "relative pose. Check the unit and sign of depths and rates and the camera's orientation, or record longer"
        )
    edges = tuple(recorder.edges)
    return LogEstimate(
        np.array(online), pipeline.target, pipeline.graph, np.array(positions), pipeline.history(), edges, target
    )


def _row(pipeline: EstimationPipeline, frame: DepthFrame, edges: int) -> FloatArray:
    graph, found = pipeline.graph, pipeline.target
    row = np.full(len(ONLINE_COLUMNS), np.nan)
    row[:3] = frame.time, len(frame.points), edges
    if found is not None:
        q, w = found.predict(np.array([frame.time]))
        row[3:7], row[7:10] = q[0], w[0]
        row[10] = np.sqrt(np.linalg.eigvalsh(found.covariance[:3, :3])[-1])
        row[11] = np.sqrt(np.linalg.eigvalsh(found.covariance[3:6, 3:6])[-1])
        row[12:14] = found.ratios
    if graph is not None:
        row[14:17] = graph.centre
        row[17] = np.sqrt(np.linalg.eigvalsh(graph.centre_covariance)[-1])
    return row


def measured_rates(estimate: LogEstimate) -> tuple[FloatArray, FloatArray]:
    """Return the middles of intervals of about 5 s [s], shape (n,), and their mean rates in T [rad/s], shape (n, 3)."""
    times, q_WG = estimate.history.in_inertial  # noqa: N806
    q_WT = multiply(q_WG, np.broadcast_to(estimate.target.q_GT, q_WG.shape))  # noqa: N806
    last = np.minimum(np.searchsorted(times, times + 5.0), len(times) - 1)
    first = np.arange(len(times))
    kept = times[last] - times[first] > 2.0
    first, last = first[kept], last[kept]
    seconds = (times[last] - times[first])[:, None]
    return 0.5 * (times[first] + times[last]), log(multiply(conjugate(q_WT[first]), q_WT[last])) / seconds
