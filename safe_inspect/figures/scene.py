"""The scene in the figure of an episode: chief, trajectories, burns and sun, to scale."""

from __future__ import annotations

from typing import Any

import numpy as np

from safe_inspect.evaluation.recorder import Trajectory
from safe_inspect.figures.drawing import Figure, deputy_line, reach_of
from safe_inspect.geometry.distance import lengths
from safe_inspect.geometry.picture import BLACK, FRONT, GREY, ORANGE, PALE, VIEW, pieces, ring, sun_arrow
from safe_inspect.types import FloatArray

_AXES = ("x radial [m]", "y along track [m]", "z cross track [m]")  # for a chief in orbit
_PLAIN_AXES = ("x [m]", "y [m]", "z [m]")
#: Number of times at which the cameras are drawn.
_CAMERAS = 12
_MOST_BURNS = 80  # number of a deputy's burns that are drawn, the largest ones
#: Up to this number of burns of a deputy, strokes have a minimum length, so that the smallest burn is visible too.
FEW_BURNS = 20
_TURN = 2.0 * np.pi


def draw_scene(figure: Figure, episode: Trajectory) -> None:
    """Draw the trajectories of the deputies about the chief, or about the origin in a task without one."""
    place = (0.0, 0.318, 0.53, 0.625) if len(episode.points) else (0.0, 0.19, 0.53, 0.625)
    axes: Any = figure.add_axes(place, projection="3d", computed_zorder=False)
    axes.view_init(**VIEW)
    axes.set_proj_type("ortho")
    reach = reach_of(episode)
    radius, rings = episode.radius, ring_radii(reach)
    _draw_rings(axes, rings, radius)
    if radius:
        _draw_chief(axes, radius)
    for index, name in enumerate(episode.deputies):
        line, way = deputy_line(index), _shown(episode.position[:, index], reach)
        _draw_line(axes, way, radius, linewidth=1.4, label=f"deputy {name}", **line)
        for row, marker in ((0, "o"), (-1, "s")):
            _draw_mark(axes, marker, line["color"], way[row, :, None], zorder=6)
    several = len(episode.deputies) > 1
    ink = BLACK if several else deputy_line(0)["color"]
    for marker, label in (("o", "start"), ("s", "end")):
        _draw_mark(axes, marker, ink, ([], [], []), label=label)
    _draw_burns(axes, episode, rings[-1])
    _draw_cameras(axes, episode, rings[-1])
    if episode.sun_direction is not None:
        _draw_sun(axes, episode, episode.sun_direction, rings[-1])
    _fit(axes, episode, 1.1 * rings[-1])
    names = _axes_of(episode)
    axes.set(xlabel=names[0], ylabel=names[1])
    _draw_legends(figure, axes, len(episode.deputies))


def _draw_mark(axes: Any, marker: str, colour: str, place: Any, **look: Any) -> None:
    """Draw the start of a trajectory, an empty circle, or its end, a square."""
    face = colour if marker == "s" else "white"
    edge: Any = {"markersize": 6, "markeredgecolor": colour, "markeredgewidth": 1.3}
    axes.plot(*place, linestyle="", marker=marker, markerfacecolor=face, **edge, **look)


def _axes_of(episode: Trajectory) -> tuple[str, str, str]:
    return _AXES if episode.mean_motion else _PLAIN_AXES


def _shown(way: FloatArray, reach: float) -> FloatArray:
    """Return a trajectory up to the last state within the range that is shown."""
    inside = np.flatnonzero(np.square(way).sum(axis=-1) <= reach * reach * (1.0 + 1e-9))
    return way[: inside[-1] + 1] if len(inside) else way[:1]


def _draw_rings(axes: Any, rings: list[float], radius: float) -> None:
    azimuth = np.radians(VIEW["azim"] - 84.0)
    for index, reach in enumerate(rings):
        _draw_line(axes, ring(reach, 361), radius, color=PALE, linewidth=0.9)
        if len(rings) > 2 and index < len(rings) - 1:
            continue  # the labels would overlap each other or the trajectories
        place = reach * np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
        axes.text(
            *place, f"{reach:g} m", color=GREY, fontsize=7, ha="center", va="center", zorder=2,
            bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.8},
        )  # fmt: skip


def _draw_chief(axes: Any, radius: float) -> None:
    longitude, latitude = np.meshgrid(np.linspace(0.0, _TURN, 37), np.linspace(-np.pi / 2.0, np.pi / 2.0, 19))
    x, y = radius * np.cos(latitude) * np.cos(longitude), radius * np.cos(latitude) * np.sin(longitude)
    axes.plot_surface(x, y, radius * np.sin(latitude), color="#D8D8D8", linewidth=0, antialiased=False, zorder=2)


def _draw_line(axes: Any, way: FloatArray, radius: float, label: str | None = None, **kwargs: Any) -> None:
    """Draw a line; the part that the chief hides is drawn behind it, as Matplotlib only sorts whole lines."""
    hidden = FRONT.hidden(way, radius)
    for order, which in ((1, hidden), (3, ~hidden)):
        place = order - (kwargs["color"] == PALE)
        axes.plot(*pieces(way, which[:, None]).T, zorder=place, label=label if order == 3 else None, **kwargs)


def largest_burns(episode: Trajectory, deputy: int) -> np.ndarray[Any, np.dtype[np.int64]]:
    """Return the steps of a deputy's largest burns, in order of time, shape (B,)."""
    size = np.square(episode.thrust[:, deputy]).sum(axis=-1)
    burning = np.flatnonzero(size)
    return np.sort(burning[np.argsort(-size[burning], kind="stable")[:_MOST_BURNS]])


