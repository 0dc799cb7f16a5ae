"""The chief in the figure of an episode: its points from two sides, with when and by whom they were inspected."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from safe_inspect.dones.base import DoneStatus
from safe_inspect.evaluation.trajectory import Trajectory
from safe_inspect.figures.drawing import SEQUENTIAL, deputy_line, deputy_marker
from safe_inspect.geometry.picture import BLACK, FRONT, GREY, VERMILION, Camera, circle
from safe_inspect.types import BoolArray, FloatArray

if TYPE_CHECKING:
    from matplotlib.figure import Figure


_RIGHT = 0.985
_FARTHEST = 1000.0
_ENDINGS = {
    DoneStatus.WIN: "success",
    DoneStatus.LOSE: "lost",
    DoneStatus.DRAW: "neither won nor lost",
}


def clock(episode: Trajectory) -> tuple[float, str]:
    """Return the unit of time of the figure, in seconds, and its symbol."""
    return (3600.0, "h") if episode.time[-1] >= 86_400.0 else (60.0, "min")


def radius_of(episode: Trajectory) -> float:
    """Return the radius of the sphere of points [m]."""
    return float(np.sqrt(np.square(episode.points).sum(axis=-1)).max(initial=0.0))


def reach_of(episode: Trajectory) -> float:
    """Return the largest range that is shown [m].

    A deputy that drifts far away would make everything else too small, so ranges are shown up to 1 km, or 1.5 times the
    deputies' largest range at the start if that is more.
    """
    most = max(_FARTHEST, 1.5 * float(episode.range[0].max()))
    return float(episode.range[episode.range <= most].max())


def point_colours(episode: Trajectory) -> list[tuple[BoolArray, str]]:
    """Return masks of points with their colours: the points of each deputy, and those that nobody has inspected."""
    owners = [(episode.inspector == index, deputy_line(index)["color"]) for index in range(len(episode.deputies))]
    return [*owners, (~np.isfinite(episode.inspected_at), GREY)]


def ending(episode: Trajectory) -> str:
    """Return how an episode ended, in words; empty while it is running."""
    return _ENDINGS.get(episode.status, "")


def draw_chief(figure: Figure, episode: Trajectory) -> None:
    """Draw the chief from two opposite sides, so that every point is visible, and a legend of the colours."""
    radius = radius_of(episode)
    seen = np.isfinite(episode.inspected_at)
    several = len(episode.deputies) > 1
    for column, camera in enumerate((FRONT, Camera.along(-FRONT.sight))):
        axes: Any = figure.add_axes((0.02 + 0.175 * column, 0.03, 0.17, 0.235))
        front, flat = episode.points @ camera.sight > 0.0, camera.flat(episode.points)
        axes.fill(*circle(radius, 181).T, facecolor="#F2F2F2", edgecolor=GREY, linewidth=0.7)
        (_by_inspector if several else _by_time)(axes, episode, flat, front & seen)
        missed = flat[front & ~seen]
        axes.scatter(
            missed[:, 0], missed[:, 1], s=22, marker="x", color=BLACK if several else VERMILION, linewidths=1.3
        )
        axes.set_aspect("equal")
        axes.set_axis_off()
        axes.set_title("from behind" if column else "chief as above", pad=2.0, fontsize=8.5)
    (_inspectors_key if several else _time_key)(figure, episode)
    if not seen.all():
        ink = BLACK if several else VERMILION
        figure.text(0.1925, 0.012, "crosses: not inspected", fontsize=8, color=ink, ha="center")


def draw_summary(figure: Figure, episode: Trajectory) -> None:
    """Write the line at the top: inspected points, time, delta-v, and how the episode ended."""
    scale, unit = clock(episode)
    text = f"after {episode.time[-1] / scale:.1f} {unit}"
    if len(episode.points):
        text = f"{int(np.isfinite(episode.inspected_at).sum())} of {len(episode.points)} points inspected {text}"
    spent = float(episode.delta_v[-1].sum())
    text += f", delta-v {spent:.3g} m/s{' in all' if len(episode.deputies) > 1 else ''}"
    text += f" ({ending(episode)})" if ending(episode) else ""
    figure.text(_RIGHT, 0.985, text, fontsize=9.5, color=BLACK, ha="right", va="top")


def time_norm(episode: Trajectory) -> Any:
    """Return the colour scale of time, in the figure's unit of time."""
    from matplotlib.colors import Normalize

    return Normalize(0.0, float(episode.time[-1]) / clock(episode)[0])


def _by_time(axes: Any, episode: Trajectory, flat: FloatArray, shown: BoolArray) -> None:
    when = episode.inspected_at[shown] / clock(episode)[0]
    axes.scatter(
        *flat[shown].T, c=when, cmap=SEQUENTIAL, norm=time_norm(episode), s=22, edgecolors="white", linewidths=0.4
    )


def _by_inspector(axes: Any, episode: Trajectory, flat: FloatArray, shown: BoolArray) -> None:
    """Draw the points in the colour of the deputy that inspected them first; points inspected earlier are larger."""
    for index in range(len(episode.deputies)):
        own = shown & (episode.inspector == index)
        size = 34.0 - 22.0 * episode.inspected_at[own] / episode.time[-1]
        colour, marker = deputy_line(index)["color"], deputy_marker(index)
        axes.scatter(*flat[own].T, color=colour, marker=marker, s=size, edgecolors="white", linewidths=0.4)


def _time_key(figure: Figure, episode: Trajectory) -> None:
    from matplotlib.cm import ScalarMappable

    place = figure.add_axes((0.40, 0.05, 0.012, 0.185))
    label = f"inspected at [{clock(episode)[1]}]"
    bar = figure.colorbar(ScalarMappable(time_norm(episode), SEQUENTIAL), cax=place, label=label)
    bar.outline.set_linewidth(0.5)  # type: ignore[operator]


def _inspectors_key(figure: Figure, episode: Trajectory) -> None:
    """Draw a legend with the number of points that each deputy was the first to inspect."""
    from matplotlib.lines import Line2D

    counts = [int((episode.inspector == index).sum()) for index in range(len(episode.deputies))]
    handles = [
        Line2D([], [], linestyle="", marker=deputy_marker(index), markersize=5, color=deputy_line(index)["color"])
        for index in range(len(counts))
    ]
    labels = [f"{name}: {count}" for name, count in zip(episode.deputies, counts, strict=True)]
    place: Any = {"loc": "center left", "bbox_to_anchor": (0.38, 0.15), "handlelength": 0.6, "borderpad": 0.0}
    place["labelspacing"] = 0.5 if len(counts) <= 6 else 0.15
    title = "first seen by\n(larger: earlier)"
    figure.legend(handles, labels, title=title, title_fontsize=8, alignment="left", **place)
