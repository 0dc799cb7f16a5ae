"""Figures of trainings over the environment steps, with confidence bands over the seeds of a recipe."""

from __future__ import annotations

import csv
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from safe_inspect.errors import SafeInspectError, did_you_mean
from safe_inspect.figures.drawing import Figure, deputy_line, new_figure
from safe_inspect.geometry.picture import GREY
from safe_inspect.metrics.statistics import interquartile_mean
from safe_inspect.types import FloatArray, IntArray

#: Column of progress.csv with the number of environment steps.
_STEPS = "steps"
#: Column of progress.csv, label, factor.
_PANELS = (
    ("return_mean", "return [-]", 1.0),
    ("success_rate", "success [%]", 100.0),
    ("inspected_fraction", "inspected [%]", 100.0),
    ("delta_v", "delta-v [m/s]", 1.0),
)
#: How the seeds are combined: by the arithmetic mean, or by the mean of the middle half.
Centre = Literal["mean", "iqm"]
#: Name in a figure of each way to combine seeds.
_CENTRES = {"mean": "mean", "iqm": "interquartile mean"}
#: Size of the grid of steps, number of resamples, and their share on each side of the interval [%].
_POINTS, _RESAMPLES, _TAIL = 200, 1000, 50.0 * (1.0 - 0.95)


def _read_learning_curve(path: str | os.PathLike[str]) -> dict[str, FloatArray]:
    """Return the columns of a ``progress.csv`` by name; an empty cell is NaN.

    Raises:
        SafeInspectError: The file is missing or damaged, has no rows, or lacks a column that is drawn.
    """
    try:
        with Path(path).open(newline="", encoding="utf-8") as file:
            reader = csv.DictReader(file)
            rows, names = list(reader), tuple(reader.fieldnames or ())
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise SafeInspectError(f"cannot read {os.fspath(path)!r}: {error}") from None
    missing = [name for name in (_STEPS, *(column for column, _, _ in _PANELS)) if name not in names]
    if missing:
        near = did_you_mean(missing[0], names)
        hint = f"; {near}" if near.startswith("did you mean") else ""
        raise SafeInspectError(
            f"{os.fspath(path)!r} is not the progress.csv of a training: it has no column `{missing[0]}`{hint}"
        )
    if not rows:
        raise SafeInspectError(f"{os.fspath(path)!r} has no rows yet; wait for the first iteration")
    columns = {
        name: np.array([_number(path, line, name, row.get(name)) for line, row in enumerate(rows, 2)]) for name in names
    }
    steps = columns[_STEPS]
    back = np.flatnonzero(~(np.diff(steps) >= 0.0))
    if not np.isfinite(steps[0]) or len(back):
        line = int(back[0]) + 3 if np.isfinite(steps[0]) else 2
        raise SafeInspectError(
            f"{os.fspath(path)}:{line}: the file is damaged: `{_STEPS}` must not decrease from row to row"
        )
    return columns


def _number(path: str | os.PathLike[str], line: int, name: str, cell: str | None) -> float:
    try:
        return float(cell or "nan")
    except ValueError:
        message = f"{os.fspath(path)}:{line}: the file is damaged: `{name}` is {cell!r:.40}, not a number"
        raise SafeInspectError(message) from None


def _label_panel(axes: Any, label: str, factor: float, drawn: bool, ended: bool) -> None:
    if not drawn:
        text = "not in this task" if ended else "no episode has ended"
        axes.text(0.5, 0.5, text, transform=axes.transAxes, ha="center", color=GREY)
    axes.set_ylabel(label)
    if factor == 100.0:
        axes.set_ylim(-3, 103)


def _panels_of(figure: Figure, steps: FloatArray) -> tuple[Any, float]:
    """Return panels in a figure, one for each quantity, and the number by which they divide steps."""
    panels = figure.subplots(2, 2, sharex=True)
    largest = np.nanmax(steps, initial=0.0)
    units = ((2e6, 1e6, " [millions]"), (2e3, 1e3, " [thousands]"), (-np.inf, 1.0, ""))
    scale, unit = next((scale, unit) for least, scale, unit in units if largest >= least)
    for axes in panels[1]:
        axes.set_xlabel(f"environment steps{unit}")
    return panels, scale


@dataclass(frozen=True)
class _Band:
    """The centre of several curves and its confidence interval, on one grid of steps.

    Attributes:
        steps: Environment steps, shape (S,).
        centre: Mean or interquartile mean over the curves that are known at a step, NaN if there is none, shape (S,).
        low: Lower end of the interval, NaN where fewer than two curves are known, shape (S,).
        high: Upper end of the interval, NaN as in `low`, shape (S,).
        curves: Number of curves that are known, shape (S,).
    """

    steps: FloatArray
    centre: FloatArray
    low: FloatArray
    high: FloatArray
    curves: IntArray


def _centre_of(values: FloatArray, centre: Centre) -> FloatArray:
    """Return the centre over the second to last axis, shape (..., S), of values of shape (..., K, S)."""
    return np.asarray((interquartile_mean if centre == "iqm" else np.mean)(values, axis=-2))


