"""The figure of one episode: the way round the chief, what was seen when, and range, coverage and thrust over time."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from safe_inspect.evaluation.chief_figure import VIEW, clock, draw_chief, point_colours, radius_of, towards
from safe_inspect.evaluation.drawing import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PALE,
    VERMILION,
    deputy_line,
    style,
)
from safe_inspect.evaluation.trajectory import Trajectory
from safe_inspect.types import FloatArray

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_AXES = ("x radial [m]", "y along track [m]", "z cross track [m]")
_FEW = 20  # burns
_AXIS_COLOURS = (VERMILION, BLUE, GREEN)


def trajectory_figure(episode: Trajectory) -> Figure:
    """Draw an episode.

    Left, the deputies' way round the chief in Hill's frame, with rings of equal range in the orbital plane and the
    direction to the sun at the start and at the end. Beside it the chief from two sides, its points coloured by
    the time of their inspection, and over time the share of inspected points, the range and the thrust. Several
    deputies have a colour each, and their points and shares have theirs.

    Raises:
        SafeInspectError: Matplotlib is not installed.
    """
    with style():
        from matplotlib.figure import Figure

        figure = Figure(figsize=(10.0, 5.4), facecolor="white")
        _draw_way(figure, episode)
        draw_chief(figure, episode)
        _draw_times(figure, episode)
    return figure


def _draw_times(figure: Figure, episode: Trajectory) -> None:
    scale, unit = clock(episode)
    time = episode.time / scale
    coverage, distance, thrust = (figure.add_axes((0.62, bottom, 0.36, 0.14)) for bottom in (0.455, 0.275, 0.095))
    several = len(episode.deputies) > 1
    coverage.step(time, 100.0 * episode.coverage, where="post", color=BLACK, label="together" if several else None)
    for index in range(len(episode.deputies)) if several else ():
        coverage.step(time, 100.0 * episode.coverage_of(index), where="post", linewidth=1.2, **deputy_line(index))
    if several:
        coverage.legend(loc="lower left", bbox_to_anchor=(-0.01, 0.92), handlelength=1.2, borderpad=0.0)
    coverage.set(ylabel="inspected\n[%]", ylim=(0, 104), yticks=(0, 50, 100))
    for index in range(len(episode.deputies)):
        distance.plot(time, episode.range[:, index], **deputy_line(index))
    distance.set(ylabel="range\n[m]", ylim=(0, None))
    if several:
        norm = np.sqrt(np.square(episode.control).sum(axis=-1))
        for index, name in enumerate(episode.deputies):
            _draw_thrust(thrust, time, norm[:, index], name, **deputy_line(index))
    else:
        for axis, (label, colour) in enumerate(zip("xyz", _AXIS_COLOURS, strict=True)):
            _draw_thrust(thrust, time, episode.control[:, 0, axis], label, color=colour)
        thrust.legend(
            loc="lower right", bbox_to_anchor=(1.01, 0.9), ncols=3, handlelength=1.0, columnspacing=1.0, borderpad=0.0
        )
    thrust.margins(y=0.15)
    if not episode.control.any():
        thrust.set_ylim(-1.0, 1.0)
    thrust.set(ylabel="norm of\nthrust [N]" if several else "thrust\n[N]", xlabel=f"time [{unit}]")
    for axes in (coverage, distance, thrust):
        axes.set_xlim(-0.015 * time[-1], time[-1])  # a burn at the start is seen beside the axis
        axes.tick_params(labelbottom=axes is thrust)
        axes.yaxis.set_label_coords(-0.15, 0.5)


def _draw_thrust(axes: Any, time: FloatArray, values: FloatArray, label: str, **line: Any) -> None:
    """Draw a thrust over time; a few short burns as pins, where lines would cover each other."""
    burns = np.flatnonzero(values)
    if len(burns) > _FEW:
        axes.step(time, np.append(values, 0.0), where="post", linewidth=1.2, label=label, **line)
        return
    axes.axhline(0.0, color=GREY, linewidth=0.8, zorder=1)
    axes.vlines(time[burns], 0.0, values[burns], color=line["color"], linewidth=1.2)
    axes.plot(time[burns], values[burns], marker="o", markersize=4, linestyle="", color=line["color"], label=label)


def _draw_way(figure: Figure, episode: Trajectory) -> None:
    axes: Any = figure.add_axes((-0.005, 0.03, 0.5, 0.92), projection="3d", computed_zorder=False)
    axes.view_init(**VIEW)
    axes.set_proj_type("ortho")
    radius = radius_of(episode)
    rings = _ring_radii(float(episode.range.max()))
    angle = np.linspace(0.0, 2.0 * np.pi, 361)
    for ring in rings:
        circle = ring * np.stack((np.cos(angle), np.sin(angle), np.zeros_like(angle)), axis=-1)
        _draw_line(axes, circle, radius, color=PALE, linewidth=0.9)
        place = circle[np.searchsorted(angle, np.radians(VIEW["azim"] + 360.0 - 62.0))]
        axes.text(*place, f"{ring:g} m", color=GREY, fontsize=7, ha="center", va="center", zorder=3)
    _draw_sphere(axes, radius)
    front = episode.points @ towards() > 0.0
    several = len(episode.deputies) > 1
    for which, dot in point_colours(episode):
        axes.scatter(*episode.points[which & front].T, s=4.0, color=dot, depthshade=False, linewidths=0, zorder=2)
    for index, name in enumerate(episode.deputies):
        line, way = deputy_line(index), episode.position[:, index]
        _draw_line(axes, way, radius, linewidth=1.4, label=f"deputy {name}", **line)
        for row, face, marker in ((0, "white", "o"), (-1, line["color"], "s")):
            axes.plot(
                *way[row, :, None], linestyle="", marker=marker, markersize=6, markeredgecolor=line["color"], zorder=5,
                markerfacecolor=face, markeredgewidth=1.3,
            )  # fmt: skip
    ink = BLACK if several else deputy_line(0)["color"]
    for face, marker, label in (("white", "o", "start"), (ink, "s", "end")):
        axes.plot(
            [], [], [], linestyle="", marker=marker, markersize=6, markeredgecolor=ink, markerfacecolor=face,
            markeredgewidth=1.3, label=label,
        )  # fmt: skip
    for row, dashes, label in ((0, "-", "sun at the start"), (-1, (0, (2, 1.5)), "sun at the end")):
        _draw_sun(axes, episode.sun_direction[row], rings[-1], dashes, label)
    _fit(axes, episode, rings[-1])
    axes.set(xlabel=_AXES[0], ylabel=_AXES[1])
    _draw_legends(figure, axes, len(episode.deputies))


def _draw_legends(figure: Figure, axes: Any, deputies: int) -> None:
    """Write the legend; several deputies stand in rows of four, and below them what is the same for all."""
    handles, labels = axes.get_legend_handles_labels()
    cuts = [*range(0, deputies, 4), deputies] if deputies > 1 else [0]
    for index, (first, last) in enumerate(zip(cuts, [*cuts[1:], None], strict=True)):
        place: Any = {"loc": "upper left", "bbox_to_anchor": (0.01, 0.985 - 0.035 * index)}
        spacing = 1.3 if deputies == 1 else 1.1
        figure.legend(
            handles[first:last], labels[first:last], ncols=5, columnspacing=spacing, handlelength=1.6, **place
        )


def _draw_line(axes: Any, way: FloatArray, radius: float, label: str | None = None, **kwargs: Any) -> None:
    """Draw a line; what the chief hides lies behind it (Matplotlib sorts whole lines only)."""
    sight = towards()
    depth = way @ sight
    off_axis = np.square(way - depth[:, None] * sight).sum(axis=-1)
    hidden = (depth < 0.0) & (off_axis < radius * radius)
    for order, which in ((1, hidden), (3, ~hidden)):
        shown = which.copy()
        shown[1:] |= which[:-1]  # the pieces meet
        axes.plot(
            *np.where(shown[:, None], way, np.nan).T, zorder=order - (kwargs["color"] == PALE), **kwargs,
            label=label if order == 3 else None,
        )  # fmt: skip


def _ring_radii(reach: float) -> list[float]:
    """Return one to four round radii within what is to be shown."""
    for step in (5.0, 10.0, 20.0, 25.0, 50.0, 100.0, 200.0, 250.0, 500.0):
        if reach / step < 5.0:
            return [step * (index + 1) for index in range(max(int(reach / step), 1))]
    return [reach / 2.0, reach]


def _draw_sphere(axes: Any, radius: float) -> None:
    longitude, latitude = np.meshgrid(np.linspace(0.0, 2.0 * np.pi, 37), np.linspace(-np.pi / 2.0, np.pi / 2.0, 19))
    x, y = radius * np.cos(latitude) * np.cos(longitude), radius * np.cos(latitude) * np.sin(longitude)
    axes.plot_surface(x, y, radius * np.sin(latitude), color="#D8D8D8", linewidth=0, antialiased=False, zorder=2)


def _draw_sun(axes: Any, direction: FloatArray, ring: float, dashes: Any, label: str) -> None:
    """Draw an arrow from the chief towards the sun, outside of the innermost part."""
    tail, tip = direction * 0.55 * ring, direction * 1.0 * ring
    axes.plot(*np.stack((tail, tip), axis=-1), color=ORANGE, linewidth=1.8, linestyle=dashes, label=label, zorder=4)
    aside = np.array([-direction[1], direction[0], 0.0])
    barbs = [tip - 0.08 * ring * direction + side * 0.045 * ring * aside for side in (1.0, -1.0)]
    axes.plot(*np.stack((barbs[0], tip, barbs[1]), axis=-1), color=ORANGE, linewidth=1.8, zorder=4)


def _fit(axes: Any, episode: Trajectory, ring: float) -> None:
    """Give the three axes one scale, with room for the way, the chief and the outermost ring."""
    ways = episode.position.reshape(-1, 3)
    reach = np.array([ring, ring, max(radius_of(episode), 0.6 * ring)])
    low, high = np.minimum(ways.min(axis=0), -reach), np.maximum(ways.max(axis=0), reach)
    pad = 0.03 * (high - low).max()
    low, high = low - pad, high + pad
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axes.set_box_aspect(high - low, zoom=0.99)
    axes.text(high[0], high[1], high[2] + 2.0 * pad, _AXES[2], ha="center", va="bottom")
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.pane.set_visible(False)
    axes.grid(False)
    axes.locator_params(nbins=5)
    axes.tick_params(pad=0.0)
