"""The panels over time in the figure of an episode: coverage, range, speed with its limit, thrust."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from safe_inspect.evaluation.trajectory import Trajectory
from safe_inspect.figures.chief_figure import clock, reach_of
from safe_inspect.figures.drawing import deputy_line
from safe_inspect.geometry.picture import BLACK, BLUE, GREEN, GREY, VERMILION
from safe_inspect.rta.constraints.parameters import ConstraintParameters
from safe_inspect.types import FloatArray

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_FEW = 20  # number of burns up to which they are drawn as pins
_AXIS_COLOURS = (VERMILION, BLUE, GREEN)
_LEFT, _WIDTH = 0.625, 0.36
_PLACES = ((0.79, 0.15), (0.605, 0.15), (0.42, 0.15), (0.305, 0.08), (0.195, 0.08), (0.085, 0.08))


def safe_speed(episode: Trajectory) -> FloatArray:
    """Return the largest safe speed at each deputy's range [m/s], shape (T + 1, D).

    It is the task's ``speed_limit`` if a component records it, else the published limit for inspection, v0 + 2 n (r -
    d0): 0.2 m/s at 10 m, increasing by twice the mean motion per metre.
    """
    if "speed_limit" in episode.arrays:
        return episode.arrays["speed_limit"]
    limit = ConstraintParameters(n=episode.mean_motion)
    return np.asarray(limit.v0 + limit.v1 * (episode.range - limit.speed_distance))


def speed_limit_of(episode: Trajectory) -> FloatArray | None:
    """Return the speed limits that figures show [m/s], shape (T + 1, D); None without a chief in orbit."""
    return safe_speed(episode) if episode.mean_motion else None


def above_limit(speed: FloatArray, limit: FloatArray) -> FloatArray:
    """Return the speeds above their limit and the speed after each of these, NaN elsewhere, shape (T + 1, D)."""
    above = speed > limit
    shown = above.copy()
    shown[1:] |= above[:-1]
    return np.where(shown, speed, np.nan)


def draw_times(figure: Figure, episode: Trajectory) -> None:
    """Draw the six panels below each other, with a common time axis."""
    scale, unit = clock(episode)
    time = episode.time / scale
    panels: list[Any] = [figure.add_axes((_LEFT, bottom, _WIDTH, height)) for bottom, height in _PLACES]
    (_draw_coverage if len(episode.points) else _draw_delta_v)(panels[0], episode, time)
    for index in range(len(episode.deputies)):
        panels[1].plot(time, episode.range[:, index], **deputy_line(index))
    near = episode.range <= reach_of(episode)
    panels[1].set(ylabel="range\n[m]", ylim=(0, None if near.all() else 1.05 * reach_of(episode)))
    _draw_speed(panels[2], episode, time)
    several = len(episode.deputies) > 1
    reach = 1.2 * float(np.abs(episode.thrust).max(initial=0.0)) or 1.0
    for axis, axes in enumerate(panels[3:]):
        for index in range(len(episode.deputies)):
            line = deputy_line(index) if several else {"color": _AXIS_COLOURS[axis]}
            _draw_thrust(axes, time, episode.thrust[:, index, axis], **line)
        axes.set(ylim=(-reach, reach), ylabel=f"{'xyz'[axis]}")
        axes.locator_params(axis="y", nbins=3)
    figure.text(_LEFT - 0.083, 0.235, "thrust [N]", rotation=90, va="center", ha="center", color=BLACK)
    for axes in panels:
        axes.set_xlim(-0.015 * time[-1], time[-1])  # keeps a burn at the start apart from the axis
        axes.tick_params(labelbottom=axes is panels[-1])
        axes.yaxis.set_label_coords(-0.135, 0.5)
    label = f"time [{unit}]"
    if episode.mean_motion:
        label += f", an orbit is {2.0 * np.pi / episode.mean_motion / scale:.3g} {unit}"
    panels[-1].set_xlabel(label)


def _draw_coverage(axes: Any, episode: Trajectory, time: FloatArray) -> None:
    several = len(episode.deputies) > 1
    axes.step(time, 100.0 * episode.coverage, where="post", color=BLACK, label="together" if several else None)
    for index in range(len(episode.deputies)) if several else ():
        axes.step(time, 100.0 * episode.coverage_of(index), where="post", linewidth=1.2, **deputy_line(index))
    if several:
        axes.legend(loc="lower left", bbox_to_anchor=(-0.01, 0.96), handlelength=1.2, borderpad=0.0)
    axes.set(ylabel="inspected\n[%]", ylim=(0, 104), yticks=(0, 50, 100))


def _draw_delta_v(axes: Any, episode: Trajectory, time: FloatArray) -> None:
    for index in range(len(episode.deputies)):
        axes.plot(time, episode.delta_v[:, index], **deputy_line(index))
    axes.set(ylabel="delta-v\n[m/s]", ylim=(0, None))


def _draw_speed(axes: Any, episode: Trajectory, time: FloatArray) -> None:
    """Draw the speeds and, for a chief in orbit, the largest safe speeds."""
    limit = speed_limit_of(episode)
    for index in range(len(episode.deputies)):
        line = deputy_line(index)
        axes.plot(time, episode.speed[:, index], **line)
        if limit is not None:
            axes.plot(time, limit[:, index], color=line["color"], linewidth=0.9, linestyle=(0, (4, 2)))
    near = episode.range <= reach_of(episode)
    top = float(episode.speed[near].max())
    if limit is not None:
        above = above_limit(episode.speed, limit)
        if np.isfinite(above).any():
            axes.plot(time, above, color=BLACK, linewidth=2.4)
            axes.plot([], [], color=BLACK, linewidth=2.4, label="above it")
        axes.plot([], [], color=GREY, linewidth=0.9, linestyle=(0, (4, 2)), label="largest safe speed at the range")
        axes.legend(
            loc="lower right", bbox_to_anchor=(1.01, 0.96), handlelength=2.0, borderpad=0.0, ncols=2, reverse=True
        )
        top = max(top, float(limit[near].max()))
    axes.set(ylabel="speed\n[m/s]", ylim=(0, None if near.all() else 1.05 * top))


def _draw_thrust(axes: Any, time: FloatArray, values: FloatArray, **line: Any) -> None:
    """Draw a thrust over time; a few short burns are drawn as pins, as lines would cover each other."""
    burns = np.flatnonzero(values)
    axes.axhline(0.0, color=GREY, linewidth=0.8, zorder=1)
    if len(burns) > _FEW:
        axes.step(time, np.append(values, 0.0), where="post", linewidth=0.9, **line)
        return
    axes.vlines(time[burns], 0.0, values[burns], color=line["color"], linewidth=1.2)
    axes.plot(time[burns], values[burns], marker="o", markersize=3.5, linestyle="", color=line["color"])
