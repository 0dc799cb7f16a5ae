"""Estimation from a sensor log with the pipeline of a mission, and a mating point given by a pixel."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from threadpoolctl import threadpool_limits

from safe_inspect.dynamics.quaternion import conjugate, log, multiply, to_matrix
from safe_inspect.errors import ConfigError
from safe_inspect.random.streams import Streams
from safe_inspect.rendezvous.estimation.estimators import PipelineEstimator
from safe_inspect.rendezvous.estimation.factors import ImuBuffer
from safe_inspect.rendezvous.estimation.pipeline import EstimationPipeline
from safe_inspect.rendezvous.estimation.states import ChaserStart, GraphEstimate, History, TargetEstimate, largest_sigma
from safe_inspect.rendezvous.front_end.base import FrontEndContext, FrontEndRun
from safe_inspect.rendezvous.poses import Edge, move
from safe_inspect.rendezvous.recording.reader import SensorLog
from safe_inspect.rendezvous.sensors.tof import DepthFrame
from safe_inspect.rendezvous.target.model import Target
from safe_inspect.types import FloatArray

#: Columns of `LogEstimate.online`: the estimate after each frame.
ONLINE_COLUMNS = (
    "time", "points", "edges", "q_WT_x", "q_WT_y", "q_WT_z", "q_WT_w", "rate_x", "rate_y", "rate_z",
    "attitude_sigma", "rate_sigma", "k1", "k2", "centre_x", "centre_y", "centre_z", "centre_sigma",
)  # fmt: skip
#: Half width of the window of pixels to which a surface's normal is fitted, and smallest number of valid pixels in it.
_WINDOW, _LEAST = 3, 8


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


@threadpool_limits.wrap(limits=1, user_api="blas")  # type: ignore[untyped-decorator]
def estimate_log(
    log_: SensorLog,
    estimator: PipelineEstimator,
    target: Target | None,
    progress: Callable[[int, int], None] | None = None,
) -> LogEstimate:
    """Estimate the motion of chaser and target from a log. The linear algebra runs in one thread, as in a mission.

    Args:
        log_: The log.
        estimator: The parts of the estimation pipeline.
        target: The target if its shape and inertia are known, else None.
        progress: Called after each frame with the number of frames that are done and the number of all frames.

    Raises:
        ConfigError: The motion of the target cannot be determined from the log.
    """
    streams = Streams(0, np.zeros(1, np.int64), np.zeros(1, np.int64))
    camera, T_BC = log_.description.camera.geometry, log_.T_BC  # noqa: N806
    period = float(np.median(np.diff(log_.imu[:, 0]))) if len(log_.imu) > 1 else 1.0
    context, noise = FrontEndContext(camera, T_BC, target, streams), log_.description.imu
    recorder = _Recorder(estimator.front_end(context))
    parts = (recorder, estimator.back_end, estimator.characteriser, context)
    pipeline: EstimationPipeline | None = None
    online, positions, before = [], [], float(log_.times[0])
    for done, (frame, samples) in enumerate(log_.steps()):
        for row in samples:
            if pipeline is not None:  # the chaser's start is its state at the first frame
                pipeline.measure(row[1:4], row[4:7], float(row[0]) - before)
            before = float(row[0])
        if pipeline is None:
            pipeline = EstimationPipeline(*parts, ImuBuffer(noise, period), ChaserStart(*log_.start), frame)
        else:
            pipeline.see(frame)
        positions.append(pipeline.now()[0][:3, 3].copy())
        online.append(_row(pipeline, frame, recorder.newest))
        if progress is not None:
            progress(done + 1, len(log_))
    if pipeline is None or pipeline.graph is None or pipeline.target is None:
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
        row[10] = largest_sigma(found.covariance[:3, :3])
        row[11] = largest_sigma(found.covariance[3:6, 3:6])
        row[12:14] = found.ratios
    if graph is not None:
        row[14:17] = graph.centre
        row[17] = largest_sigma(graph.centre_covariance)
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


def pick_point(log: SensorLog, frame: int, column: int, row: int, distance: float) -> FloatArray:
    """Return the point at a distance above the surface that a pixel sees, in B at that frame [m], shape (3,).

    The surface's normal is that of a plane fitted to the surrounding pixels, and points to the side of the camera.

    Args:
        log: The log.
        frame: Number of the frame.
        column: Column of the pixel.
        row: Row of the pixel.
        distance: Distance above the surface [m].

    Raises:
        ConfigError: The pixel does not exist or has no depth, or too few pixels around it see the same surface.
    """
    camera = log.description.camera
    if not (0 <= frame < len(log) and 0 <= column < camera.width and 0 <= row < camera.height):
        size = f"{len(log)} frames of {camera.width} x {camera.height} pixels, counted from 0"
        raise ConfigError(f"{log.folder}: frame {frame}, column {column}, row {row} is not in the log; it has {size}")
    image = log.frame(frame)
    if not image.valid[row, column]:
        raise ConfigError(
            f"{log.files[frame]}: column {column}, row {row} has no depth; pick a pixel of the target, see the figure "
            "that --output writes"
        )
    directions = camera.geometry.directions
    place = directions[row, column] * (image.depth[row, column] / directions[row, column, 2])
    window = np.s_[max(row - _WINDOW, 0) : row + _WINDOW + 1, max(column - _WINDOW, 0) : column + _WINDOW + 1]
    around = image.valid[window] & (np.abs(image.depth[window] - image.depth[row, column]) < 0.05)
    rays = directions[window][around]
    points = rays * (image.depth[window][around] / rays[:, 2])[:, None]
    if len(points) < _LEAST:
        raise ConfigError(
            f"{log.files[frame]}: only {len(points)} pixels around column {column}, row {row} see the same surface; "
            "pick a pixel farther from an edge"
        )
    normal = np.linalg.svd(points - points.mean(axis=0))[2][2]
    normal = -normal if normal @ place > 0.0 else normal
    return np.asarray(move(log.T_BC, (place + distance * normal)[None])[0])


def in_principal_axes(log: SensorLog, estimate: LogEstimate, frame: int, point: FloatArray) -> FloatArray:
    """Return a point, given in B at a frame, in the estimated principal axes T from the centre of mass [m], shape (3,).

    The result is ``p_T = R_GT^T (T_GB p_B - o)``, where o is the centre of mass in G. If the graph no longer contains
    the attitude at the frame, the estimated motion gives it.

    Args:
        log: The log.
        estimate: The estimate from the log.
        frame: Number of the frame.
        point: Point in B [m], shape (3,).
    """
    R_WT = to_matrix(estimate.attitudes(log.times[frame : frame + 1])[0])  # noqa: N806
    near = int(np.abs(estimate.history.times - log.times[frame]).argmin())
    R_WB = to_matrix(estimate.history.chaser[near])  # noqa: N806
    return np.asarray(R_WT.T @ (R_WB @ point + estimate.chaser_positions[frame] - estimate.graph.centre))


def mating_point_text(point: FloatArray) -> str:
    """Return a mating point as text for the key ``mating_point`` of a target."""
    return "[" + ", ".join(f"{value:.4f} m" for value in point) + "]"
