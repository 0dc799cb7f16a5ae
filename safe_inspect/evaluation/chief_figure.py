"""The chief in the figure of an episode: its points from two sides, when they were inspected and by whom."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from safe_inspect.dones.base import DoneStatus
from safe_inspect.evaluation.drawing import BLACK, GREEN, GREY, SEQUENTIAL, VERMILION, deputy_line, deputy_marker
from safe_inspect.evaluation.trajectory import Trajectory
from safe_inspect.types import BoolArray, FloatArray

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: From where the reader looks at the chief [degrees].
VIEW = {"elev": 22.0, "azim": -52.0}


def clock(episode: Trajectory) -> tuple[float, str]:
    """Return the unit in which the figure tells the time, in seconds, and its symbol."""
    return (3600.0, "h") if episode.time[-1] >= 3600.0 else (60.0, "min")


def radius_of(episode: Trajectory) -> float:
    """Return the radius of the sphere of points [m]."""
    return float(np.sqrt(np.square(episode.points).sum(axis=-1)).max(initial=0.0))


def towards(turn: float = 0.0) -> FloatArray:
    """Return the unit vector to the reader, who may look from a place turned about z [degrees]."""
    elevation, azimuth = np.radians(VIEW["elev"]), np.radians(VIEW["azim"] + turn)
    horizontal = np.cos(elevation)
    return np.array([horizontal * np.cos(azimuth), horizontal * np.sin(azimuth), np.sin(elevation)])


def point_colours(episode: Trajectory) -> list[tuple[BoolArray, str]]:
    """Return the colours of the points on the small chief, each with the points that have it."""
    seen = np.isfinite(episode.inspected_at)
    if len(episode.deputies) == 1:
        return [(seen, GREEN), (~seen, VERMILION)]
    owners = [(episode.inspector == index, deputy_line(index)["color"]) for index in range(len(episode.deputies))]
    return [*owners, (~seen, GREY)]


def draw_chief(figure: Figure, episode: Trajectory) -> None:
    """Draw the chief from two opposite sides, so that every point is seen, and beside it the key of the colours."""
    radius = radius_of(episode)
    seen = np.isfinite(episode.inspected_at)
    several = len(episode.deputies) > 1
    for column, turn in enumerate((0.0, 180.0)):
        axes: Any = figure.add_axes((0.575 + 0.16 * column, 0.64, 0.155, 0.265))
        sight = towards(turn)
        right = np.cross((0.0, 0.0, 1.0), sight)
        right /= np.sqrt(np.square(right).sum())
        up = np.cross(sight, right)
        front = episode.points @ sight > 0.0
        flat = np.stack((episode.points @ right, episode.points @ up), axis=-1)
        angle = np.linspace(0.0, 2.0 * np.pi, 181)
        axes.fill(radius * np.cos(angle), radius * np.sin(angle), facecolor="#F2F2F2", edgecolor=GREY, linewidth=0.7)
        (_by_inspector if several else _by_time)(axes, episode, flat, front & seen)
        missed = flat[front & ~seen]
        axes.scatter(
            missed[:, 0], missed[:, 1], s=22, marker="x", color=BLACK if several else VERMILION, linewidths=1.3
        )
        axes.set_aspect("equal")
        axes.set_axis_off()
        axes.set_title("as on the left" if turn == 0.0 else "from behind", pad=2.0, fontsize=8.5)
    (_inspectors_key if several else _time_key)(figure, episode)
    scale, unit = clock(episode)
    text = f"{int(seen.sum())} of {len(seen)} points inspected after {episode.time[-1] / scale:.2f} {unit}"
    if episode.status is not DoneStatus.RUNNING:
        text += f" ({episode.status.name.lower()})"
    figure.text(0.61 if several else 0.58, 0.955, text, fontsize=9.5, color=BLACK)
    if not seen.all():
        ink = BLACK if several else VERMILION
        figure.text(0.7325, 0.625, "crosses: not inspected", fontsize=8, color=ink, ha="center")


def _by_time(axes: Any, episode: Trajectory, flat: FloatArray, shown: BoolArray) -> None:
    when = episode.inspected_at[shown] / clock(episode)[0]
    norm = _norm(episode)
    axes.scatter(*flat[shown].T, c=when, cmap=SEQUENTIAL, norm=norm, s=20, edgecolors="white", linewidths=0.4)


def _by_inspector(axes: Any, episode: Trajectory, flat: FloatArray, shown: BoolArray) -> None:
    for index in range(len(episode.deputies)):
        own = flat[shown & (episode.inspector == index)]
        colour, marker = deputy_line(index)["color"], deputy_marker(index)
        axes.scatter(*own.T, color=colour, marker=marker, s=20, edgecolors="white", linewidths=0.4)


def _norm(episode: Trajectory) -> Any:
    from matplotlib.colors import Normalize

    return Normalize(0.0, float(episode.time[-1]) / clock(episode)[0])


def _time_key(figure: Figure, episode: Trajectory) -> None:
    from matplotlib.cm import ScalarMappable

    place = figure.add_axes((0.915, 0.67, 0.012, 0.2))
    label = f"inspected at [{clock(episode)[1]}]"
    bar = figure.colorbar(ScalarMappable(_norm(episode), SEQUENTIAL), cax=place, label=label)
    bar.outline.set_linewidth(0.5)  # type: ignore[operator]


def _inspectors_key(figure: Figure, episode: Trajectory) -> None:
    """Tell how many points each deputy was the first to inspect."""
    from matplotlib.lines import Line2D

    counts = [int((episode.inspector == index).sum()) for index in range(len(episode.deputies))]
    handles = [
        Line2D([], [], linestyle="", marker=deputy_marker(index), markersize=5, color=deputy_line(index)["color"])
        for index in range(len(counts))
    ]
    labels = [f"{name}: {count}" for name, count in zip(episode.deputies, counts, strict=True)]
    place: Any = {"loc": "center left", "bbox_to_anchor": (0.893, 0.77), "handlelength": 0.6, "borderpad": 0.0}
    place["labelspacing"] = 0.5 if len(counts) <= 6 else 0.15
    figure.legend(handles, labels, title="first seen by", title_fontsize=8, alignment="left", **place)
