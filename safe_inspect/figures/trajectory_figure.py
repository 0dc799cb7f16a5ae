"""Figures of one episode: the trajectory around the chief, inspected points, quantities over time, and its safety."""

from __future__ import annotations

from typing import Any

import numpy as np

from safe_inspect.evaluation.recorder import Trajectory
from safe_inspect.evaluation.safety_report import SafetyReport
from safe_inspect.figures.drawing import (
    AXIS_COLOURS,
    SEQUENTIAL,
    Figure,
    clock,
    deputy_line,
    ending,
    new_figure,
    reach_of,
    speed_limit_of,
)
from safe_inspect.figures.scene import draw_scene
from safe_inspect.geometry.picture import (
    BLACK,
    BLUE,
    DEPUTY_COLOURS,
    FRONT,
    GREY,
    PALE,
    VERMILION,
    Camera,
    circle,
    pieces,
)
from safe_inspect.types import BoolArray, FloatArray

_RIGHT = 0.985
_FEW = 20  # number of burns up to which they are drawn as pins
_LEFT, _WIDTH = 0.625, 0.36
_PLACES = ((0.79, 0.15), (0.605, 0.15), (0.42, 0.15), (0.305, 0.08), (0.195, 0.08), (0.085, 0.08))


def trajectory_figure(episode: Trajectory) -> Figure:
    """Draw an episode.

    On the left are the deputies' trajectories around the chief in Hill's frame, with rings of equal range in the
    orbital plane, the burns, and the direction to the sun from the start to the end. Below is the chief from two sides,
    with its points coloured by the time of their inspection. On the right, over time: the share of inspected points,
    the range, the speed with its limit, and the thrust along each axis. Each of several deputies has its own colour,
    also for the points that it inspected first. In a task without points, sun or orbit, the chief, the sun or the
    largest safe speed is not drawn; delta-v replaces the share of points.

    Raises:
        SafeInspectError: Matplotlib is not installed.
    """
    with new_figure(10.0, 6.8) as figure:
        draw_scene(figure, episode)
        if len(episode.points):
            _draw_chief(figure, episode)
        _draw_summary(figure, episode)
        _draw_times(figure, episode)
    return figure


def _draw_chief(figure: Figure, episode: Trajectory) -> None:
    """Draw the chief from two opposite sides, so that every point is visible, and a legend of the colours."""
    radius = episode.radius
    seen = np.isfinite(episode.inspected_at)
    several = len(episode.deputies) > 1
    ink = BLACK if several else VERMILION
    for column, camera in enumerate((FRONT, Camera.along(-FRONT.sight))):
        axes: Any = figure.add_axes((0.02 + 0.175 * column, 0.03, 0.17, 0.235))
        front, flat = episode.points @ camera.sight > 0.0, camera.flat(episode.points)
        axes.fill(*circle(radius, 181).T, facecolor="#F2F2F2", edgecolor=GREY, linewidth=0.7)
        (_by_inspector if several else _by_time)(axes, episode, flat, front & seen)
        axes.scatter(*flat[front & ~seen].T, s=22, marker="x", color=ink, linewidths=1.3)
        axes.set_aspect("equal")
        axes.set_axis_off()
        axes.set_title("from behind" if column else "chief as above", pad=2.0, fontsize=8.5)
    (_inspectors_key if several else _time_key)(figure, episode)
    if not seen.all():
        figure.text(0.1925, 0.012, "crosses: not inspected", fontsize=8, color=ink, ha="center")


def _draw_summary(figure: Figure, episode: Trajectory) -> None:
    """Write the line at the top: inspected points, time, delta-v, and how the episode ended."""
    scale, unit = clock(episode)
    text = f"after {episode.time[-1] / scale:.1f} {unit}"
    if len(episode.points):
        text = f"{int(np.isfinite(episode.inspected_at).sum())} of {len(episode.points)} points inspected {text}"
    spent = float(episode.delta_v[-1].sum())
    text += f", delta-v {spent:.3g} m/s{' in all' if len(episode.deputies) > 1 else ''}"
    text += f" ({ending(episode)})" if ending(episode) else ""
    figure.text(_RIGHT, 0.985, text, fontsize=9.5, color=BLACK, ha="right", va="top")


