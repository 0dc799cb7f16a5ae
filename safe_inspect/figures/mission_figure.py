"""The figure of a rendezvous: the approach in W and in the target's axes, the polhode, and quantities over time."""

from __future__ import annotations

from typing import Any

import numpy as np

from safe_inspect.dynamics.quaternion import to_matrix
from safe_inspect.figures.drawing import AXIS_COLOURS, Figure, new_figure
from safe_inspect.figures.mission_scene import (
    CAMERA,
    FLIGHT,
    MATING,
    PHASE_COLOURS,
    PLANNED,
    TUBE,
    SceneArtists,
    draw_polhode,
    show_extent,
)
from safe_inspect.geometry.picture import BLACK, GREY, PALE, Camera
from safe_inspect.missions.record import MissionRecord
from safe_inspect.missions.summary import true_reference
from safe_inspect.rendezvous.coordination.context import clearances
from safe_inspect.rendezvous.planner.query import Plan
from safe_inspect.types import AnyArray, FloatArray

#: Duration that is shown before the approach [s].
LEAD = 5.0
#: Ratio of the largest to the least distance above which the axis is logarithmic.
_DECADES = 30.0
_LEFT, _WIDTH = 0.675, 0.31
_PLACES = ((0.755, 0.18), (0.525, 0.18), (0.295, 0.18), (0.075, 0.17))


def _plan_clearance(record: MissionRecord, plan: Plan) -> FloatArray:
    """Return the distance of the chaser's sphere to the target's boxes along a plan [m], shape (K,)."""
    still = np.broadcast_to([0.0, 0.0, 0.0, 1.0], (len(plan.times), 4))
    return clearances(record.target, plan.position_target, still, record.config.chaser.radius)


def tracking_error(arrays: dict[str, AnyArray]) -> FloatArray:
    """Return the error from the true reference along each axis of W [m], shape (K, 3); NaN without an approach."""
    error = arrays["x"][:, :3] - true_reference(arrays)
    return np.asarray(np.where(np.isfinite(arrays["tube"])[:, None], error, np.nan))


def outcome_of(record: MissionRecord) -> str:
    """Return how a mission ended, in one line."""
    summary, clearance = record.summary, float(record.arrays["clearance"].min())
    time = float(record.arrays["t"][-1]) + record.config.mission.step
    ending = f"success after {time:.0f} s"
    if not summary.get("success"):
        ending = f"failed after {time:.0f} s: {summary.get('cause') or 'unknown cause'}"
    error = float(record.mating_distance()[-1])
    near = f"{100.0 * error:.3g} cm" if error >= 0.01 else f"{1000.0 * error:.1f} mm"
    if time < float(summary.get("time") or 0.0) - 0.5 * record.config.mission.step:
        ending = f"{record.phases()[-1].phase.value} at {time:.0f} s"  # the record ends before the mission does
    return f"{ending}; least clearance {100.0 * clearance:.1f} cm, {near} from the mating point"


def _draw_mission_times(figure: Figure, record: MissionRecord, first: int) -> None:
    """Draw the four panels, from shortly before a given step to the end."""
    arrays = record.arrays
    rows = np.flatnonzero(arrays["t"] >= arrays["t"][first] - LEAD)
    panels: list[Any] = [figure.add_axes((_LEFT, bottom, _WIDTH, height)) for bottom, height in _PLACES]
    _draw_clearance(panels[0], record, rows)
    _draw_error(panels[1], arrays, rows)
    _draw_force(panels[2], record, rows)
    distance = np.maximum(record.mating_distance()[rows], 1e-6)
    panels[3].plot(arrays["t"][rows], distance, color=FLIGHT)
    is_wide = distance.max() > _DECADES * distance.min()
    panels[3].set(ylabel="to the mating\npoint [m]", xlabel="time [s]", yscale="log" if is_wide else "linear")
    if not is_wide:
        panels[3].set_ylim(0.0, None)
    for axes in panels:
        for phase, start, end in record.phases():
            axes.axvspan(start, end, facecolor=PHASE_COLOURS.get(phase, GREY), alpha=0.1, linewidth=0.0, zorder=0)
        axes.set_xlim(arrays["t"][rows[0]], arrays["t"][rows[-1]])
        axes.tick_params(labelbottom=axes is panels[-1])
        axes.yaxis.set_label_coords(-0.135, 0.5)


