"""`Film`: the pictures of an animated episode, and `moment`, an episode at one time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from safe_inspect.dynamics.quaternion import continuous, normalise, rotate
from safe_inspect.evaluation.recorder import Trajectory
from safe_inspect.figures.drawing import clock, deputy_line, reach_of, speed_limit_of
from safe_inspect.figures.pictures import Pictures
from safe_inspect.figures.scene import ring_radii
from safe_inspect.geometry import picture
from safe_inspect.geometry.distance import lengths
from safe_inspect.tasks.inspection.sun import sun_directions
from safe_inspect.types import BoolArray, FloatArray


@dataclass(frozen=True)
class _Moment:
    """An episode at one time.

    Attributes:
        time: Time since the reset [s].
        position: Position of each deputy [m], shape (D, 3).
        delta_v: Velocity change that each deputy has spent [m/s], shape (D,).
        sun: Unit vector to the sun, shape (3,); None in a task without a sun.
        seen: Mask of the inspected points, shape (P,).
        lit: Mask of the points on the sun's side, shape (P,); all False without a sun.
        points: Position of the points about the chief's centre [m], shape (P, 3).
        row: Index of the last recorded state that is not later.
        eclipse: Whether the Earth hides the sun.
    """

    time: float
    position: FloatArray
    delta_v: FloatArray
    sun: FloatArray | None
    seen: BoolArray
    lit: BoolArray
    points: FloatArray
    row: int
    eclipse: bool


def moment(episode: Trajectory, time: float) -> _Moment:
    """Return an episode at a time [s]; between two recorded states the deputies follow a cubic.

    The cubic has the recorded positions and velocities at its ends.
    """
    time = float(np.clip(time, episode.time[0], episode.time[-1]))
    row = int(np.clip(np.searchsorted(episode.time, time, side="right") - 1, 0, len(episode.time) - 2))
    u = (time - float(episode.time[row])) / float(episode.time[row + 1] - episode.time[row])
    between = slice(row, row + 2)
    position = CubicHermiteSpline(episode.time[between], episode.position[between], episode.velocity[between])(time)
    points, sun, lit = episode.points, None, np.zeros(len(episode.points), dtype=np.bool_)
    if "chief_orientation" in episode.arrays:
        first, second = continuous(episode.chief_orientation[None, between], episode.chief_orientation[None, row])[0]
        points = rotate(normalise((1.0 - u) * first + u * second), points)
    if "sun_angle" in episode.arrays:
        beta = episode.beta_angle[row] if "beta_angle" in episode.arrays else 0.0
        sun = sun_directions((1.0 - u) * episode.sun_angle[row] + u * episode.sun_angle[row + 1], beta)
        lit = points @ sun > 0.0
    last = row + 1 if u >= 1.0 else row
    eclipse = "sunlight" in episode.arrays and bool(episode.sunlight[last] < 0.5)
    seen = episode.inspected_at <= time
    return _Moment(time, position, episode.delta_v[last], sun, seen, lit & (not eclipse), points, last, eclipse)


_NEAREST = 0.1  # smallest range that is drawn [m]


class _ChiefView:
    """View of the chief from the scene's side and from behind: its day side, and which points have been inspected."""

    def __init__(self, figure: Any, episode: Trajectory) -> None:
        self._episode, self._radius = episode, episode.radius
        self._sides = []
        outline, look = picture.circle(self._radius).T, {"linestyle": "", "marker": "o"}
        colours = [deputy_line(index)["color"] for index in range(len(episode.deputies))]
        for column, title in enumerate(("chief as on the left", "from behind")):
            axes = figure.add_axes((0.615 + 0.19 * column, 0.6, 0.18, 0.29))
            axes.set_axis_off()
            axes.set_aspect("equal")
            reach = 1.05 * self._radius
            axes.set(xlim=(-reach, reach), ylim=(-reach, reach))
            axes.set_title(title, pad=3.0, fontsize=9)
            axes.fill(*outline, facecolor=picture.NIGHT, edgecolor=picture.GREY, linewidth=0.7, zorder=1)
            (day,) = axes.fill([0.0], [0.0], facecolor=picture.DAY, zorder=1.1)
            waiting = axes.plot([], [], markersize=3.5, color=picture.DARK, zorder=2, **look)[0]
            lit = axes.plot([], [], markersize=5, color=picture.LIT, zorder=2, **look)[0]
            lit.set(markeredgecolor=picture.BLACK, markeredgewidth=0.9)
            waiting.set(markeredgewidth=0.0)
            owners = [axes.plot([], [], markersize=5, color=colour, zorder=3, **look)[0] for colour in colours]
            self._sides.append((day, waiting, lit, owners))
        self._build_key(figure)

    def _build_key(self, figure: Any) -> None:
        from matplotlib.lines import Line2D

        look: Any = {"linestyle": "", "marker": "o", "markeredgewidth": 0.9, "markersize": 5}
        handles = [
            Line2D([], [], color=picture.LIT, markeredgecolor=picture.BLACK, label="lit", **look),
            Line2D([], [], color=picture.DARK, markeredgecolor="none", label="dark", **look),
        ]
        names = self._episode.deputies if len(self._episode.deputies) > 1 else ("inspected",)
        for index, name in enumerate(names[:6]):
            colour = deputy_line(index)["color"]
            handles.append(Line2D([], [], color=colour, markeredgecolor="none", label=name, **look))
        figure.legend(
            handles=handles, loc="upper center", bbox_to_anchor=(0.8, 0.605), ncols=5, handlelength=0.5,
            columnspacing=0.9, borderpad=0.0,
        )  # fmt: skip

    def show(self, now: _Moment, front: picture.Camera) -> None:
        """Draw the chief at a moment."""
        cameras = front, picture.Camera.along(-front.sight)
        for camera, (day, waiting, lit, owners) in zip(cameras, self._sides, strict=True):
            if now.sun is not None:
                day.set_xy(camera.day(now.sun, self._radius))
                day.set_visible(not now.eclipse)
            flat, near = camera.flat(now.points), now.points @ camera.sight > 0.0
            waiting.set_data(*flat[near & ~now.seen & ~now.lit].T)
            lit.set_data(*flat[near & ~now.seen & now.lit].T)
            for index, dots in enumerate(owners):
                dots.set_data(*flat[near & now.seen & (self._episode.inspector == index)].T)


