"""The figure of the estimation on a sensor log: a frame with the registered model, the polhode, rates and errors."""

from __future__ import annotations

from typing import Any

import numpy as np

from safe_inspect.dynamics.quaternion import to_matrix
from safe_inspect.figures.drawing import SEQUENTIAL, Figure, new_figure
from safe_inspect.figures.mission_scene import POLHODE_VIEW, draw_polhode
from safe_inspect.geometry.picture import BLACK, BLUE, GREEN, GREY, VERMILION
from safe_inspect.missions.log_estimate import ONLINE_COLUMNS, LogEstimate, measured_rates
from safe_inspect.missions.sensor_log import TRUTH_PARTS, SensorLog
from safe_inspect.rendezvous.poses import MODEL, Edge, inverse, move
from safe_inspect.rendezvous.target.surface import MeshSurface
from safe_inspect.types import FloatArray

_AXIS_COLOURS = (BLUE, GREEN, VERMILION)


def estimate_figure(log: SensorLog, estimate: LogEstimate) -> Figure:
    """Draw the result of the estimation on a sensor log.

    On the left is a depth frame with the edges of the registered model and the principal axes at the centre of mass,
    with the true ones dashed if the log has them; below it, the polhode of the motion and the measured rates. On the
    right, over time, are the angular velocity in the principal axes, and the error and standard deviation of the
    attitude.

    Raises:
        SafeInspectError: Matplotlib is not installed.
    """
    with new_figure(10.5, 7.0) as figure:
        _draw_frame(figure.add_axes((0.01, 0.52, 0.5, 0.42)), log, estimate)
        polhode: Any = figure.add_axes((0.03, 0.02, 0.46, 0.42))
        times = np.linspace(log.times[0], log.times[-1], 400)
        fitted = np.rad2deg(estimate.target.predict(times)[1])
        middles, rates = measured_rates(estimate)
        measured = np.rad2deg(rates)
        draw_polhode(polhode, fitted, estimate.target.inertia)
        polhode.plot(*POLHODE_VIEW.flat(measured).T, ".", markersize=2.5, color=BLACK, zorder=6)
        axes: Any = figure.add_axes((0.58, 0.57, 0.4, 0.36))
        for axis, colour in enumerate(_AXIS_COLOURS):
            axes.plot(middles, measured[:, axis], ".", markersize=3, color=colour)
            axes.plot(times, fitted[:, axis], color=colour, label=f"axis {axis + 1}")
        if log.truth is not None and estimate.target.aligned:
            rates = np.rad2deg(log.truth[:, TRUTH_PARTS["rate"]])
            axes.plot(log.times, rates, color=BLACK, linewidth=0.8, linestyle="--")
        axes.set_ylabel("rate in T [deg/s]")
        axes.set_title("angular velocity: motion (lines), over 5 s (dots), truth (dashed)")
        axes.margins(y=0.18)
        axes.legend(loc="lower right", ncols=3)
        _draw_attitude(figure.add_axes((0.58, 0.09, 0.4, 0.36)), log, estimate)
    return figure


def _shown_frame(log: SensorLog, estimate: LogEstimate) -> tuple[int, Edge | None]:
    """Return the frame with the most points among those registered to the model, or among all if there are none."""
    points = estimate.online[:, ONLINE_COLUMNS.index("points")]
    poses = {edge.second: edge for edge in estimate.edges if edge.first == MODEL}
    if not poses:
        return int(points.argmax()), None
    best = max(poses, key=lambda frame: points[frame])
    return best, poses[best]


def _draw_frame(axes: Any, log: SensorLog, estimate: LogEstimate) -> None:
    frame, edge = _shown_frame(log, estimate)
    image = log.frame(frame)
    axes.imshow(np.where(image.valid, image.depth, np.nan), cmap=SEQUENTIAL, origin="upper")
    rows, columns = np.nonzero(image.valid)
    margin = 12
    axes.set_xlim(columns.min() - margin, columns.max() + margin)
    axes.set_ylim(rows.max() + margin, rows.min() - margin)
    axes.set_axis_off()
    T_CB = inverse(log.T_BC)  # noqa: N806
    title = f"frame {frame} at {image.time:.1f} s"
    target = estimate.target_model
    if edge is not None and target is not None:
        T_CM = T_CB @ inverse(edge.pose)  # noqa: N806
        for ends in MeshSurface(target.shape).sharp_edges:
            axes.plot(*_project(log, move(T_CM, ends)).T, color=VERMILION, linewidth=0.8)
        title += ", registered shape"
    R_WT = to_matrix(estimate.attitudes(log.times[frame : frame + 1])[0])  # noqa: N806
    near = int(np.abs(estimate.history.times - log.times[frame]).argmin())
    R_BW = to_matrix(estimate.history.chaser[near]).T  # noqa: N806
    centre = R_BW @ (estimate.graph.centre - estimate.chaser_positions[frame])
    _draw_triad(axes, log, move(T_CB, centre[None])[0], T_CB[:3, :3] @ R_BW @ R_WT, linewidth=2.0)
    if log.truth is not None and target is not None:
        row = log.truth[frame]
        R_MB = to_matrix(row[TRUTH_PARTS["q_MB"]])  # noqa: N806
        true_centre = -R_MB.T @ row[TRUTH_PARTS["T_MB"]]
        _draw_triad(
            axes, log, move(T_CB, true_centre[None])[0], T_CB[:3, :3] @ R_MB.T @ target.R_MT, linewidth=1.0,
            linestyle=(0, (3, 2)), color=BLACK,
        )  # fmt: skip
        title += "; true axes dashed"
    axes.set_title(title)


def _draw_triad(axes: Any, log: SensorLog, centre: FloatArray, rotation: FloatArray, **look: Any) -> None:
    for axis, colour in enumerate(_AXIS_COLOURS):
        ends = np.stack([centre, centre + 0.3 * rotation[:, axis]])
        flat = _project(log, ends)
        axes.plot(*flat.T, **{"color": colour, **look})
        if "linestyle" not in look:
            axes.annotate(str(axis + 1), flat[1], color=colour, fontsize=9, ha="center", va="center")


def _project(log: SensorLog, points: FloatArray) -> FloatArray:
    """Return pixel columns and rows of points given in C, shape (n, 2)."""
    fx, fy, cx, cy = log.description.camera.geometry.intrinsics
    depth = np.maximum(points[:, 2], 1e-3)
    return np.stack([fx * points[:, 0] / depth + cx, fy * points[:, 1] / depth + cy], axis=1)


def _draw_attitude(axes: Any, log: SensorLog, estimate: LogEstimate) -> None:
    sigma = np.rad2deg(estimate.online[:, ONLINE_COLUMNS.index("attitude_sigma")])
    axes.plot(log.times, sigma, color=GREY, label="standard deviation as known then")
    if log.truth is not None:
        error = estimate.attitude_error(log.times, log.truth[:, TRUTH_PARTS["q_WT"]])
        axes.plot(log.times, np.rad2deg(error), color=BLUE, label="error of the motion found in the end")
    axes.set_yscale("log")
    axes.set_xlabel("time [s]")
    axes.set_ylabel("attitude [deg]")
    axes.legend(loc="upper right")