def _band(curves: Sequence[tuple[FloatArray, FloatArray]], centre: Centre = "mean") -> _Band:
    """Return the band of curves with possibly different steps and lengths.

    Every curve is interpolated between its points and is unknown outside of them. The interval is the percentile
    bootstrap interval of 95 % over the curves that are known at a step.

    Args:
        curves: Steps and values of each curve, sorted by steps; values that are not finite are left out.
        centre: How the curves are combined.
    """
    known = [(steps[np.isfinite(values)], values[np.isfinite(values)]) for steps, values in curves]
    known = [(steps, values) for steps, values in known if len(steps)]
    if not known:
        nothing = np.empty(0)
        return _Band(nothing, nothing, nothing, nothing, np.empty(0, dtype=np.int64))
    first, last = min(steps[0] for steps, _ in known), max(steps[-1] for steps, _ in known)
    ends = np.unique([end for steps, _ in known for end in (steps[0], steps[-1])])  # where a curve starts or ends
    grid = np.unique(np.concatenate((np.linspace(first, last, _POINTS), ends)))
    rows = np.stack([np.interp(grid, steps, values, left=np.nan, right=np.nan) for steps, values in known])
    there = np.isfinite(rows)
    middle, low, high = (np.full(len(grid), np.nan) for _ in range(3))
    generator = np.random.default_rng(0)
    for pattern in np.unique(there, axis=1).T:  # groups the steps at which the same curves are known
        columns = (there == pattern[:, None]).all(axis=0)
        values = rows[np.ix_(pattern, columns)]
        count = len(values)
        if not count:
            continue
        middle[columns] = _centre_of(values, centre)
        if count > 1:
            drawn = generator.integers(count, size=(_RESAMPLES, count))
            found = _centre_of(values[drawn], centre)
            low[columns], high[columns] = np.percentile(found, (_TAIL, 100.0 - _TAIL), axis=0)
    return _Band(grid, middle, low, high, there.sum(axis=0))


def curves_figure(
    recipes: Mapping[str, Sequence[str | os.PathLike[str]]], centre: Centre = "mean", *, each: bool = False
) -> Figure:
    """Draw return, success, inspected points and delta-v of recipes over the environment steps.

    A line is the mean or the interquartile mean over the seeds of a recipe, and the band around it is the 95 %
    bootstrap interval. The line is dotted where some seeds of a recipe have no value: at its start, or after the end of
    a shorter training. Dots are evaluations during a training.

    Args:
        recipes: For each recipe, by its label, the ``progress.csv`` of each of its seeds.
        centre: How the seeds are combined.
        each: Whether the seeds are also drawn, as thin lines.

    Raises:
        SafeInspectError: A file cannot be read, there is none, or Matplotlib is not installed.
    """
    if not recipes or not all(recipes.values()):
        raise SafeInspectError("no learning curves: give the folders of trainings")
    columns = {label: [_read_learning_curve(path) for path in paths] for label, paths in recipes.items()}
    with new_figure(9.0, 5.8, layout="constrained") as figure:
        every = [run for runs in columns.values() for run in runs]
        ended = any(np.isfinite(run[name]).any() for run in every for name, *_ in _PANELS)  # any episode
        panels, scale = _panels_of(figure, np.concatenate([run[_STEPS] for run in every]))
        for axes, (name, label, factor) in zip(panels.flat, _PANELS, strict=True):
            drawn = [
                _draw_recipe(axes, runs, name, factor, scale, centre, each, deputy_line(index))
                for index, runs in enumerate(columns.values())
            ]
            _label_panel(axes, label, factor, any(drawn), ended)
        panels[1, 1].set_ylim(0.0, None)
        _draw_legend(figure, columns, centre)
    return figure


def _draw_recipe(
    axes: Any, runs: Sequence[Mapping[str, FloatArray]], name: str, factor: float, scale: float, centre: Centre,
    each: bool, line: Mapping[str, Any],
) -> bool:  # fmt: skip
    """Draw one recipe in one panel and return whether any value is known."""
    curves = [_curve(run[_STEPS] / scale, run[name] * factor) for run in runs]
    if each:
        for steps, values in curves:
            axes.plot(steps, values, color=line["color"], linewidth=0.6, alpha=0.45)
    found = _band(curves, centre)
    if not len(found.steps):
        return False
    for run in runs:
        if f"evaluation_{name}" in run:
            axes.plot(run[_STEPS] / scale, run[f"evaluation_{name}"] * factor, "o", markersize=4, color=line["color"])
    whole = found.curves == len(runs)
    axes.fill_between(found.steps, found.low, found.high, color=line["color"], alpha=0.18, linewidth=0.0)
    if len(found.steps) == 1:
        axes.plot(found.steps, found.centre, linestyle="", marker="o", markersize=4, color=line["color"])
    axes.plot(found.steps, np.where(whole, found.centre, np.nan), **line)
    partial = ~whole
    partial[:-1] |= ~whole[1:]  # connects the dotted pieces to the solid ones
    partial[1:] |= ~whole[:-1]
    if not whole.all():
        axes.plot(found.steps, np.where(partial, found.centre, np.nan), color=line["color"], linestyle=":")
    return True


def _curve(steps: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return a curve sorted by its steps, without duplicate steps."""
    steps, values = steps[np.isfinite(steps)], values[np.isfinite(steps)]
    order = np.unique(steps, return_index=True)[1]
    return steps[order], values[order]


def _draw_legend(figure: Figure, columns: Mapping[str, Sequence[Any]], centre: Centre) -> None:
    from matplotlib.lines import Line2D

    several = any(len(runs) > 1 for runs in columns.values())
    title = f"{_CENTRES[centre]} over the seeds, with its 95 % bootstrap interval" if several else None
    labels = [f"{label} ({len(runs)} seeds)" if len(runs) > 1 else label for label, runs in columns.items()]
    handles = [Line2D([], [], linewidth=2.0, label=label, **deputy_line(i)) for i, label in enumerate(labels)]
    columns_fit = max(1, min(4, 110 // (max(map(len, labels)) + 6)))
    place: Any = {"loc": "outside upper left", "ncols": columns_fit, "alignment": "left"}
    figure.legend(handles=handles, title=title, title_fontsize=8.5, **place)
