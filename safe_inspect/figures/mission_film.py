"""`MissionFilm`: the pictures of an animated rendezvous."""

from __future__ import annotations

from typing import Any

import numpy as np

from safe_inspect.dynamics.quaternion import normalise, to_matrix
from safe_inspect.figures.mission_figure import LEAD
from safe_inspect.figures.mission_scene import BELIEVED, FLIGHT, PHASE_COLOURS, SceneArtists, show_extent
from safe_inspect.figures.pictures import Pictures
from safe_inspect.geometry.picture import BLACK, GREY, ORANGE, PALE, Camera
from safe_inspect.missions.record import MissionRecord
from safe_inspect.rendezvous.coordination.context import Phase
from safe_inspect.rendezvous.poses import rotation_log
from safe_inspect.types import AnyArray, BoolArray, FloatArray


class MissionFilm(Pictures):
    """Pictures of a mission: the flight in W and in the target's axes, phases and clearance.

    Lines show the edges of the target where the chaser believes them, unless its pilot knows the truth. The film starts
    shortly before the approach.

    Args:
        record: The mission.
        frames: Number of pictures, at least 2; they are equally spaced in time.
        width: Width of a picture [pixels]; it is 1.6 times its height.
        turn: Angle by which the camera turns around the scene from the first picture to the last [degrees].

    Raises:
        SafeInspectError: Matplotlib is not installed.
        ValueError: A number is out of range.
    """

    def __init__(self, record: MissionRecord, frames: int = 200, width: int = 800, turn: float = 0.0) -> None:
        time = record.arrays["t"]
        self.record = record
        self._turn = turn
        self._end = float(time[-1])
        self._start = max(float(time[record.approach()]) - LEAD, float(time[0]))
        self._first = int(np.searchsorted(time, self._start))
        super().__init__(frames, width)

    def _moment(self, time: float) -> tuple[int, FloatArray, tuple[FloatArray, FloatArray]]:
        """Return the last recorded step that is not later, and states interpolated to the next step.

        The states are the chaser's position in W [m], and the rotations from B to W and from T to W.
        """
        arrays = self.record.arrays
        row = int(np.clip(np.searchsorted(arrays["t"], time, side="right") - 1, 0, len(arrays["t"]) - 1))
        after = min(row + 1, len(arrays["t"]) - 1)
        u = 0.0 if after == row else (time - arrays["t"][row]) / (arrays["t"][after] - arrays["t"][row])

        def turned(name: str) -> FloatArray:
            first, last = arrays[name][row], arrays[name][after]
            return to_matrix(normalise((1.0 - u) * first + u * (last if first @ last >= 0.0 else -last)))

        position = (1.0 - u) * arrays["x"][row, :3] + u * arrays["x"][after, :3]
        return row, position, (turned("q"), turned("target_q"))

    def _build(self, figure: Any) -> None:
        places = ((0.0, 0.13, 0.6, 0.8), (0.6, 0.48, 0.4, 0.42))
        self._scenes = [self._scene(figure, place, bool(index)) for index, place in enumerate(places)]
        figure.text(0.8, 0.905, "in the target's principal axes", fontsize=8, color=GREY, ha="center")
        self._off = figure.text(0.02, 0.9, "", fontsize=8, color=BELIEVED)
        self._texts = [
            figure.text(place, 0.955, "", fontsize=9.5, color=BLACK, va="center", ha=side)
            for place, side in ((0.02, "left"), (0.16, "left"), (0.985, "right"))
        ]
        self._build_clearance(figure.add_axes((0.68, 0.2, 0.3, 0.23)))
        self._build_phases(figure.add_axes((0.03, 0.075, 0.95, 0.03)))

    def _scene(self, figure: Any, place: tuple[float, ...], in_target: bool) -> tuple[SceneArtists, Camera]:
        """Return a scene and its view in the first picture."""
        axes = figure.add_axes(place)
        scene = SceneArtists(axes, self.record, in_target)
        view, path, swept = scene.best_view(self._first), scene.path[self._first :], self.record.target.swept_radius
        # The extent covers everything that may be visible from any side.
        reach = max(swept, float(np.linalg.norm(path, axis=1).max()))
        margin = 1.1 * self.record.config.chaser.radius
        near = [_turned(view, turn).flat(path) for turn in np.linspace(0.0, self._turn, 7)]
        points = np.concatenate([*near, min(reach, swept) * np.array([[-1.0, -1.0], [1.0, 1.0]])])
        aspect = place[2] * self.size[0] / place[3] / self.size[1]
        show_extent(axes, points.min(axis=0) - margin, points.max(axis=0) + margin, aspect)
        return scene, view

    def _build_clearance(self, axes: Any) -> None:
        arrays = self.record.arrays
        time = arrays["t"]
        rows = np.flatnonzero((time >= self._start) & (time <= self._end))
        margin = arrays["margin"][rows]
        if np.isfinite(margin).any():
            axes.fill_between(time[rows], 0.0, margin, color=PALE, linewidth=0.0, label="margin of the tube")
            axes.legend(loc="upper right", borderpad=0.0, handlelength=1.0)
        top = 1.08 * max(float(arrays["clearance"][rows].max()), 0.1)
        axes.set(ylabel="clearance [m]", xlabel="time [s]", xlim=(self._start, self._end))
        axes.set_ylim(min(0.0, 1.1 * float(arrays["clearance"][rows].min())), top)
        self._clearance = axes.plot([], [], color=FLIGHT)[0]

    def _build_phases(self, axes: Any) -> None:
        for phase, start, end in self.record.phases():
            axes.axvspan(start, end, facecolor=PHASE_COLOURS.get(phase, GREY), linewidth=0.0)
            if end - start > 0.06 * self.record.arrays["t"][-1]:
                axes.text(0.5 * (start + end), -0.35, phase.value, fontsize=6.5, color=GREY, ha="center", va="top")
        axes.set(yticks=(), xticks=(), ylim=(0.0, 1.0), xlim=(0.0, float(self.record.arrays["t"][-1])))
        for side in ("left", "bottom"):
            axes.spines[side].set_visible(False)
        self._now = axes.axvline(0.0, color=ORANGE, linewidth=2.5)

    def _show(self, share: float) -> None:
        time = self._start + share * (self._end - self._start)
        row, outside, pose = self._moment(time)
        arrays, record = self.record.arrays, self.record
        plan = next((plan for plan in reversed(record.plans) if plan.times[0] <= time + LEAD), None)
        in_target, believed = pose[1].T @ outside, record.believed_target(row)
        for scene, view in self._scenes:
            position = in_target if scene.in_target else outside
            way = np.concatenate((scene.path[self._first : row + 1], position[None]))
            rows = _last_run(np.isfinite(arrays["tube"][: row + 1]))
            scene.show(pose, _turned(view, share * self._turn), way, plan, rows, believed)
        distance = float(np.linalg.norm(in_target - record.target.mating_point))
        phase, clearance = list(Phase)[arrays["state"][row]].value, float(arrays["clearance"][row])
        words = (f"{time:.1f} s", phase, f"clearance {clearance:.2f} m, {distance:.2f} m to the mating point")
        for text, word in zip(self._texts, words, strict=True):
            text.set_text(word)
        self._off.set_text("" if believed is None else _off(*believed))
        shown = slice(self._first, row + 1)
        self._clearance.set_data(arrays["t"][shown], arrays["clearance"][shown])
        self._now.set_xdata([time, time])


def _turned(view: Camera, turn: float) -> Camera:
    """Return the view after the camera has turned around the scene by an angle [degrees]."""
    c, s = np.cos(np.radians(turn)), np.sin(np.radians(turn))
    return view.turned(np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]))


def _off(rotation: FloatArray, offset: FloatArray) -> str:
    """Return the errors with which the chaser believes the target, in words."""
    angle, distance = np.rad2deg(np.linalg.norm(rotation_log(rotation))), 1e3 * np.linalg.norm(offset)
    return f"lines: where the chaser believes the target, off by {angle:.2g} deg and {distance:.2g} mm"


def _last_run(which: BoolArray) -> AnyArray:
    """Return the indices of the run of true values that ends at the last element; empty if that element is false."""
    gaps = np.flatnonzero(~which)
    return np.arange(gaps[-1] + 1 if len(gaps) else 0, len(which))
