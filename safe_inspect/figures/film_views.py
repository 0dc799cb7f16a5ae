"""Views in the pictures of a film: `Moment`, an episode at one time, and the parts next to the scene."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from safe_inspect.dynamics.quaternion import continuous, normalise, rotate
from safe_inspect.evaluation.episodes import Trajectory
from safe_inspect.figures.drawing import deputy_line, radius_of, speed_limit_of
from safe_inspect.geometry.picture import BLACK, DARK, DAY, GREY, LIT, NIGHT, PALE, Camera, circle
from safe_inspect.tasks.inspection.sun import sun_directions
from safe_inspect.types import BoolArray, FloatArray


@dataclass(frozen=True)
class Moment:
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


def moment(episode: Trajectory, time: float) -> Moment:
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
    return Moment(time, position, episode.delta_v[last], sun, seen, lit & (not eclipse), points, last, eclipse)


_NEAREST = 0.1  # smallest range that is drawn [m]


class ChiefView:
    """View of the chief from the scene's side and from behind: its day side, and which points have been inspected."""

    def __init__(self, figure: Any, episode: Trajectory) -> None:
        self._episode, self._radius = episode, radius_of(episode)
        self._sides = []
        for column, title in enumerate(("chief as on the left", "from behind")):
            axes = figure.add_axes((0.615 + 0.19 * column, 0.6, 0.18, 0.29))
            axes.set_axis_off()
            axes.set_aspect("equal")
            reach = 1.05 * self._radius
            axes.set(xlim=(-reach, reach), ylim=(-reach, reach))
            axes.set_title(title, pad=3.0, fontsize=9)
            axes.fill(*circle(self._radius).T, facecolor=NIGHT, edgecolor=GREY, linewidth=0.7, zorder=1)
            (day,) = axes.fill([0.0], [0.0], facecolor=DAY, zorder=1.1)
            waiting = axes.plot([], [], linestyle="", marker="o", markersize=3.5, color=DARK, zorder=2)[0]
            lit = axes.plot([], [], linestyle="", marker="o", markersize=5, color=LIT, zorder=2)[0]
            lit.set(markeredgecolor=BLACK, markeredgewidth=0.9)
            waiting.set(markeredgewidth=0.0)
            colours = [deputy_line(index)["color"] for index in range(len(episode.deputies))]
            owners = [
                axes.plot([], [], linestyle="", marker="o", markersize=5, color=colour, zorder=3)[0]
                for colour in colours
            ]
            self._sides.append((day, waiting, lit, owners))
        self._build_key(figure)

    def _build_key(self, figure: Any) -> None:
        from matplotlib.lines import Line2D

        look: Any = {"linestyle": "", "marker": "o", "markeredgewidth": 0.9, "markersize": 5}
        handles = [
            Line2D([], [], color=LIT, markeredgecolor=BLACK, label="lit", **look),
            Line2D([], [], color=DARK, markeredgecolor="none", label="dark", **look),
        ]
        names = self._episode.deputies if len(self._episode.deputies) > 1 else ("inspected",)
        for index, name in enumerate(names[:6]):
            colour = deputy_line(index)["color"]
            handles.append(Line2D([], [], color=colour, markeredgecolor="none", label=name, **look))
        figure.legend(
            handles=handles, loc="upper center", bbox_to_anchor=(0.8, 0.605), ncols=5, handlelength=0.5,
            columnspacing=0.9, borderpad=0.0,
        )  # fmt: skip

    def show(self, now: Moment, front: Camera) -> None:
        """Draw the chief at a moment."""
        for camera, (day, waiting, lit, owners) in zip((front, Camera.along(-front.sight)), self._sides, strict=True):
            if now.sun is not None:
                day.set_xy(camera.day(now.sun, self._radius))
                day.set_visible(not now.eclipse)
            flat, near = camera.flat(now.points), now.points @ camera.sight > 0.0
            waiting.set_data(*flat[near & ~now.seen & ~now.lit].T)
            lit.set_data(*flat[near & ~now.seen & now.lit].T)
            for index, dots in enumerate(owners):
                dots.set_data(*flat[near & now.seen & (self._episode.inspector == index)].T)


class ApproachView:
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
            axes.plot(self._range.reshape(-1)[order], limit, color=GREY, linewidth=1.0, linestyle=(0, (4, 2)))
            top = max(top, float(limit.max()))
        axes.set_ylim(0.0, 1.08 * top or 1.0)
        if episode.docking_radius:
            axes.axvspan(_NEAREST, episode.docking_radius, color=PALE, zorder=0)
        self._lines = [axes.plot([], [], **deputy_line(index))[0] for index in range(len(episode.deputies))]
        dots: Any = {"linestyle": "", "marker": "o", "markersize": 5}
        self._dots = [axes.plot([], [], color=line.get_color(), **dots)[0] for line in self._lines]
        told = (["speed limit (dashed)"] if self._limit is not None else []) + (
            ["docking region (grey)"] if episode.docking_radius else []
        )
        axes.set_title(", ".join(told), pad=3.0, fontsize=8)

    def show(self, now: Moment, front: Camera) -> None:
        """Draw the speeds so far; between two recorded states the last recorded speed is shown."""
        for index, (line, dot) in enumerate(zip(self._lines, self._dots, strict=True)):
            far, fast = self._range[: now.row + 1, index], self._episode.speed[: now.row + 1, index]
            line.set_data(far, fast)
            dot.set_data(far[-1:], fast[-1:])
