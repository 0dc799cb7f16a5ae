"""The figure of one episode: the way round the chief, what was seen when, and range, coverage and thrust over time."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from safe_inspect.evaluation.drawing import BLACK, DEPUTY_COLOURS, GREEN, GREY, ORANGE, PALE, SEQUENTIAL, VERMILION, style
from safe_inspect.evaluation.trajectory import Trajectory
from safe_inspect.types import FloatArray

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_VIEW = {"elev": 24.0, "azim": -58.0}
_AXES = ("x radial [m]", "y along track [m]", "z cross track [m]")
_AXIS_COLOURS = (VERMILION, "#0072B2", GREEN)


def trajectory_figure(episode: Trajectory) -> Figure:
    """Draw an episode.

    Left, the deputies' way round the chief in Hill's frame, with rings of equal range in the orbital plane and the
    direction to the sun at the start and at the end. Beside it the chief, its points coloured by the time of
    their inspection, and over time the share of inspected points, the range and the thrust.

    Raises:
        SafeInspectError: Matplotlib is not installed.
    """
    with style():
        from matplotlib.figure import Figure

        figure = Figure(figsize=(10.0, 5.4), facecolor="white")
        hours = episode.time / 3600.0
        _draw_way(figure.add_axes((0.0, 0.03, 0.5, 0.94), projection="3d"), episode)
        _draw_chief(figure, episode)
        left, width, height = 0.555, 0.425, 0.145
        coverage, distance, thrust = (figure.add_axes((left, bottom, width, height)) for bottom in (0.455, 0.275, 0.095))
        coverage.step(hours, 100.0 * episode.coverage, where="post", color=BLACK)
        coverage.set(ylabel="inspected\n[%]", ylim=(0, 104), yticks=(0, 50, 100))
        for index, name in enumerate(episode.deputies):
            colour = DEPUTY_COLOURS[index % len(DEPUTY_COLOURS)]
            distance.plot(hours, episode.range[:, index], color=colour, label=name)
        distance.set(ylabel="range\n[m]", ylim=(0, None))
        _draw_thrust(thrust, episode, hours)
        for axes in (coverage, distance, thrust):
            axes.set_xlim(0, hours[-1])
            axes.label_outer()
        thrust.set_xlabel("time [h]")
        figure.align_ylabels((coverage, distance, thrust))
    return figure


def _draw_thrust(axes: Any, episode: Trajectory, hours: FloatArray) -> None:
    """One deputy: the thrust by axis. Several: the norm of each one's thrust."""
    if len(episode.deputies) == 1:
        for axis, colour in enumerate(_AXIS_COLOURS):
            values = np.append(episode.control[:, 0, axis], 0.0)
            axes.step(hours, values, where="post", color=colour, label="xyz"[axis], linewidth=1.1)
        axes.legend(loc="upper right", ncols=3, handlelength=1.0, columnspacing=1.0, borderaxespad=0.1)
        axes.margins(y=0.12)
    else:
        norm = np.sqrt(np.square(episode.control).sum(axis=-1))
        for index in range(len(episode.deputies)):
            colour = DEPUTY_COLOURS[index % len(DEPUTY_COLOURS)]
            axes.step(hours, np.append(norm[:, index], 0.0), where="post", color=colour, linewidth=1.1)
    axes.set_ylabel("thrust\n[N]")


def _draw_way(axes: Any, episode: Trajectory) -> None:
    position = episode.position
    reach = float(episode.range.max())
    rings = _ring_radii(reach)
    axes.view_init(**_VIEW)
    axes.set_proj_type("ortho")
    for radius in rings:
        _draw_ring(axes, radius)
    radius = float(np.sqrt(np.square(episode.points).sum(axis=-1)).max(initial=0.0))
    _draw_sphere(axes, radius)
    seen = np.isfinite(episode.inspected_at)
    for which, colour in ((seen, GREEN), (~seen, VERMILION)):
        axes.scatter(*episode.points[which].T, s=2.5, color=colour, depthshade=False, linewidths=0)
    for index, name in enumerate(episode.deputies):
        colour = DEPUTY_COLOURS[index % len(DEPUTY_COLOURS)]
        axes.plot(*position[:, index].T, color=colour, linewidth=1.3, label=f"deputy {name}")
        for row, marker, label in ((0, "o", "start"), (-1, "s", "end")):
            face = "white" if row == 0 else colour
            axes.plot(
                *position[row, index, :, None], linestyle="", marker=marker, markersize=6, markeredgecolor=colour,
                markerfacecolor=face, markeredgewidth=1.3, label=label if index == 0 else None,
            )  # fmt: skip
    for row, shade, label in ((0, 1.0, "sun at the start"), (-1, 0.5, "sun at the end")):
        _draw_sun(axes, episode.sun_direction[row], 0.5 * rings[-1], rings[-1], shade, label)
    _fit(axes, position.reshape(-1, 3), rings[-1])
    axes.set(xlabel=_AXES[0], ylabel=_AXES[1], zlabel=_AXES[2])
    axes.legend(loc="upper left", bbox_to_anchor=(0.02, 1.0), ncols=2, columnspacing=1.2, handlelength=1.6)


