"""The figure of one episode: the way round the chief, what was seen when, and range, coverage and thrust over time."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from safe_inspect.dones.base import DoneStatus
from safe_inspect.evaluation.drawing import (
    BLACK,
    BLUE,
    DEPUTY_COLOURS,
    GREEN,
    GREY,
    ORANGE,
    PALE,
    SEQUENTIAL,
    VERMILION,
    style,
)
from safe_inspect.evaluation.trajectory import Trajectory
from safe_inspect.types import FloatArray

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_VIEW = {"elev": 22.0, "azim": -52.0}
_AXES = ("x radial [m]", "y along track [m]", "z cross track [m]")
_FEW = 20  # burns
_AXIS_COLOURS = (VERMILION, BLUE, GREEN)


def trajectory_figure(episode: Trajectory) -> Figure:
    """Draw an episode.

    Left, the deputies' way round the chief in Hill's frame, with rings of equal range in the orbital plane and the
    direction to the sun at the start and at the end. Beside it the chief from two sides, its points coloured by
    the time of their inspection, and over time the share of inspected points, the range and the thrust.

    Raises:
        SafeInspectError: Matplotlib is not installed.
    """
    with style():
        from matplotlib.figure import Figure

        figure = Figure(figsize=(10.0, 5.4), facecolor="white")
        _draw_way(figure, episode)
        _draw_chief(figure, episode)
        _draw_times(figure, episode)
    return figure


def _clock(episode: Trajectory) -> tuple[float, str]:
    """Return the unit in which the figure tells the time, in seconds, and its symbol."""
    return (3600.0, "h") if episode.time[-1] >= 3600.0 else (60.0, "min")


def _draw_times(figure: Figure, episode: Trajectory) -> None:
    scale, unit = _clock(episode)
    time = episode.time / scale
    coverage, distance, thrust = (figure.add_axes((0.62, bottom, 0.36, 0.14)) for bottom in (0.455, 0.275, 0.095))
    coverage.step(time, 100.0 * episode.coverage, where="post", color=BLACK)
    coverage.set(ylabel="inspected\n[%]", ylim=(0, 104), yticks=(0, 50, 100))
    for index in range(len(episode.deputies)):
        distance.plot(time, episode.range[:, index], color=_colour(index))
    distance.set(ylabel="range\n[m]", ylim=(0, None))
    if len(episode.deputies) == 1:
        lines = [(episode.control[:, 0, axis], colour) for axis, colour in enumerate(_AXIS_COLOURS)]
        labels = ["x", "y", "z"]
    else:
        norm = np.sqrt(np.square(episode.control).sum(axis=-1))
        lines = [(norm[:, index], _colour(index)) for index in range(len(episode.deputies))]
        labels = list(episode.deputies)
    for (values, colour), label in zip(lines, labels, strict=True):
        _draw_thrust(thrust, time, values, colour, label)
    if len(episode.deputies) == 1:
        thrust.legend(
            loc="lower right", bbox_to_anchor=(1.01, 0.9), ncols=3, handlelength=1.0, columnspacing=1.0, borderpad=0.0
        )
    thrust.margins(y=0.15)
    if not episode.control.any():
        thrust.set_ylim(-1.0, 1.0)
    thrust.set(ylabel="thrust\n[N]" if len(episode.deputies) == 1 else "norm of\nthrust [N]", xlabel=f"time [{unit}]")
    for axes in (coverage, distance, thrust):
        axes.set_xlim(-0.015 * time[-1], time[-1])  # a burn at the start is seen beside the axis
        axes.tick_params(labelbottom=axes is thrust)
        axes.yaxis.set_label_coords(-0.125, 0.5)


def _draw_thrust(axes: Any, time: FloatArray, values: FloatArray, colour: str, label: str) -> None:
    """Draw a thrust over time; a few short burns as pins, where lines would cover each other."""
    burns = np.flatnonzero(values)
    if len(burns) > _FEW:
        axes.step(time, np.append(values, 0.0), where="post", color=colour, linewidth=1.2, label=label)
        return
    axes.axhline(0.0, color=GREY, linewidth=0.8, zorder=1)
    axes.vlines(time[burns], 0.0, values[burns], color=colour, linewidth=1.2)
    axes.plot(time[burns], values[burns], marker="o", markersize=4, linestyle="", color=colour, label=label)


def _draw_way(figure: Figure, episode: Trajectory) -> None:
    axes: Any = figure.add_axes((-0.005, 0.03, 0.5, 0.92), projection="3d", computed_zorder=False)
    axes.view_init(**_VIEW)
    axes.set_proj_type("ortho")
    radius = _radius(episode)
    rings = _ring_radii(float(episode.range.max()))
    angle = np.linspace(0.0, 2.0 * np.pi, 361)
    for ring in rings:
        circle = ring * np.stack((np.cos(angle), np.sin(angle), np.zeros_like(angle)), axis=-1)
        _draw_line(axes, circle, radius, color=PALE, linewidth=0.9)
        place = circle[np.searchsorted(angle, np.radians(_VIEW["azim"] + 360.0 - 62.0))]
        axes.text(*place, f"{ring:g} m", color=GREY, fontsize=7, ha="center", va="center", zorder=3)
    _draw_sphere(axes, radius)
    seen = np.isfinite(episode.inspected_at)
    front = episode.points @ _towards() > 0.0
    for which, colour in ((seen, GREEN), (~seen, VERMILION)):
        axes.scatter(*episode.points[which & front].T, s=4.0, color=colour, depthshade=False, linewidths=0, zorder=2)
    for index, name in enumerate(episode.deputies):
        colour, way = _colour(index), episode.position[:, index]
        _draw_line(axes, way, radius, color=colour, linewidth=1.4, label=f"deputy {name}")
        for row, face, marker, label in ((0, "white", "o", "start"), (-1, colour, "s", "end")):
            axes.plot(
                *way[row, :, None], linestyle="", marker=marker, markersize=6, markeredgecolor=colour, zorder=5,
                markerfacecolor=face, markeredgewidth=1.3, label=label if index == 0 else None,
            )  # fmt: skip
    for row, dashes, label in ((0, "-", "sun at the start"), (-1, (0, (2, 1.5)), "sun at the end")):
        _draw_sun(axes, episode.sun_direction[row], rings[-1], dashes, label)
    _fit(axes, episode, rings[-1])
    axes.set(xlabel=_AXES[0], ylabel=_AXES[1])
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(
        handles, labels, loc="upper left", bbox_to_anchor=(0.01, 0.985), ncols=5, columnspacing=1.3, handlelength=1.6
    )


def _colour(index: int) -> str:
    return DEPUTY_COLOURS[index % len(DEPUTY_COLOURS)]


def _radius(episode: Trajectory) -> float:
    """Return the radius of the sphere of points [m]."""
    return float(np.sqrt(np.square(episode.points).sum(axis=-1)).max(initial=0.0))


def _towards(turn: float = 0.0) -> FloatArray:
    """Return the unit vector to the reader, who may look from a place turned about z [degrees]."""
    elevation, azimuth = np.radians(_VIEW["elev"]), np.radians(_VIEW["azim"] + turn)
    horizontal = np.cos(elevation)
    return np.array([horizontal * np.cos(azimuth), horizontal * np.sin(azimuth), np.sin(elevation)])


def _draw_line(axes: Any, way: FloatArray, radius: float, label: str | None = None, **kwargs: Any) -> None:
    """Draw a line; what the chief hides lies behind it (Matplotlib sorts whole lines only)."""
    towards = _towards()
    depth = way @ towards
    off_axis = np.square(way - depth[:, None] * towards).sum(axis=-1)
    hidden = (depth < 0.0) & (off_axis < radius * radius)
    for order, which in ((1, hidden), (3, ~hidden)):
        shown = which.copy()
        shown[1:] |= which[:-1]  # the pieces meet
        axes.plot(
            *np.where(shown[:, None], way, np.nan).T, zorder=order - (kwargs["color"] == PALE), **kwargs,
            label=label if order == 3 else None,
        )  # fmt: skip


def _draw_chief(figure: Figure, episode: Trajectory) -> None:
    """Draw the chief from two opposite sides, so that every point is seen."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    radius = _radius(episode)
    seen = np.isfinite(episode.inspected_at)
    scale, unit = _clock(episode)
    norm = Normalize(0.0, float(episode.time[-1]) / scale)
    for column, turn in enumerate((0.0, 180.0)):
        axes = figure.add_axes((0.575 + 0.16 * column, 0.64, 0.155, 0.265))
        towards = _towards(turn)
        right = np.cross((0.0, 0.0, 1.0), towards)
        right /= np.sqrt(np.square(right).sum())
        up = np.cross(towards, right)
        front = episode.points @ towards > 0.0
        flat = np.stack((episode.points @ right, episode.points @ up), axis=-1)
        angle = np.linspace(0.0, 2.0 * np.pi, 181)
        axes.fill(radius * np.cos(angle), radius * np.sin(angle), facecolor="#F2F2F2", edgecolor=GREY, linewidth=0.7)
        shown, missed = front & seen, front & ~seen
        when = episode.inspected_at[shown] / scale
        axes.scatter(
            flat[shown, 0], flat[shown, 1], c=when, cmap=SEQUENTIAL, norm=norm, s=20, edgecolors="white", linewidths=0.4
        )
        axes.scatter(flat[missed, 0], flat[missed, 1], s=22, marker="x", color=VERMILION, linewidths=1.3)
        axes.set_aspect("equal")
        axes.set_axis_off()
        axes.set_title("as on the left" if turn == 0.0 else "from behind", pad=2.0, fontsize=8.5)
    bar = figure.colorbar(
        ScalarMappable(norm, SEQUENTIAL), cax=figure.add_axes((0.915, 0.67, 0.012, 0.2)), label=f"inspected at [{unit}]"
    )
    bar.outline.set_linewidth(0.5)
    spent = f"{episode.time[-1] / scale:.2f} {unit}"
    text = f"{int(seen.sum())} of {len(seen)} points inspected after {spent}"
    if episode.status is not DoneStatus.RUNNING:
        text += f" ({episode.status.name.lower()})"
    figure.text(0.58, 0.955, text, fontsize=9.5, color=BLACK)
    if not seen.all():
        figure.text(0.7325, 0.625, "crosses: not inspected", fontsize=8, color=VERMILION, ha="center")


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
    reach = np.array([ring, ring, max(_radius(episode), 0.6 * ring)])
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