def _draw_clearance(axes: Any, record: MissionRecord, rows: AnyArray) -> None:
    arrays = record.arrays
    time, margin = arrays["t"][rows], arrays["margin"][rows]
    axes.plot(time, arrays["clearance"][rows], color=FLIGHT, label="flown")
    for index, plan in enumerate(record.plans):
        label = None if index else "planned"
        axes.plot(plan.times, _plan_clearance(record, plan), color=PLANNED, linewidth=1.0, linestyle="--", label=label)
    if np.isfinite(margin).any():
        axes.fill_between(time, 0.0, margin, color=PALE, linewidth=0.0, label="margin of the tube")
    axes.axhline(0.0, color=BLACK, linewidth=0.7)
    axes.set(ylabel="clearance [m]", ylim=(min(0.0, 1.1 * float(arrays["clearance"][rows].min())), None))
    _legend(axes)


def _draw_error(axes: Any, arrays: dict[str, AnyArray], rows: AnyArray) -> None:
    tube = 100.0 * arrays["tube"][rows]
    error = 100.0 * tracking_error(arrays)[rows]
    if not np.isfinite(tube).any():
        axes.text(0.5, 0.5, "no approach", color=GREY, ha="center", va="center", transform=axes.transAxes)
        axes.set(yticks=(), ylabel="error from\nthe reference [cm]")
        return
    for axis, colour in enumerate(AXIS_COLOURS):
        axes.plot(arrays["t"][rows], error[:, axis], color=colour, linewidth=1.0, label="xyz"[axis])
    axes.fill_between(arrays["t"][rows], -tube, tube, color=PALE, linewidth=0.0, label="tube")
    axes.set(ylabel="error from\nthe reference [cm]")
    _legend(axes)


def _draw_force(axes: Any, record: MissionRecord, rows: AnyArray) -> None:
    arrays, limit = record.arrays, record.config.chaser.limits.force
    time, spare, force = arrays["t"][rows], limit - arrays["tube_force"][rows], record.force_in_inertial()[rows]
    for axis, colour in enumerate(AXIS_COLOURS):
        axes.step(time, force[:, axis], where="post", color=colour, linewidth=0.9, label="xyz"[axis])
        for plan in record.plans:
            axes.plot(plan.times, plan.force[:, axis], color=colour, linewidth=0.8, linestyle="--")
    for sign, hard, soft in ((-1.0, None, None), (1.0, "limit", "limit less the tube's share")):
        axes.axhline(sign * limit, color=BLACK, linewidth=0.8, label=hard)
        axes.plot(time, sign * spare, color=GREY, linewidth=1.0, label=soft)
    axes.set(ylabel="force [N]", ylim=(-1.15 * limit, 1.15 * limit))
    _legend(axes)


def _legend(axes: Any) -> None:
    axes.legend(
        loc="lower left", bbox_to_anchor=(-0.01, 0.97), ncols=6, handlelength=1.2, columnspacing=1.0, borderpad=0.0
    )


def mission_figure(record: MissionRecord) -> Figure:
    """Draw a mission.

    On the left, to scale, is the approach in W with the target in its final attitude, and in the target's principal
    axes T: the plan, the flight and the tube. Below are the angular velocity in T on the ellipsoid of equal energy, and
    the phases. On the right, over time: the clearance with the margin that the tube requires, the distance from the
    reference with the tube's half width, the force with its limits, and the distance to the mating point.

    Raises:
        SafeInspectError: Matplotlib is not installed.
    """
    with new_figure(11.5, 7.4) as figure:
        first = record.approach()
        _draw_scene(figure, record, first, in_target=False)
        _draw_scene(figure, record, first, in_target=True)
        polhode: Any = figure.add_axes((0.025, 0.075, 0.26, 0.245))
        draw_polhode(polhode, np.degrees(record.arrays["target_w"]), record.target.principal)
        _draw_key(figure)
        _draw_phases(figure, record)
        _draw_mission_times(figure, record, first)
        figure.text(0.985, 0.985, outcome_of(record), fontsize=9.5, color=BLACK, ha="right", va="top")
    return figure