def _draw_chief(figure: Figure, episode: Trajectory) -> None:
    """Draw the chief from two opposite sides, so that every point is seen."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    radius = float(np.sqrt(np.square(episode.points).sum(axis=-1)).max(initial=0.0))
    seen = np.isfinite(episode.inspected_at)
    norm = Normalize(0.0, float(episode.time[-1]) / 3600.0)
    elevation = np.radians(_VIEW["elev"])
    for column, turn in enumerate((0.0, 180.0)):
        axes = figure.add_axes((0.555 + 0.165 * column, 0.655, 0.16, 0.27))
        azimuth = np.radians(_VIEW["azim"] + turn)
        right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
        towards = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
        up = np.cross(towards, right)
        front = episode.points @ towards > 0.0
        flat = np.stack((episode.points @ right, episode.points @ up), axis=-1)
        angle = np.linspace(0.0, 2.0 * np.pi, 181)
        axes.fill(radius * np.cos(angle), radius * np.sin(angle), facecolor="#F2F2F2", edgecolor=GREY, linewidth=0.7)
        shown = front & seen
        when = episode.inspected_at[shown] / 3600.0
        axes.scatter(*flat[shown].T, c=when, cmap=SEQUENTIAL, norm=norm, s=20, edgecolors="white", linewidths=0.4)
        axes.scatter(*flat[front & ~seen].T, s=22, marker="x", color=VERMILION, linewidths=1.3)
        axes.set_aspect("equal")
        axes.set_axis_off()
        axes.set_title("seen as on the left" if turn == 0.0 else "from the other side", pad=2.0, fontsize=8.5)
    bar = figure.colorbar(
        ScalarMappable(norm, SEQUENTIAL), cax=figure.add_axes((0.905, 0.68, 0.012, 0.2)), label="inspected at [h]"
    )
    bar.outline.set_linewidth(0.5)
    text = f"{int(seen.sum())} of {len(seen)} points inspected ({episode.status.name.lower()})"
    if not seen.all():
        text += ", × not inspected"
    figure.text(0.555, 0.955, text, fontsize=9.5, color=BLACK)


def _ring_radii(reach: float) -> list[float]:
    """Return two to five round radii, the last at or beyond what is to be shown."""
    for step in (5.0, 10.0, 20.0, 25.0, 50.0, 100.0, 200.0, 250.0, 500.0):
        count = int(np.ceil(reach / step))
        if count <= 4:
            return [step * (index + 1) for index in range(max(count, 2))]
    return [reach / 2.0, reach]


def _draw_ring(axes: Any, radius: float) -> None:
    angle = np.linspace(0.0, 2.0 * np.pi, 181)
    axes.plot(radius * np.cos(angle), radius * np.sin(angle), 0.0 * angle, color=PALE, linewidth=0.8, zorder=0)
    place = np.radians(-118.0)
    axes.text(
        radius * np.cos(place), radius * np.sin(place), 0.0, f"{radius:g} m", color=GREY, fontsize=7, ha="center", va="center"
    )


def _draw_sphere(axes: Any, radius: float) -> None:
    longitude, latitude = np.meshgrid(np.linspace(0.0, 2.0 * np.pi, 37), np.linspace(-np.pi / 2.0, np.pi / 2.0, 19))
    x, y = radius * np.cos(latitude) * np.cos(longitude), radius * np.cos(latitude) * np.sin(longitude)
    axes.plot_surface(x, y, radius * np.sin(latitude), color="#BBBBBB", alpha=0.35, linewidth=0, shade=True)


def _draw_sun(axes: Any, direction: FloatArray, start: float, end: float, shade: float, label: str) -> None:
    tail, tip = direction * start, direction * end
    axes.quiver(
        *tail, *(tip - tail), color=ORANGE, alpha=shade, linewidth=1.8, arrow_length_ratio=0.25,
        linestyle="-" if shade == 1.0 else "--", label=label,
    )  # fmt: skip


def _fit(axes: Any, positions: FloatArray, ring: float) -> None:
    """Give the three axes one scale, with room for the way and the rings."""
    low = np.minimum(positions.min(axis=0), [-ring, -ring, -ring / 4.0])
    high = np.maximum(positions.max(axis=0), [ring, ring, ring / 4.0])
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axes.set_box_aspect(high - low, zoom=1.1)
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.pane.set_visible(False)
        axis._axinfo["grid"].update(color=PALE, linewidth=0.4)
    axes.grid(False)
    axes.locator_params(nbins=5)
