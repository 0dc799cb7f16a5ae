"""The panels over time in the figure of a rendezvous: clearance, error, force, distance to the mating point."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from safe_inspect.figures.rendezvous.mission_scene import FLIGHT, PHASE_COLOURS, PLANNED
from safe_inspect.geometry.picture import BLACK, BLUE, GREEN, GREY, PALE, VERMILION
from safe_inspect.rendezvous.coordination.context import clearances
from safe_inspect.rendezvous.missions.record import FlownPlan, MissionRecord
from safe_inspect.rendezvous.missions.summary import nominal_path
from safe_inspect.types import AnyArray, FloatArray

if TYPE_CHECKING:
    from matplotlib.figure import Figure

AXIS_COLOURS = (VERMILION, BLUE, GREEN)
#: Duration that is shown before the approach [s].
LEAD = 5.0
#: Ratio of the largest to the least distance above which the axis is logarithmic.
_DECADES = 30.0
_LEFT, _WIDTH = 0.675, 0.31
_PLACES = ((0.755, 0.18), (0.525, 0.18), (0.295, 0.18), (0.075, 0.17))


def plan_clearance(record: MissionRecord, plan: FlownPlan) -> FloatArray:
    """Return the distance of the chaser's sphere to the target's boxes along a plan [m], shape (K,)."""
    still = np.broadcast_to([0.0, 0.0, 0.0, 1.0], (len(plan.times), 4))
    return clearances(record.target, plan.position_target, still, record.config.chaser.radius)


def tracking_error(arrays: dict[str, AnyArray]) -> tuple[FloatArray, str]:
    """Return the error of the chaser from the tube's centre, and what this centre is; NaN where nothing is followed.

    A tracker without a tube has no nominal motion: its error is measured from the true reference.

    Returns:
        The error along each axis of W [m], shape (K, 3), and ``nominal motion`` or ``the reference``.
    """
    tube, centre = arrays["tube"], nominal_path(arrays)
    has_width = bool((tube[np.isfinite(tube)] > 0.0).any()) or not np.isfinite(tube).any()
    if not has_width:
        centre = centre - arrays["z"][:, :, 0]
    error = np.where(np.isfinite(tube)[:, None], arrays["x"][:, :3] - centre, np.nan)
    return error, "nominal motion" if has_width else "the reference"


def outcome_of(record: MissionRecord) -> str:
    """Return how a mission ended, in one line."""
    summary, clearance = record.summary, float(record.arrays["clearance"].min())
    time = float(record.arrays["t"][-1]) + record.config.mission.step
    ending = f"success after {time:.0f} s"
    if not summary.get("success"):
        ending = f"failed after {time:.0f} s: {summary.get('cause') or 'unknown cause'}"
    error = float(record.mating_distance()[-1])
    near = f"{100.0 * error:.3g} cm" if error >= 0.01 else f"{1000.0 * error:.2g} mm"
    if time < float(summary.get("time") or 0.0) - 0.5 * record.config.mission.step:
        ending = f"{record.phases()[-1].phase.value} at {time:.0f} s"  # the record ends before the mission does
    return f"{ending}; least clearance {100.0 * clearance:.1f} cm, {near} from the mating point"


def draw_mission_times(figure: Figure, record: MissionRecord, first: int) -> None:
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
        axes.plot(plan.times, plan_clearance(record, plan), color=PLANNED, linewidth=1.0, linestyle="--", label=label)
    if np.isfinite(margin).any():
        axes.fill_between(time, 0.0, margin, color=PALE, linewidth=0.0, label="margin of the tube")
    axes.axhline(0.0, color=BLACK, linewidth=0.7)
    axes.set(ylabel="clearance [m]", ylim=(min(0.0, 1.1 * float(arrays["clearance"][rows].min())), None))
    _legend(axes)


def _draw_error(axes: Any, arrays: dict[str, AnyArray], rows: AnyArray) -> None:
    tube = 100.0 * arrays["tube"][rows]
    error, what = tracking_error(arrays)
    error = 100.0 * error[rows]
    if not np.isfinite(tube).any():
        axes.text(0.5, 0.5, "no approach", color=GREY, ha="center", va="center", transform=axes.transAxes)
        axes.set(yticks=(), ylabel=f"error from\n{what} [cm]")
        return
    for axis, colour in enumerate(AXIS_COLOURS):
        axes.plot(arrays["t"][rows], error[:, axis], color=colour, linewidth=1.0, label="xyz"[axis])
    axes.fill_between(arrays["t"][rows], -tube, tube, color=PALE, linewidth=0.0, label="tube")
    axes.set(ylabel=f"error from\n{what} [cm]")
    _legend(axes)


def _draw_force(axes: Any, record: MissionRecord, rows: AnyArray) -> None:
    arrays, limit = record.arrays, record.config.chaser.limits.force
    time, spare, force = arrays["t"][rows], limit - arrays["tube_force"][rows], record.force_in_inertial()[rows]
    for axis, colour in enumerate(AXIS_COLOURS):
        axes.step(time, force[:, axis], where="post", color=colour, linewidth=0.9, label="xyz"[axis])
        for plan in record.plans:
            axes.plot(plan.times, plan.force[:, axis], color=colour, linewidth=0.8, linestyle="--")
    for sign in (-1.0, 1.0):
        axes.axhline(sign * limit, color=BLACK, linewidth=0.8, label="limit" if sign > 0.0 else None)
        axes.plot(
            time, sign * spare, color=GREY, linewidth=1.0, label="limit less the tube's share" if sign > 0.0 else None
        )
    axes.set(ylabel="force [N]", ylim=(-1.15 * limit, 1.15 * limit))
    _legend(axes)


def _legend(axes: Any) -> None:
    axes.legend(
        loc="lower left", bbox_to_anchor=(-0.01, 0.97), ncols=6, handlelength=1.2, columnspacing=1.0, borderpad=0.0
    )
