"""The figure of several trainings: recipes with confidence bands over their seeds."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from safe_inspect.errors import SafeInspectError
from safe_inspect.figures.bands import Centre, band
from safe_inspect.figures.drawing import deputy_line, style
from safe_inspect.figures.learning_curve import PANELS, STEPS, read_learning_curve, step_unit
from safe_inspect.geometry.picture import GREY
from safe_inspect.types import FloatArray

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Name in a figure of each way to combine seeds.
_CENTRES = {"mean": "mean", "iqm": "interquartile mean"}


def curves_figure(
    recipes: Mapping[str, Sequence[str | os.PathLike[str]]], centre: Centre = "mean", *, each: bool = False
) -> Figure:
    """Draw return, success, inspected points and delta-v of recipes over the environment steps.

    A line is the mean or the interquartile mean over the seeds of a recipe, and the band around it is the 95 %
    bootstrap interval. The line is dotted where some seeds of a recipe have no value: at its start, or after the end of
    a shorter training.

    Args:
        recipes: For each recipe, by its label, the ``progress.csv`` of each of its seeds.
        centre: How the seeds are combined.
        each: Whether the seeds are also drawn, as thin lines.

    Raises:
        SafeInspectError: A file cannot be read, there is none, or Matplotlib is not installed.
    """
    if not recipes or not all(recipes.values()):
        raise SafeInspectError("no learning curves: give the folders of trainings")
    columns = {label: [read_learning_curve(path) for path in paths] for label, paths in recipes.items()}
    with style():
        from matplotlib.figure import Figure

        figure = Figure(figsize=(9.0, 5.8), facecolor="white", layout="constrained")
        panels = figure.subplots(2, 2, sharex=True)
        scale, unit = step_unit(np.concatenate([run[STEPS] for runs in columns.values() for run in runs]))
        for axes, (name, label, factor) in zip(panels.flat, PANELS, strict=True):
            drawn = [
                _draw(axes, runs, name, factor, scale, centre, each, deputy_line(index))
                for index, runs in enumerate(columns.values())
            ]
            if not any(drawn):
                axes.text(0.5, 0.5, "no episode has ended", transform=axes.transAxes, ha="center", color=GREY)
            axes.set_ylabel(label)
            if factor == 100.0:
                axes.set_ylim(-3, 103)
        panels[1, 1].set_ylim(0.0, None)
        for axes in panels[1]:
            axes.set_xlabel(f"environment steps{unit}")
        _draw_legend(figure, columns, centre)
    return figure


def _draw(
    axes: Any, runs: Sequence[Mapping[str, FloatArray]], name: str, factor: float, scale: float, centre: Centre,
    each: bool, line: Mapping[str, Any],
) -> bool:  # fmt: skip
    """Draw one recipe in one panel and return whether any value is known."""
    curves = [_curve(run[STEPS] / scale, run[name] * factor) for run in runs]
    if each:
        for steps, values in curves:
            axes.plot(steps, values, color=line["color"], linewidth=0.6, alpha=0.45)
    found = band(curves, centre)
    if not len(found.steps):
        return False
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

    handles, labels = [], []
    for index, (label, runs) in enumerate(columns.items()):
        seeds = f" ({len(runs)} seeds)" if len(runs) > 1 else ""
        labels.append(f"{label}{seeds}")
        handles.append(Line2D([], [], linewidth=2.0, label=labels[-1], **deputy_line(index)))
    title = f"{_CENTRES[centre]} over the seeds, with its 95 % bootstrap interval"
    if all(len(runs) < 2 for runs in columns.values()):
        title = ""
    widest = max(map(len, labels))
    place: Any = {"loc": "outside upper left", "ncols": max(1, min(4, 110 // (widest + 6))), "alignment": "left"}
    figure.legend(handles=handles, title=title or None, title_fontsize=8.5, **place)