def _draw_scene(figure: Figure, record: MissionRecord, first: int, in_target: bool) -> None:
    """Draw the approach, in T or in W."""
    arrays = record.arrays
    pose = (to_matrix(arrays["q"][-1]), to_matrix(arrays["target_q"][-1]))
    rotation = np.eye(3) if in_target else pose[1]
    axes: Any = figure.add_axes((0.305 if in_target else 0.0, 0.365, 0.3, 0.575))
    scene = SceneArtists(axes, record, in_target)
    path, view = scene.path, scene.best_view(first)
    if first:
        scene.show_path("before", path[: first + 1], view, rotation)
    plan = record.plans[-1] if record.plans else None
    scene.show(pose, view, path[first:], plan, np.flatnonzero(np.isfinite(arrays["tube"])))
    start = view.flat(path[first])
    axes.plot(*start, "o", markersize=5, color="white", markeredgecolor=FLIGHT, markeredgewidth=1.2, zorder=5.0)
    corners = record.target.solid.vertices @ record.target.R_MT
    own = view.flat(np.concatenate((path if in_target else path[first:], corners @ rotation.T)))
    reach = 1.15 * record.config.chaser.radius
    low, high = own.min(axis=0) - reach, own.max(axis=0) + reach
    show_extent(axes, low, high, 0.3 * 11.5 / (0.575 * 7.4))
    _draw_axes(axes, view, "123" if in_target else "xyz")
    axes.set_title("in the target's principal axes T" if in_target else "in W, the target as at the end", pad=2.0)


def _draw_axes(axes: Any, view: Camera, names: str) -> None:
    """Draw the axes of the frame in one corner and a scale in another."""
    left, right = axes.get_xlim()
    low, high = axes.get_ylim()
    corner, size = np.array([left + 0.15 * (right - left), low + 0.085 * (high - low)]), 0.07 * (right - left)
    for name, direction in zip(names, np.eye(3), strict=True):
        tip = corner + size * view.flat(direction)
        axes.plot(*np.stack((corner, tip)).T, color=GREY, linewidth=0.9, zorder=8)
        axes.text(
            *(corner + 1.45 * size * view.flat(direction)), name, color=GREY, fontsize=7.5, ha="center", va="center"
        )
    length = 0.5 if right - left < 6.0 else 10.0 ** np.floor(np.log10(0.25 * (right - left)))
    end = right - 0.04 * (right - left)
    height = low + 0.035 * (high - low)
    axes.plot([end - length, end], [height, height], color=GREY, linewidth=1.6, solid_capstyle="butt", zorder=8)
    axes.text(end - 0.5 * length, height + 0.012 * (high - low), f"{length:g} m", color=GREY, fontsize=7.5, ha="center")


def _draw_key(figure: Figure) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles = [
        Line2D([], [], color=FLIGHT, linewidth=1.9, label="flight"),
        Line2D([], [], color=PLANNED, linewidth=1.1, linestyle=(0, (4, 2)), label="plan"),
        Patch(facecolor=TUBE, alpha=0.45, label="tube"),
        Line2D([], [], color="#B8C4D0", linewidth=1.0, label="before the approach"),
        Line2D([], [], linestyle="", marker="*", markersize=9, color=MATING, label="mating point"),
        Line2D([], [], color=CAMERA, linewidth=1.0, label="camera"),
        Line2D([], [], linestyle="", marker="o", markersize=5, color="white", markeredgecolor=FLIGHT, label="start"),
        Line2D([], [], linestyle="", marker="s", markersize=5, color=FLIGHT, label="end"),
    ]
    figure.legend(handles=handles, loc="lower left", bbox_to_anchor=(0.315, 0.158), ncols=2, borderpad=0.0)


def _draw_phases(figure: Figure, record: MissionRecord) -> None:
    """Draw the phases on a time line."""
    axes: Any = figure.add_axes((0.33, 0.075, 0.26, 0.03))
    intervals = record.phases()
    for phase, start, end in intervals:
        axes.barh(0.0, end - start, left=start, height=1.0, color=PHASE_COLOURS.get(phase, GREY))
    axes.set(yticks=(), ylim=(-0.5, 0.5), xlim=(0.0, intervals[-1].end), xlabel="time [s]")
    axes.spines["left"].set_visible(False)
    axes.grid(visible=False)
    total = intervals[-1].end
    last, height = -np.inf, 0.75
    for phase, start, end in intervals:
        if end - start > 0.05 * total:
            middle = 0.5 * (start + end)
            height = 1.65 if height < 1.0 and middle - last < 0.15 * total else 0.75  # no overlap of labels
            axes.text(middle, height, phase.value, fontsize=6.0, ha="center", va="bottom", color=BLACK)
            last = middle
