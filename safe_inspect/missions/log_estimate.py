"""Estimation from a sensor log with the pipeline of a mission, its output, and a mating point given by a pixel."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from safe_inspect.dynamics.quaternion import conjugate, log, multiply, to_matrix
from safe_inspect.errors import ConfigError
from safe_inspect.missions.record import json_text
from safe_inspect.missions.sensor_log import TRUTH_PARTS, SensorLog, write_table
from safe_inspect.random.streams import Streams
from safe_inspect.rendezvous.depth_camera import DepthFrame
from safe_inspect.rendezvous.estimation.estimators import PipelineEstimator
from safe_inspect.rendezvous.estimation.factors import ImuBuffer
from safe_inspect.rendezvous.estimation.pipeline import EstimationPipeline
from safe_inspect.rendezvous.estimation.states import ChaserStart, GraphEstimate, History, TargetEstimate, largest_sigma
from safe_inspect.rendezvous.front_end.base import FrontEndContext
from safe_inspect.rendezvous.poses import HALF_TURNS, MODEL, Edge, move
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
    parts = (estimator.front_end(context), estimator.back_end, estimator.characteriser, context)
    pipeline: EstimationPipeline | None = None
    edges: list[Edge] = []
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
        edges += pipeline.measured
        online.append(_row(pipeline, frame))
        if progress is not None:
            progress(done + 1, len(log_))
    if pipeline is None or pipeline.graph is None or pipeline.target is None:
        seen = sum(row[2] > 0 for row in online)
        raise ConfigError(
            f"{log_.folder}: the motion of the target could not be determined; {seen} of {len(log_)} frames gave a "
            "relative pose. Check the unit and sign of depths and rates and the camera's orientation, or record longer"
        )
    history = pipeline.history()
    return LogEstimate(
        np.array(online), pipeline.target, pipeline.graph, np.array(positions), history, tuple(edges), target
    )


def _row(pipeline: EstimationPipeline, frame: DepthFrame) -> FloatArray:
    graph, found = pipeline.graph, pipeline.target
    row = np.full(len(ONLINE_COLUMNS), np.nan)
    row[:3] = frame.time, len(frame.points), len(pipeline.measured)
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


ESTIMATE, ONLINE, EDGES = "estimate.json", "estimate.csv", "edges.npz"


def summary_of(log: SensorLog, estimate: LogEstimate) -> dict[str, Any]:
    """Return the estimate at the last frame as a dictionary; angles are in degrees."""
    found, graph = estimate.target, estimate.graph
    time = float(log.times[-1])
    q, w = found.predict(np.array([time]))
    covariance = found.covariance
    summary: dict[str, Any] = {
        "frames": len(log),
        "frames_with_edges": len({edge.second for edge in estimate.edges}),
        "poses_to_the_model": sum(edge.first == MODEL for edge in estimate.edges),
        "seconds": time - float(log.times[0]),
        "time": time,
        "q_WT": q[0],
        "rate_deg_per_s": np.rad2deg(w[0]),
        "attitude_sigma_deg": np.rad2deg(largest_sigma(covariance[:3, :3])),
        "rate_sigma_deg_per_s": np.rad2deg(largest_sigma(covariance[3:6, 3:6])),
        "axes_sigma_deg": np.rad2deg(found.axes_sigma),
        "q_GT": found.q_GT,
        "J1_over_J3": found.ratios[0],
        "J2_over_J3": found.ratios[1],
        "centre_of_mass_W": graph.centre,
        "centre_of_mass_G": graph.centre_glued,
        "centre_sigma": largest_sigma(graph.centre_covariance),
        "axes_are_observable": found.observable,
        "directions_are_known": found.aligned,
        "misfit": found.misfit,
    }
    if log.truth is not None:
        summary["errors"] = _errors(log, estimate, log.truth)
    return summary


def _errors(log: SensorLog, estimate: LogEstimate, truth: FloatArray) -> dict[str, float]:
    rate = truth[-1, TRUTH_PARTS["rate"]]
    error = estimate.attitude_error(log.times, truth[:, TRUTH_PARTS["q_WT"]])
    _, w = estimate.target.predict(log.times[-1:])
    # Without a pose to the model the directions of the axes are only known up to half turns.
    turns = HALF_TURNS[:1] if estimate.target.aligned else HALF_TURNS
    return {
        "attitude_at_the_end_deg": float(np.rad2deg(error[-1])),
        "attitude_median_deg": float(np.rad2deg(np.median(error))),
        "rate_at_the_end_deg_per_s": float(np.rad2deg(min(np.linalg.norm(turn @ w[0] - rate) for turn in turns))),
    }


def write_estimate(folder: Path, log: SensorLog, estimate: LogEstimate) -> None:
    """Write the summary and the tables into an existing folder."""
    (folder / ESTIMATE).write_text(json_text(summary_of(log, estimate), 2) + "\n", encoding="utf-8")
    write_table(folder / ONLINE, ONLINE_COLUMNS, estimate.online, ".10g")
    names = [field.name for field in fields(Edge)]
    columns = {name: np.array([getattr(edge, name) for edge in estimate.edges]) for name in names}
    np.savez_compressed(folder / EDGES, **columns)  # type: ignore[arg-type]


def estimate_table(summary: dict[str, Any]) -> str:
    """Return the summary as lines of text for a terminal."""
    rate = summary["rate_deg_per_s"]
    components = ", ".join(f"{one:.3f}" for one in rate)
    lines = [
        f"{summary['frames_with_edges']} of {summary['frames']} frames in {summary['seconds']:.1f} s gave poses, "
        f"{summary['poses_to_the_model']} of them to the known model",
        f"rate at the end in T           {np.linalg.norm(rate):8.3f} deg/s  ({components}), "
        f"sigma {summary['rate_sigma_deg_per_s']:.3f}",
        f"attitude, sigma                {summary['attitude_sigma_deg']:8.3f} deg",
        f"principal axes, sigma          {summary['axes_sigma_deg']:8.3f} deg"
        + ("" if summary["axes_are_observable"] else "  (the motion does not show the transverse axes)"),
        f"J1/J3, J2/J3                   {summary['J1_over_J3']:8.4f}, {summary['J2_over_J3']:.4f}",
        f"centre of mass, sigma          {1e3 * summary['centre_sigma']:8.1f} mm",
        "directions of the axes         "
        + (
            "    known from the model"
            if summary["directions_are_known"]
            else "    ambiguous by half turns: no known shape"
        ),
    ]
    if "errors" in summary:
        errors = summary["errors"]
        lines.append(
            f"errors against the truth: attitude {errors['attitude_at_the_end_deg']:.2f} deg at the end "
            f"({errors['attitude_median_deg']:.2f} median), rate {errors['rate_at_the_end_deg_per_s']:.3f} deg/s"
        )
    return "\n".join(lines)