class _ApproachView:
    """View of speed over range (logarithmic), with the speed limit and the docking region if the task has them."""

    def __init__(self, figure: Any, episode: Trajectory) -> None:
        self._episode = episode
        self._range, self._limit = np.maximum(episode.range, _NEAREST), speed_limit_of(episode)
        axes = figure.add_axes((0.675, 0.64, 0.305, 0.25))
        axes.set(xscale="log", xlim=(0.9 * float(self._range.min()), 1.1 * float(self._range.max())))
        axes.set(xlabel="range [m]", ylabel="speed [m/s]")
        axes.xaxis.set_major_formatter("{x:g}")
        axes.yaxis.set_label_coords(-0.15, 0.5)
        top = float(episode.speed.max())
        if self._limit is not None:
            order = np.argsort(self._range, axis=None)
            limit = self._limit.reshape(-1)[order]
            axes.plot(self._range.reshape(-1)[order], limit, color=picture.GREY, linewidth=1.0, linestyle=(0, (4, 2)))
            top = max(top, float(limit.max()))
        axes.set_ylim(0.0, 1.08 * top or 1.0)
        if episode.docking_radius:
            axes.axvspan(_NEAREST, episode.docking_radius, color=picture.PALE, zorder=0)
        self._lines = [axes.plot([], [], **deputy_line(index))[0] for index in range(len(episode.deputies))]
        dots: Any = {"linestyle": "", "marker": "o", "markersize": 5}
        self._dots = [axes.plot([], [], color=line.get_color(), **dots)[0] for line in self._lines]
        parts = {"speed limit (dashed)": self._limit is not None, "docking region (grey)": episode.docking_radius > 0.0}
        axes.set_title(", ".join(part for part, drawn in parts.items() if drawn), pad=3.0, fontsize=8)

    def show(self, now: _Moment, front: picture.Camera) -> None:
        """Draw the speeds so far; between two recorded states the last recorded speed is shown."""
        for index, (line, dot) in enumerate(zip(self._lines, self._dots, strict=True)):
            far, fast = self._range[: now.row + 1, index], self._episode.speed[: now.row + 1, index]
            line.set_data(far, fast)
            dot.set_data(far[-1:], fast[-1:])


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
        self.episode = episode
        self._turn = turn
        self._inspects = bool(len(episode.points)) and "sun_angle" in episode.arrays
        self._radius = episode.radius or episode.docking_radius
        super().__init__(frames, width)

    def _build(self, figure: Any) -> None:
        self._build_scene(figure)
        view = _ChiefView if self._inspects else _ApproachView
        self._side: _ChiefView | _ApproachView = view(figure, self.episode)
        self._build_panels(figure)

    def _build_scene(self, figure: Any) -> None:
        episode, radius = self.episode, self._radius
        self._axes = axes = figure.add_axes((0.0, 0.0, 0.6, 1.0))
        axes.set_axis_off()
        axes.set_aspect("equal")
        self._ring = ring_radii(reach_of(episode))
        near = episode.position[episode.range <= reach_of(episode)]
        turns = np.linspace(0.0, self._turn, 9)
        corners = [picture.Camera.at(picture.VIEW["elev"], picture.VIEW["azim"] + turn).flat(near) for turn in turns]
        reach = np.abs(np.concatenate(corners)).max(axis=0)
        wide = max(float(reach[0]), 1.22 * self._ring[-1])
        tall = max(1.06 * float(reach[1]), 0.6 * self._ring[-1])  # the line of text is above it
        aspect = 0.6 * self.size[0] / self.size[1]
        half = 1.06 * max(wide, tall * aspect)
        axes.set(xlim=(-half, half), ylim=(-half / aspect, half / aspect))
        self._rings = [axes.plot([], [], color=picture.PALE, linewidth=0.9, zorder=1)[0] for _ in self._ring]
        self._labels = [
            axes.text(0.0, 0.0, f"{radius:g} m", color=picture.GREY, fontsize=7.5, ha="center", va="center", zorder=1.5)
            for radius in self._ring
        ]
        for label in self._labels:
            label.set_bbox({"facecolor": "white", "edgecolor": "none", "pad": 0.8})
        if self._inspects:
            (self._sun,) = axes.plot([], [], color=picture.ORANGE, linewidth=2.2, zorder=2)
            self._sun_label = axes.text(0.0, 0.0, "sun", color=picture.ORANGE, ha="center", va="center", zorder=2)
        else:
            axes.plot([0.0], [0.0], linestyle="", marker="+", markersize=9, color=picture.BLACK, zorder=3)
        (self._night,) = axes.fill(
            *picture.circle(radius).T, facecolor=picture.NIGHT, edgecolor=picture.BLACK, linewidth=0.6, zorder=3
        )
        (self._day,) = axes.fill([0.0], [0.0], facecolor=picture.DAY, zorder=3.1)
        self._ways = []
        for index, name in enumerate(episode.deputies):
            line = deputy_line(index)
            behind = axes.plot([], [], linewidth=1.6, zorder=2.5, **line)[0]
            front = axes.plot([], [], linewidth=1.6, zorder=4, label=name, **line)[0]
            dot = axes.plot([], [], linestyle="", marker="o", markersize=7, color=line["color"], zorder=5)[0]
            dot.set(markeredgecolor="white", markeredgewidth=1.0)
            self._ways.append((behind, front, dot))
        place = "Hill's frame, seen from above the orbital plane" if episode.mean_motion else "an inertial frame"
        figure.text(0.02, 0.955, place, color=picture.GREY, fontsize=8)

    def _build_panels(self, figure: Any) -> None:
        episode = self.episode
        scale, unit = clock(episode)
        self._counters = [
            figure.text(place, 0.955, "", fontsize=8.5, color=picture.BLACK, va="center", ha=side)
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
                lines = [axes.step([], [], where="post", color=picture.BLACK)[0]]
            else:
                lines = [axes.plot([], [], **deputy_line(index))[0] for index in range(len(episode.deputies))]
            self._panels.append(lines)
        self._panels[0][0].axes.tick_params(labelbottom=False)
        self._panels[1][0].axes.set_xlabel(f"time [{unit}]")

    def _show(self, share: float) -> None:
        now, turned = moment(self.episode, share * float(self.episode.time[-1])), share * self._turn
        episode, radius = self.episode, self._radius
        front = picture.Camera.at(picture.VIEW["elev"], picture.VIEW["azim"] + turned)
        left = np.radians(picture.VIEW["azim"] + turned - 84.0)
        for reach, line, label in zip(self._ring, self._rings, self._labels, strict=True):
            line.set_data(*front.flat(picture.ring(reach)).T)
            label.set_position(front.flat(reach * np.array([np.cos(left), np.sin(left), 0.0])).tolist())
        if self._inspects and now.sun is not None:
            outer = self._ring[-1]
            self._sun.set_data(*front.flat(picture.sun_arrow(now.sun, outer)).T)
            self._sun_label.set_position(front.flat(1.13 * outer * now.sun).tolist())
            self._day.set_xy(front.day(now.sun, radius))
            self._day.set_visible(not now.eclipse)
        for index, (line_behind, line_front, dot) in enumerate(self._ways):
            way = np.concatenate((episode.position[: now.row + 1, index], now.position[None, index]))
            hidden = front.hidden(way, radius)
            flat = front.flat(way)
            for line, which in ((line_behind, hidden), (line_front, ~hidden)):
                line.set_data(*picture.pieces(flat, which[:, None]).T)
            dot.set_data(*flat[-1:].T)
            dot.set_zorder(2.6 if hidden[-1] else 5)
        self._side.show(now, front)
        self._write_counters(now)

    def _write_counters(self, now: _Moment) -> None:
        episode = self.episode
        scale, unit = clock(episode)
        time = np.append(episode.time[: now.row + 1], now.time) / scale
        far = lengths(now.position)
        count = int(now.seen.sum())
        counters = (
            f"{now.time / scale:.1f} {unit}",
            f"{count} of {len(now.seen)} points" if self._inspects else f"{far.min():.1f} m",
            f"delta-v {now.delta_v.sum():.3f} m/s",
        )
        for text, words in zip(self._counters, counters, strict=True):
            text.set_text(words)
        first = (episode.range, far)
        if self._inspects:
            first = (100.0 * episode.coverage[:, None], np.array([100.0 * count / len(now.seen)]))
        for lines, (values, latest) in zip(self._panels, (first, (episode.delta_v, now.delta_v)), strict=True):
            for index, line in enumerate(lines):
                line.set_data(time, np.append(values[: now.row + 1, index], latest[index]))
