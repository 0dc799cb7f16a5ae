"""`Film`: the pictures of an animated episode."""

from __future__ import annotations

from typing import Any

import numpy as np

from safe_inspect.evaluation.episodes import Trajectory
from safe_inspect.figures.drawing import clock, deputy_line, radius_of, reach_of, style
from safe_inspect.figures.film_views import ApproachView, ChiefView, Moment, moment
from safe_inspect.figures.pictures import Pictures
from safe_inspect.figures.scene import ring_radii
from safe_inspect.geometry.picture import (
    BLACK,
    DAY,
    GREY,
    NIGHT,
    ORANGE,
    PALE,
    VIEW,
    Camera,
    circle,
    pieces,
    ring,
    sun_arrow,
)

_DPI = 100


class Film(Pictures):
    """Pictures of an episode: the trajectory so far, counters, and panels that depend on the task.

    For an inspection these are the chief from two sides, the sun and the coverage; for a task without points, speed
    over range with the speed limit, and range over time.

    Args:
        episode: The episode.
        frames: Number of pictures, at least 2; they are equally spaced in time.
        width: Width of a picture [pixels]; it is 1.6 times its height.
        turn: Angle by which the camera turns around the chief from the first picture to the last [degrees].

    Raises:
        SafeInspectError: Matplotlib is not installed.
        ValueError: A number is out of range.
    """

    def __init__(self, episode: Trajectory, frames: int = 150, width: int = 800, turn: float = 0.0) -> None:
        super().__init__(frames, width)
        self.episode = episode
        self._turn = turn
        self._inspects = bool(len(episode.points)) and "sun_angle" in episode.arrays
        self._radius = radius_of(episode) or episode.docking_radius
        with style():
            self._build()

    def _build(self) -> None:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        width, height = self._size
        # The resolution grows with the width, so that fonts and lines keep their relative sizes.
        figure = Figure(figsize=(8.0, 8.0 * height / width), dpi=_DPI * width / 800.0, facecolor="white")
        self._canvas = FigureCanvasAgg(figure)
        self._build_scene(figure)
        view = ChiefView if self._inspects else ApproachView
        self._side: ChiefView | ApproachView = view(figure, self.episode)
        self._build_panels(figure)

    def _build_scene(self, figure: Any) -> None:
        episode, radius = self.episode, self._radius
        self._axes = axes = figure.add_axes((0.0, 0.0, 0.6, 1.0))
        axes.set_axis_off()
        axes.set_aspect("equal")
        self._ring = ring_radii(reach_of(episode))
        near = episode.position[episode.range <= reach_of(episode)]
        turns = np.linspace(0.0, self._turn, 9)
        corners = [Camera.at(VIEW["elev"], VIEW["azim"] + turn).flat(near) for turn in turns]
        reach = np.abs(np.concatenate(corners)).max(axis=0)
        wide = max(float(reach[0]), 1.22 * self._ring[-1])
        tall = max(1.06 * float(reach[1]), 0.6 * self._ring[-1])  # the line of text is above it
        aspect = 0.6 * self._size[0] / self._size[1]
        half = 1.06 * max(wide, tall * aspect)
        axes.set(xlim=(-half, half), ylim=(-half / aspect, half / aspect))
        self._rings = [axes.plot([], [], color=PALE, linewidth=0.9, zorder=1)[0] for _ in self._ring]
        self._labels = [
            axes.text(0.0, 0.0, f"{ring:g} m", color=GREY, fontsize=7.5, ha="center", va="center", zorder=1.5)
            for ring in self._ring
        ]
        for label in self._labels:
            label.set_bbox({"facecolor": "white", "edgecolor": "none", "pad": 0.8})
        if self._inspects:
            (self._sun,) = axes.plot([], [], color=ORANGE, linewidth=2.2, zorder=2)
            self._sun_label = axes.text(0.0, 0.0, "sun", color=ORANGE, ha="center", va="center", zorder=2)
        else:
            axes.plot([0.0], [0.0], linestyle="", marker="+", markersize=9, color=BLACK, zorder=3)
        (self._night,) = axes.fill(*circle(radius).T, facecolor=NIGHT, edgecolor=BLACK, linewidth=0.6, zorder=3)
        (self._day,) = axes.fill([0.0], [0.0], facecolor=DAY, zorder=3.1)
        self._ways = []
        for index, name in enumerate(episode.deputies):
            line = deputy_line(index)
            behind = axes.plot([], [], linewidth=1.6, zorder=2.5, **line)[0]
            front = axes.plot([], [], linewidth=1.6, zorder=4, label=name, **line)[0]
            dot = axes.plot([], [], linestyle="", marker="o", markersize=7, color=line["color"], zorder=5)[0]
            dot.set(markeredgecolor="white", markeredgewidth=1.0)
            self._ways.append((behind, front, dot))
        place = "Hill's frame, seen from above the orbital plane" if episode.mean_motion else "an inertial frame"
        figure.text(0.02, 0.955, place, color=GREY, fontsize=8)

    def _build_panels(self, figure: Any) -> None:
        episode = self.episode
        scale, unit = clock(episode)
        self._counters = [
            figure.text(place, 0.955, "", fontsize=8.5, color=BLACK, va="center", ha=side)
            for place, side in ((0.615, "left"), (0.765, "center"), (0.985, "right"))
        ]
        self._panels = []
        end = float(episode.time[-1]) / scale
        first = ("inspected [%]", 104.0) if self._inspects else ("range [m]", 1.08 * reach_of(episode))
        second = ("delta-v [m/s]", 1.08 * float(episode.delta_v[-1].max()) or 1.0)
        for bottom, (label, top) in ((0.325, first), (0.1, second)):
            axes = figure.add_axes((0.675, bottom, 0.305, 0.17))
            axes.set(xlim=(0.0, end), ylim=(0.0, top), ylabel=label)
            axes.yaxis.set_label_coords(-0.15, 0.5)
            axes.locator_params(axis="y", nbins=4)
            if label == "inspected [%]":
                axes.set_yticks((0, 50, 100))
                lines = [axes.step([], [], where="post", color=BLACK)[0]]
            else:
                lines = [axes.plot([], [], **deputy_line(index))[0] for index in range(len(episode.deputies))]
            self._panels.append(lines)
        self._panels[0][0].axes.tick_params(labelbottom=False)
        self._panels[1][0].axes.set_xlabel(f"time [{unit}]")

    def _show(self, share: float) -> None:
        now, turned = moment(self.episode, share * float(self.episode.time[-1])), share * self._turn
        episode, radius = self.episode, self._radius
        front = Camera.at(VIEW["elev"], VIEW["azim"] + turned)
        left = np.radians(VIEW["azim"] + turned - 84.0)
        for reach, line, label in zip(self._ring, self._rings, self._labels, strict=True):
            line.set_data(*front.flat(ring(reach)).T)
            label.set_position(front.flat(reach * np.array([np.cos(left), np.sin(left), 0.0])).tolist())
        if self._inspects and now.sun is not None:
            outer = self._ring[-1]
            self._sun.set_data(*front.flat(sun_arrow(now.sun, outer)).T)
            self._sun_label.set_position(front.flat(1.13 * outer * now.sun).tolist())
            self._day.set_xy(front.day(now.sun, radius))
            self._day.set_visible(not now.eclipse)
        for index, (line_behind, line_front, dot) in enumerate(self._ways):
            way = np.concatenate((episode.position[: now.row + 1, index], now.position[None, index]))
            hidden = front.hidden(way, radius)
            flat = front.flat(way)
            for line, which in ((line_behind, hidden), (line_front, ~hidden)):
                line.set_data(*pieces(flat, which).T)
            dot.set_data(*flat[-1:].T)
            dot.set_zorder(2.6 if hidden[-1] else 5)
        self._side.show(now, front)
        self._write_counters(now)

    def _write_counters(self, now: Moment) -> None:
        episode = self.episode
        scale, unit = clock(episode)
        time = np.append(episode.time[: now.row + 1], now.time) / scale
        far = np.sqrt(np.square(now.position).sum(axis=-1))
        count = int(now.seen.sum())
        counters = (
            f"{now.time / scale:.1f} {unit}",
            f"{count} of {len(now.seen)} points" if self._inspects else f"{far.min():.1f} m",
            f"delta-v {now.delta_v.sum():.3f} m/s",
        )
        for text, words in zip(self._counters, counters, strict=True):
            text.set_text(words)
        if self._inspects:
            self._panels[0][0].set_data(time, 100.0 * np.append(episode.coverage[: now.row + 1], count / len(now.seen)))
        else:
            for index, line in enumerate(self._panels[0]):
                line.set_data(time, np.append(episode.range[: now.row + 1, index], far[index]))
        for index, line in enumerate(self._panels[1]):
            line.set_data(time, np.append(episode.delta_v[: now.row + 1, index], now.delta_v[index]))