def _deputy_marker(index: int) -> str:
    """Return the marker of the points that a deputy has inspected."""
    return ("o", "^", "s")[index // len(DEPUTY_COLOURS) % 3]


def _by_time(axes: Any, episode: Trajectory, flat: FloatArray, shown: BoolArray) -> None:
    when = episode.inspected_at[shown] / clock(episode)[0]
    axes.scatter(
        *flat[shown].T, c=when, cmap=SEQUENTIAL, norm=_time_norm(episode), s=22, edgecolors="white", linewidths=0.4
    )


def _time_norm(episode: Trajectory) -> Any:
    """Return the colour scale of time, in the figure's unit of time."""
    from matplotlib.colors import Normalize

    return Normalize(0.0, float(episode.time[-1]) / clock(episode)[0])


def _by_inspector(axes: Any, episode: Trajectory, flat: FloatArray, shown: BoolArray) -> None:
    """Draw the points in the colour of the deputy that inspected them first; points inspected earlier are larger."""
    for index in range(len(episode.deputies)):
        own = shown & (episode.inspector == index)
        size = 34.0 - 22.0 * episode.inspected_at[own] / episode.time[-1]
        colour, marker = deputy_line(index)["color"], _deputy_marker(index)
        axes.scatter(*flat[own].T, color=colour, marker=marker, s=size, edgecolors="white", linewidths=0.4)


def _time_key(figure: Figure, episode: Trajectory) -> None:
    from matplotlib.cm import ScalarMappable

    place = figure.add_axes((0.40, 0.05, 0.012, 0.185))
    label = f"inspected at [{clock(episode)[1]}]"
    bar = figure.colorbar(ScalarMappable(_time_norm(episode), SEQUENTIAL), cax=place, label=label)
    bar.outline.set_linewidth(0.5)  # type: ignore[operator]


def _inspectors_key(figure: Figure, episode: Trajectory) -> None:
    """Draw a legend with the number of points that each deputy was the first to inspect."""
    from matplotlib.lines import Line2D

    counts = [int((episode.inspector == index).sum()) for index in range(len(episode.deputies))]
    handles = [
        Line2D([], [], linestyle="", marker=_deputy_marker(index), markersize=5, color=deputy_line(index)["color"])
        for index in range(len(counts))
    ]
    labels = [f"{name}: {count}" for name, count in zip(episode.deputies, counts, strict=True)]
    place: Any = {"loc": "center left", "bbox_to_anchor": (0.38, 0.15), "handlelength": 0.6, "borderpad": 0.0}
    place["labelspacing"] = 0.5 if len(counts) <= 6 else 0.15
    title = "first seen by\n(larger: earlier)"
    figure.legend(handles, labels, title=title, title_fontsize=8, alignment="left", **place)


def _draw_times(figure: Figure, episode: Trajectory) -> None:
    """Draw the six panels below each other, with a common time axis."""
    scale, unit = clock(episode)
    time = episode.time / scale
    panels: list[Any] = [figure.add_axes((_LEFT, bottom, _WIDTH, height)) for bottom, height in _PLACES]
    if len(episode.points):
        _draw_coverage(panels[0], episode, time)
    else:
        _draw_each(panels[0], time, episode.delta_v)
        panels[0].set(ylabel="delta-v\n[m/s]", ylim=(0, None))
    _draw_each(panels[1], time, episode.range)
    near = episode.range <= reach_of(episode)
    panels[1].set(ylabel="range\n[m]", ylim=(0, None if near.all() else 1.05 * reach_of(episode)))
    _draw_speed(panels[2], episode, time)
    several = len(episode.deputies) > 1
    reach = 1.2 * float(np.abs(episode.thrust).max(initial=0.0)) or 1.0
    for axis, axes in enumerate(panels[3:]):
        for index in range(len(episode.deputies)):
            line = deputy_line(index) if several else {"color": AXIS_COLOURS[axis]}
            _draw_thrust(axes, time, episode.thrust[:, index, axis], **line)
        axes.set(ylim=(-reach, reach), ylabel=f"{'xyz'[axis]}")
        axes.locator_params(axis="y", nbins=3)
    figure.text(_LEFT - 0.083, 0.235, "thrust [N]", rotation=90, va="center", ha="center", color=BLACK)
    _shade_eclipses(panels, episode, time)
    for axes in panels:
        axes.set_xlim(-0.015 * time[-1], time[-1])  # keeps a burn at the start apart from the axis
        axes.tick_params(labelbottom=axes is panels[-1])
        axes.yaxis.set_label_coords(-0.135, 0.5)
    label = f"time [{unit}]"
    if episode.mean_motion:
        label += f", an orbit is {2.0 * np.pi / episode.mean_motion / scale:.3g} {unit}"
    panels[-1].set_xlabel(label)


def _shade_eclipses(panels: list[Any], episode: Trajectory, time: FloatArray) -> None:
    """Shade the times in which the Earth hides more than half of the sun."""
    if "sunlight" not in episode.arrays:
        return
    for axes in panels:
        bottom, top = axes.get_ylim()
        axes.fill_between(
            time, bottom, top, where=episode.sunlight < 0.5, step="post", color=PALE, linewidth=0, zorder=0,
            label="eclipse" if axes is panels[1] else None,
        )  # fmt: skip
        axes.set_ylim(bottom, top)
    if (episode.sunlight < 0.5).any():
        panels[1].legend(loc="lower right", bbox_to_anchor=(1.01, 0.96), handlelength=1.2, borderpad=0.0)


def _draw_coverage(axes: Any, episode: Trajectory, time: FloatArray) -> None:
    several = len(episode.deputies) > 1
    axes.step(time, 100.0 * episode.coverage, where="post", color=BLACK, label="together" if several else None)
    for index in range(len(episode.deputies)) if several else ():
        axes.step(time, 100.0 * episode.coverage_of(index), where="post", linewidth=1.2, **deputy_line(index))
    if several:
        axes.legend(loc="lower left", bbox_to_anchor=(-0.01, 0.96), handlelength=1.2, borderpad=0.0)
    axes.set(ylabel="inspected\n[%]", ylim=(0, 104), yticks=(0, 50, 100))


def _draw_each(axes: Any, time: FloatArray, values: FloatArray) -> None:
    """Draw a line for each deputy; the values have the shape (T + 1, D)."""
    for index in range(values.shape[1]):
        axes.plot(time, values[:, index], **deputy_line(index))


def _draw_speed(axes: Any, episode: Trajectory, time: FloatArray) -> None:
    """Draw the speeds and, for a chief in orbit, the largest safe speeds."""
    limit = speed_limit_of(episode)
    for index in range(len(episode.deputies)):
        line = deputy_line(index)
        axes.plot(time, episode.speed[:, index], **line)
        if limit is not None:
            axes.plot(time, limit[:, index], color=line["color"], linewidth=0.9, linestyle=(0, (4, 2)))
    near = episode.range <= reach_of(episode)
    top = float(episode.speed[near].max())
    if limit is not None:
        above = pieces(episode.speed, episode.speed > limit)
        if np.isfinite(above).any():
            axes.plot(time, above, color=BLACK, linewidth=2.4)
            axes.plot([], [], color=BLACK, linewidth=2.4, label="above it")
        axes.plot([], [], color=GREY, linewidth=0.9, linestyle=(0, (4, 2)), label="largest safe speed at the range")
        axes.legend(
            loc="lower right", bbox_to_anchor=(1.01, 0.96), handlelength=2.0, borderpad=0.0, ncols=2, reverse=True
        )
        top = max(top, float(limit[near].max()))
    axes.set(ylabel="speed\n[m/s]", ylim=(0, None if near.all() else 1.05 * top))


def _draw_thrust(axes: Any, time: FloatArray, values: FloatArray, **line: Any) -> None:
    """Draw a thrust over time; a few short burns are drawn as pins, as lines would cover each other."""
    burns = np.flatnonzero(values)
    axes.axhline(0.0, color=GREY, linewidth=0.8, zorder=1)
    if len(burns) > _FEW:
        axes.step(time, np.append(values, 0.0), where="post", linewidth=0.9, **line)
        return
    axes.vlines(time[burns], 0.0, values[burns], color=line["color"], linewidth=1.2)
    axes.plot(time[burns], values[burns], marker="o", markersize=3.5, linestyle="", color=line["color"])


def safety_figure(report: SafetyReport) -> Figure:
    """Draw every constraint's plain safety quantity over time, for the environment that came nearest to a violation."""
    rows = -(-len(report.names) // 2)
    with new_figure(8.0, 1.35 * rows + 0.4, layout="constrained") as figure:
        panels = figure.subplots(rows, 2, sharex=True, squeeze=False)
        hours = np.arange(len(report.worst)) * report.step_size / 3600.0
        for axes, name, unit, values in zip(panels.flat, report.names, report.units, report.worst.T, strict=False):
            axes.axhline(0.0, color=VERMILION, linewidth=0.9)
            axes.plot(hours, values, color=BLUE, linewidth=0.9)
            axes.set_ylabel(f"{name}\n[{unit}]")
        for axes in panels.flat[len(report.names) :]:
            axes.set_axis_off()
        for axes in panels[-1]:
            axes.set_xlabel("time [h]")
        figure.suptitle("safety quantities at the steps; unsafe below the red line", fontsize=9.5)
    return figure