def stroke(size: Any, few: bool) -> Any:
    """Return the length of a burn's stroke in radii of the outer ring, given its thrust as a share of the largest."""
    return 0.06 + 0.12 * size if few else 0.15 * size


def _draw_burns(axes: Any, episode: Trajectory, ring: float) -> None:
    """Draw a stroke in the direction of the thrust for every burn; larger burns have longer strokes."""
    norm = lengths(episode.thrust)
    if not norm.any():
        return
    for deputy in range(len(episode.deputies)):
        steps = largest_burns(episode, deputy)
        steps = steps[episode.range[steps, deputy] <= 1.2 * ring]
        if not len(steps):
            continue
        size = norm[steps, deputy, None]
        few = len(steps) <= FEW_BURNS
        length = ring * stroke(size / norm.max(), few)
        foot = episode.position[steps, deputy]
        tip = foot + length * episode.thrust[steps, deputy] / size
        gaps = np.stack((foot, tip, np.full_like(foot, np.nan)), axis=1).reshape(-1, 3)
        axes.plot(*gaps.T, color=BLACK, linewidth=1.3 if few else 0.6, zorder=5, label=None)
        axes.plot(*foot.T, linestyle="", marker="o", color=BLACK, markersize=3.0 if few else 1.2, zorder=5)
    axes.plot([], [], [], color=BLACK, linewidth=1.3, marker="o", markevery=[0], markersize=3.0, label="burn")


def _draw_cameras(axes: Any, episode: Trajectory, ring: float) -> None:
    """Draw the direction of each deputy's camera at a few times: the axis of its cone, and two lines on the cone."""
    if episode.boresight is None or episode.camera is None:
        return
    half = min(episode.camera[1], 0.5 * np.pi)
    steps = np.unique(np.linspace(0, len(episode.time) - 1, _CAMERAS).astype(int))
    for deputy in range(len(episode.deputies)):
        shown = steps[episode.range[steps, deputy] <= 1.2 * ring]
        foot, look = episode.position[shown, deputy], episode.boresight[shown, deputy]
        across = np.cross(look, FRONT.sight)  # approximate outline of the cone in the picture
        across /= np.maximum(lengths(across)[:, None], 1e-9)
        for turn, width in ((0.0, 0.9), (half, 0.5), (-half, 0.5)):
            tip = foot + 0.12 * ring * (np.cos(turn) * look + np.sin(turn) * across)
            gaps = np.stack((foot, tip, np.full_like(foot, np.nan)), axis=1).reshape(-1, 3)
            axes.plot(*gaps.T, color=GREY, linewidth=width, zorder=4)
    axes.plot([], [], [], color=GREY, linewidth=0.9, label="camera")


def _draw_sun(axes: Any, episode: Trajectory, sun: FloatArray, outer: float) -> None:
    """Draw arrows from the chief towards the sun at the start and at the end, and the sun's path between them."""
    for row, dashes, label in ((0, "-", "sun at the start"), (-1, (0, (2, 1.5)), "at the end")):
        arrow = sun_arrow(sun[row], outer).T
        look: Any = {"color": ORANGE, "linewidth": 1.8, "zorder": 4}
        axes.plot(*arrow[:, :2], linestyle=dashes, label=label, **look)
        axes.plot(*arrow[:, 2:], **look)
    turned = np.abs(episode.sun_angle - episode.sun_angle[0])[:, None]  # draws several turns next to each other
    axes.plot(*(sun * outer * (1.0 + 0.035 * turned / _TURN)).T, color=ORANGE, linewidth=0.8, zorder=2)


def ring_radii(reach: float) -> list[float]:
    """Return one to four round radii [m] within the range that is shown."""
    power = 10.0 ** np.floor(np.log10(max(reach, 1.0) / 5.0))
    step = next(float(size * power) for size in (1.0, 2.0, 2.5, 5.0, 10.0) if reach / (size * power) < 5.0)
    return [step * (index + 1) for index in range(max(int(reach / step), 1))]


def _fit(axes: Any, episode: Trajectory, ring: float) -> None:
    """Give the three axes the same scale, with space for the trajectories, the chief and the outermost ring."""
    near = episode.range <= reach_of(episode)
    ways = episode.position[near]
    reach = np.array([ring, ring, max(episode.radius, 0.45 * ring)])
    low, high = np.minimum(ways.min(axis=0), -reach), np.maximum(ways.max(axis=0), reach)
    pad = 0.03 * (high - low).max()
    low, high = low - pad, high + pad
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axes.set_box_aspect(high - low, zoom=1.1)
    axes.text(high[0], high[1], high[2] + 2.0 * pad, _axes_of(episode)[2], ha="right", va="bottom")
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.pane.set_visible(False)
    axes.grid(False)
    axes.locator_params(nbins=5)
    axes.tick_params(pad=0.0)


def _draw_legends(figure: Figure, axes: Any, deputies: int) -> None:
    """Draw the legend: several deputies in rows of four, and below them the common entries."""
    handles, labels = axes.get_legend_handles_labels()
    cuts = [*range(0, deputies, 4), deputies] if deputies > 1 else [0, labels.index("end") + 1]
    for index, (first, last) in enumerate(zip(cuts, [*cuts[1:], None], strict=True)):
        place: Any = {"loc": "upper left", "bbox_to_anchor": (0.01, 0.99 - 0.028 * index), "borderpad": 0.2}
        figure.legend(handles[first:last], labels[first:last], ncols=6, columnspacing=1.1, handlelength=1.5, **place)
